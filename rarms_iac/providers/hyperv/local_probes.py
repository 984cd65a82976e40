"""This computer's Hyper-V through WMI and the registry, in one process: the document that `observe.ps1` prints. Pure.

What Windows says comes through `LocalWindows` (`local_windows.py` is the real one); `wmi_machines` joins what WMI has.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from rarms_iac.model.host import host_identity
from rarms_iac.providers.hyperv.observation import FORMAT
from rarms_iac.providers.hyperv.wmi_machines import (
    COUNTERS,
    NotRead,
    WmiSource,
    paths_of_disks,
    read_cpu_groups,
    read_disk,
    read_firmware,
    read_guests,
    read_host_visible,
    read_hypervisor,
    read_hypervisor_running,
    read_machines,
    read_numa_nodes,
    read_processors,
    read_shutdown_services,
    read_switches,
)
from rarms_iac.storage.codec import Json

WINDOWS_KEY = r"SOFTWARE\Microsoft\Windows NT\CurrentVersion"
PROFILE_KEY = WINDOWS_KEY + r"\Multimedia\SystemProfile"
RECORDS_KEY = r"SOFTWARE\rarms"
CRYPTOGRAPHY_KEY = r"SOFTWARE\Microsoft\Cryptography"
ENGINE_KEY = r"SOFTWARE\Microsoft\PowerShell\3\PowerShellEngine"
POLICY_KEY = r"SOFTWARE\Policies\Microsoft\Windows\PowerShell"
SHELL_KEY = r"SOFTWARE\Microsoft\PowerShell\1\ShellIds\Microsoft.PowerShell"


@dataclass(frozen=True, slots=True, kw_only=True)
class RegistryKey:
    """A key as it lies there."""

    values: Sequence[tuple[str, str, int | str]]  # name, kind as PowerShell calls it, data
    keys: Sequence[str]


class LocalWindows(WmiSource, Protocol):
    """What this computer's Windows answers; each raises `NotRead`."""

    def bits(self) -> int:
        """Of this process."""

    def key(self, path: str, *, of_user: bool = False) -> RegistryKey:
        """Return a key below HKEY_LOCAL_MACHINE, or of the user; never the one that 32-bit programs are shown."""

    def is_elevated(self) -> bool:
        """Whether the caller is an administrator, with all rights of one."""

    def is_hyperv_administrator(self) -> bool:
        """Whether the caller is a member of Hyper-V Administrators."""

    def scheduler(self) -> int:
        """Return the data of the newest event 2 of the hypervisor."""

    def journal(self) -> tuple[str, str]:
        """Return the SID of its owner, and its text."""

    def is_script_running(self) -> bool:
        """Whether a script of rarms runs: it has the file open that says who holds the computer."""

    def modules(self) -> Sequence[str]:
        """Return the versions of PowerShell's module Hyper-V that are installed."""


def local_document(windows: LocalWindows) -> dict[str, Json]:
    """Everything that `observe.ps1` looks at, in its own form."""
    unread: list[Json] = []
    probes: dict[str, Callable[[LocalWindows], Json]] = {
        "powershell": _powershell,
        "windows": _windows,
        "machine_id": lambda windows: host_identity(_text(windows, CRYPTOGRAPHY_KEY, "MachineGuid")),
        "elevated": lambda windows: windows.is_elevated(),
        "hyperv_administrator": lambda windows: windows.is_hyperv_administrator(),
        "host_visible": read_host_visible,
        "module": lambda windows: list(windows.modules()),
        "scheduler": lambda windows: windows.scheduler(),
        "hypervisor_running": read_hypervisor_running,
        "counters": lambda windows: bool(windows.instances(COUNTERS)),
        "hypervisor": read_hypervisor,
        "processors": read_processors,
        "numa": read_numa_nodes,
        "switches": read_switches,
        "machines": lambda windows: list(read_machines(windows, unread)),
        "unread_machines": lambda _: unread,
        "virtual_disks": lambda windows: [read_disk(windows, path) for path in paths_of_disks(windows)],
        "cpu_groups": read_cpu_groups,
        "firmware": lambda windows: list(read_firmware(windows)),
        "guests": read_guests,
        "shutdown_services": read_shutdown_services,
        "profile": lambda windows: _values(windows, PROFILE_KEY),
        "tasks": _tasks,
        "records": lambda windows: list(_records(windows)),
        "journal": lambda windows: dict(zip(("owner", "text"), windows.journal(), strict=True)),
        "script_running": lambda windows: windows.is_script_running(),
        "execution_policy": lambda windows: list(_policies(windows)),
    }
    read = {name: _probe(probe, windows) for name, probe in probes.items()}
    return {"format": FORMAT, "computer": windows.computer(), **read}


def _probe(probe: Callable[[LocalWindows], Json], windows: LocalWindows) -> Json:
    try:
        return {"status": "value", "value": probe(windows)}
    except NotRead as problem:
        status = "denied" if problem.denied else "absent"
        return {"status": status, "error": problem.error, "message": problem.message}


def _powershell(windows: LocalWindows) -> Json:
    """Return the one that comes with Windows; which one will run a script is not looked at."""
    return {"version": _text(windows, ENGINE_KEY, "PowerShellVersion"), "edition": "Desktop"}


def _windows(windows: LocalWindows) -> Json:
    return {
        "build": int(_text(windows, WINDOWS_KEY, "CurrentBuildNumber")),
        "installation": _text(windows, WINDOWS_KEY, "InstallationType"),
        "product": _text(windows, WINDOWS_KEY, "ProductName"),
        "bits": windows.bits(),
    }


def _tasks(windows: LocalWindows) -> Json:
    path = rf"{PROFILE_KEY}\Tasks"
    return [{"name": name, "values": _values(windows, rf"{path}\{name}")} for name in windows.key(path).keys]


def _records(windows: LocalWindows) -> Iterator[Json]:
    for application in windows.key(RECORDS_KEY).keys:
        for task in windows.key(rf"{RECORDS_KEY}\{application}").keys:
            values = _values(windows, rf"{RECORDS_KEY}\{application}\{task}")
            yield {"application": application, "task": task, "values": values}


def _policies(windows: LocalWindows) -> Iterator[Json]:
    """As the five scopes say; that of this process is for those that it starts, and rarms says it when it does."""
    for scope, of_user in (("MachinePolicy", False), ("UserPolicy", True)):
        yield {"scope": scope, "policy": _policy(windows, POLICY_KEY, of_user=of_user)}
    yield {"scope": "Process", "policy": "Undefined"}
    for scope, of_user in (("CurrentUser", True), ("LocalMachine", False)):
        yield {"scope": scope, "policy": _policy(windows, SHELL_KEY, of_user=of_user)}


def _policy(windows: LocalWindows, path: str, *, of_user: bool) -> str:
    try:
        values = {name.lower(): data for name, _, data in windows.key(path, of_user=of_user).values}
    except NotRead as problem:
        if problem.denied:
            raise
        return "Undefined"
    if values.get("enablescripts") == 0:
        return "Restricted"
    return str(values.get("executionpolicy", "Undefined"))


def _values(windows: LocalWindows, path: str) -> list[Json]:
    return [{"name": name, "kind": kind, "data": data} for name, kind, data in windows.key(path).values]


def _text(windows: LocalWindows, path: str, name: str) -> str:
    for found, _, data in windows.key(path).values:
        if found.lower() == name.lower():
            return str(data)
    raise NotRead("PathNotFound", f"the registry has no value {name} below {path}")
