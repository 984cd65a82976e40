"""A stand-in host from what observe.ps1 printed of a real one, and back through the very script."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from typing import Any

from rarms_iac.model.state import State
from rarms_iac.powershell.render import render_observe
from rarms_iac.providers.hyperv.parse import to_state
from tests.fake_powershell.host import Entry, Vm, WindowsHost
from tests.fake_powershell.hyperv import CHILD
from tests.fake_powershell.run import observe
from tests.recorded_hosts import read_observation

Document = Mapping[str, Any]

WINDOWS = "HKLM:\\SOFTWARE\\Microsoft\\Windows NT\\CurrentVersion"
PROFILE = WINDOWS + "\\Multimedia\\SystemProfile"
RECORDS = "HKLM:\\SOFTWARE\\rarms"
CRYPTOGRAPHY = "HKLM:\\SOFTWARE\\Microsoft\\Cryptography"
JOURNAL = "C:\\ProgramData\\rarms\\journal.jsonl"

_ASKS = {
    "host_visible": "Get-CimInstance Msvm_ComputerSystem",
    "hypervisor": "Get-VMHost",
    "machines": "Get-VM",
    "switches": "Get-VMSwitch",
    "numa": "Get-VMHostNumaNode",
    "processors": "Get-CimInstance Win32_Processor",
    "cpu_groups": "Get-CimInstance Msvm_ProcessorSettingData",
    "guests": "Get-CimInstance Msvm_KvpExchangeComponent",
    "shutdown_services": "Get-CimInstance Msvm_ShutdownComponent",
    "scheduler": "Get-WinEvent",
    "module": "Get-Module",
    "hypervisor_running": "Get-CimInstance Win32_ComputerSystem",
    "counters": "Get-CimInstance Win32_PerfFormattedData_HvStats_HyperVHypervisorLogicalProcessor",
    "execution_policy": "Get-ExecutionPolicy",
    "journal": f"Get-ChildItem {JOURNAL.rpartition(chr(92))[0]}",
    "tasks": f"Get-ChildItem {PROFILE}\\Tasks",
    "records": f"Get-ChildItem {RECORDS}",
    "profile": f"Get-Item {PROFILE}",
    "machine_id": f"Get-Item {CRYPTOGRAPHY}",
}
"""Of each probe the command that it needs: where it was not answered, the host does not answer it either."""


def host_from(document: Document, *files: str) -> WindowsHost:
    """The host that was observed, with these files (images of disks, say) on it."""
    host = WindowsHost(computer=document["computer"])
    for name, probe in document.items():
        if not isinstance(probe, dict):
            continue
        if probe["status"] == "value":
            _FILL[name](host, probe["value"])
        elif not _natural(name, probe):
            category = "PermissionDenied" if probe["status"] == "denied" else "NotSpecified"
            host.refusals[_ASKS[name]] = (probe["error"], category, probe["message"])
    if document["scheduler"]["status"] != "value":
        host.scheduler = None
    for path in files:
        host.write_file(path, b"an image")
    return host


def _natural(name: str, probe: Document) -> bool:
    """Whether the thing itself is missing, so that the stand-in answers so by itself and may be given one."""
    missing = probe["error"].startswith(("PathNotFound", "NoMatchingEventsFound"))
    return probe["status"] == "absent" and (missing or name not in _ASKS)


def document_of(host: WindowsHost) -> dict[str, Any]:
    """What observe.ps1 prints of it."""
    return observe(host, render_observe())


def seen(host: WindowsHost) -> dict[str, Any]:
    """What is there but for the words of the journal, which tell of every kill."""
    return {name: probe for name, probe in document_of(host).items() if name != "journal"}


def state_of(host: WindowsHost, name: str) -> State:
    """What rarms makes of that."""
    return to_state(read_observation(json.dumps(document_of(host)).encode()), name)


def _key(host: WindowsHost, path: str, values: list[Document]) -> None:
    key = host.add_key(path)
    for item in values:
        key.values[item["name"].lower()] = Entry(name=item["name"], kind=item["kind"], data=item["data"])


def _windows(host: WindowsHost, value: Document) -> None:
    texts = {"CurrentBuildNumber": str(value["build"]), "InstallationType": value["installation"]}
    _key(host, WINDOWS, [{"name": name, "kind": "String", "data": data} for name, data in texts.items()])
    host.bits = value["bits"]


def _hypervisor(host: WindowsHost, value: Document) -> None:
    host.computer = value["name"]
    for name in ("logical_processors", "memory", "numa_spanning", "disk_folder"):
        setattr(host, name, value[name])


def _machines(host: WindowsHost, value: list[dict[str, Any]]) -> None:
    for item in value:
        host.vms[item["id"]] = Vm(**{**item, "disks": list(item["disks"])})


def _virtual_disks(host: WindowsHost, value: list[Document]) -> None:
    for item in value:
        if item["type"]:
            host.write_file(item["path"], CHILD + item["parent"].encode() if item["parent"] else b"a disk")
            if item["parent"] and host.file(item["parent"]) is None:
                host.write_file(item["parent"], b"an image")


def _firmware(host: WindowsHost, value: list[Document]) -> None:
    for item in value:
        host.vms[item["machine"]].secure_boot, host.vms[item["machine"]].template = (
            item["secure_boot"],
            item["template"],
        )


def _guests(host: WindowsHost, value: list[Document]) -> None:
    for item in value:
        told = "".join(item["system"])
        build = re.search(r"<VALUE>(\d+)</VALUE>", told)
        if build:
            host.vms[item["machine"]].guest_build, host.vms[item["machine"]].tells_build = int(build[1]), True


def _shutdown_services(host: WindowsHost, value: list[Document]) -> None:
    for item in value:
        host.vms[item["machine"]].shutdown_service = item["status"] == [2]


def _tasks(host: WindowsHost, value: list[Document]) -> None:
    host.add_key(f"{PROFILE}\\Tasks")
    for item in value:
        _key(host, f"{PROFILE}\\Tasks\\{item['name']}", item["values"])


def _records(host: WindowsHost, value: list[Document]) -> None:
    host.add_key(RECORDS)
    for item in value:
        _key(host, f"{RECORDS}\\{item['application']}\\{item['task']}", item["values"])


def _journal(host: WindowsHost, value: Document) -> None:
    folder = JOURNAL.rpartition("\\")[0]
    host.write_file(folder, None)
    host.write_file(JOURNAL, value["text"].encode(), value["owner"])


def _named(name: str) -> Callable[[WindowsHost, Any], None]:
    return lambda host, value: setattr(host, name, value)


_FILL: dict[str, Callable[[WindowsHost, Any], None]] = {
    "windows": _windows,
    "hypervisor": _hypervisor,
    "machines": _machines,
    "virtual_disks": _virtual_disks,
    "firmware": _firmware,
    "guests": _guests,
    "shutdown_services": _shutdown_services,
    "tasks": _tasks,
    "records": _records,
    "journal": _journal,
    "profile": lambda host, value: _key(host, PROFILE, value),
    "machine_id": lambda host, value: _key(
        host, CRYPTOGRAPHY, [{"name": "MachineGuid", "kind": "String", "data": value}]
    ),
    "execution_policy": lambda host, value: setattr(
        host, "execution_policy", [(policy["scope"], policy["policy"]) for policy in value]
    ),
    **{
        name: _named(name)
        for name in (
            *("hyperv_administrator", "hypervisor_running", "counters"),
            *("powershell", "elevated", "host_visible", "module", "scheduler", "processors", "numa", "switches"),
            "cpu_groups",
        )
    },
}
