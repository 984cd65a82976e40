"""This computer's Hyper-V through WMI and the registry, in one process: the document that `observe.ps1` prints. Pure.

What Windows says comes through `LocalWindows` (`local_windows.py` is the real one). Every class of WMI is listed once,
and joined here: what WMI filters by text would need quoting (windows.md 1.3, 3).
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from rarms_iac.model.host import host_identity
from rarms_iac.providers.hyperv.observation import FORMAT
from rarms_iac.storage.codec import Json

WmiInstance = Mapping[str, Any]
"""The properties of an instance; numbers of 64 bits are text, references are paths."""

SETTINGS, SWITCH = "Msvm_VirtualSystemSettingData", "Msvm_VirtualEthernetSwitch"
COUNTERS = "Win32_PerfFormattedData_HvStats_HyperVHypervisorLogicalProcessor"
CLUSTER = "MSCluster_Resource"
QUERIES: Mapping[str, tuple[str, ...]] = {
    "Msvm_ComputerSystem": ("Name", "ElementName", "EnabledState", "OperationalStatus", "ReplicationMode"),
    SETTINGS: (
        *("InstanceID", "VirtualSystemType", "VirtualSystemSubType", "Notes", "AutomaticStartupAction"),
        *("AutomaticShutdownAction", "UserSnapshotType", "SecureBootEnabled", "SecureBootTemplateId"),
    ),
    "Msvm_SettingsDefineState": ("ManagedElement", "SettingData"),
    "Msvm_VirtualSystemSettingDataComponent": ("GroupComponent", "PartComponent"),
    "Msvm_ProcessorSettingData": (
        *("InstanceID", "VirtualQuantity", "Reservation", "Limit", "Weight", "HwThreadsPerCore", "CpuGroupId"),
    ),
    "Msvm_MemorySettingData": ("InstanceID", "VirtualQuantity", "DynamicMemoryEnabled"),
    "Msvm_StorageAllocationSettingData": ("InstanceID", "ResourceSubType", "HostResource"),
    SWITCH: ("Name", "ElementName"),
    "Msvm_SnapshotOfVirtualSystem": ("Antecedent", "Dependent"),
    "Msvm_VirtualSystemManagementServiceSettingData": ("DefaultVirtualHardDiskPath", "NumaSpanningEnabled"),
    "Msvm_NumaNode": ("NumberOfLogicalProcessors", "CurrentlyConsumableMemoryBlocks"),
    "Msvm_KvpExchangeComponent": ("SystemName", "GuestIntrinsicExchangeItems"),
    "Msvm_ShutdownComponent": ("SystemName", "EnabledState", "OperationalStatus"),
    "Msvm_VirtualHardDiskSettingData": ("Type", "ParentPath"),
    "Win32_ComputerSystem": ("TotalPhysicalMemory", "HypervisorPresent"),
    "Win32_Processor": ("Name", "NumberOfCores", "NumberOfLogicalProcessors"),
    COUNTERS: ("Name",),
    CLUSTER: ("Type", "PrivateProperties"),
}
"""What is asked for, by class: an older Windows may lack a property, which is None then."""

REALISED = "Microsoft:Hyper-V:System:Realized"
DISK = "Microsoft:Hyper-V:Virtual Hard Disk"
STATES = {
    1: "Other",
    2: "Running",
    3: "Off",
    4: "Stopping",
    6: "Saved",
    9: "Paused",
    10: "Starting",
    11: "Reset",
    32773: "Saving",
    32776: "Pausing",
    32777: "Resuming",
    32779: "FastSaved",
    32780: "FastSaving",
}
"""EnabledState by the names of PowerShell; from 32781 on the two numberings clash (windows.md 3)."""
DEGRADED = 3
"""OperationalStatus of a machine that lost its storage: PowerShell calls its state critical."""
START_ACTIONS = {2: "Nothing", 3: "StartIfRunning", 4: "Start"}
STOP_ACTIONS = {2: "TurnOff", 3: "Save", 4: "ShutDown"}
CHECKPOINTS = {2: "Disabled", 3: "Production", 4: "ProductionOnly", 5: "Standard"}
REPLICATION_MODES = {0: "None", 1: "Primary", 2: "Replica", 3: "TestReplica", 4: "ExtendedReplica"}
DISK_TYPES = {2: "Fixed", 3: "Dynamic", 4: "Differencing"}
TEMPLATES = {
    "1734c6e8-3154-4dda-ba5f-a874cc483422": "MicrosoftWindows",
    "272e7447-90a4-4563-a4b9-8e4ab00526ce": "MicrosoftUEFICertificateAuthority",
    "4292ae2b-ee2c-42b5-a969-dd8f8689f6f3": "OpenSourceShieldedVM",
}

_GUID = re.compile(r"[0-9A-Fa-f]{8}(?:-[0-9A-Fa-f]{4}){3}-[0-9A-Fa-f]{12}")
_REFERENCE = re.compile(r'[.,](?:InstanceID|Name)="((?:[^"\\]|\\.)*)"')


class NotRead(Exception):
    """A probe has no value.

    Attributes:
        denied: the caller may not ask; else it does not exist.
        error: an id in no language.
        message: in Windows' words, or ours.
    """

    def __init__(self, error: str, message: str, *, denied: bool = False) -> None:
        super().__init__(message)
        self.denied = denied
        self.error = error
        self.message = message


class WmiSource(Protocol):
    """The answers of this computer's WMI; each raises `NotRead`."""

    def computer(self) -> str:
        """Return the computer's name."""

    def instances(self, name: str) -> Sequence[WmiInstance]:
        """Return all instances of a class of `QUERIES`."""

    def disk(self, path: str) -> WmiInstance:
        """Return the Msvm_VirtualHardDiskSettingData of a virtual disk."""


def read_host_visible(source: WmiSource) -> Json:
    """Return whether the host itself is seen: a caller without rights sees no machines and gets no error."""
    computer = source.computer().lower()
    return any(_str(each, "Name").lower() == computer for each in source.instances("Msvm_ComputerSystem"))


def read_hypervisor_running(source: WmiSource) -> Json:
    """Return whether this Windows started under the hypervisor; older ones do not say."""
    systems = source.instances("Win32_ComputerSystem")
    if not systems or systems[0]["HypervisorPresent"] is None:
        raise NotRead("NotFound", "this Windows does not report whether a hypervisor runs")
    return bool(systems[0]["HypervisorPresent"])


def read_hypervisor(source: WmiSource) -> Json:
    """Return the host with the processors of all NUMA nodes: under minroot this Windows sees fewer (windows.md 2)."""
    services = source.instances("Msvm_VirtualSystemManagementServiceSettingData")
    nodes = source.instances("Msvm_NumaNode")
    systems = source.instances("Win32_ComputerSystem")
    if not services or not nodes or not systems:
        raise NotRead("NotFound", "Hyper-V does not show its host to this account", denied=True)
    return {
        "name": source.computer(),
        "logical_processors": sum(_int(node, "NumberOfLogicalProcessors") for node in nodes),
        "memory": _int(systems[0], "TotalPhysicalMemory"),
        "numa_spanning": bool(services[0]["NumaSpanningEnabled"]),
        "disk_folder": _str(services[0], "DefaultVirtualHardDiskPath"),
    }


Column = tuple[Callable[[WmiInstance, str], Json], str]
"""A reader, and the property that it reads."""


def _rows(source: WmiSource, name: str, /, **columns: Column) -> list[dict[str, Json]]:
    """Return the instances of a class as objects with these fields."""
    return [{field: read(each, of) for field, (read, of) in columns.items()} for each in source.instances(name)]


def read_processors(source: WmiSource) -> Json:
    """Return the processor packages, as Windows sees them."""
    cores, logical = (_int, "NumberOfCores"), (_int, "NumberOfLogicalProcessors")
    return [*_rows(source, "Win32_Processor", name=(_str, "Name"), cores=cores, logical=logical)]


def read_numa_nodes(source: WmiSource) -> Json:
    """Return the host's nodes; a block of memory is 1 MiB.

    WMI's pages name no total of a node's memory: 0 stands for not known, and no rule goes by it.
    """
    nodes = _rows(source, "Msvm_NumaNode", memory_available=(_int, "CurrentlyConsumableMemoryBlocks"))
    return [{**node, "memory": 0} for node in nodes]


def _settings(source: WmiSource) -> Iterator[tuple[WmiInstance, WmiInstance]]:
    """Yield each machine with its current settings: not those of its checkpoints, and not the host itself."""
    systems = {_str(system, "Name"): system for system in source.instances("Msvm_ComputerSystem")}
    settings = {_str(each, "InstanceID"): each for each in source.instances(SETTINGS)}
    for link in source.instances("Msvm_SettingsDefineState"):
        system, setting = systems.get(_end(link, "ManagedElement")), settings.get(_end(link, "SettingData"))
        if system is None or setting is None or not _GUID.fullmatch(_str(system, "Name")):
            continue
        if _str(setting, "VirtualSystemType") == REALISED:
            yield system, setting


def _parts(source: WmiSource, setting: WmiInstance, *classes: str) -> list[WmiInstance]:
    """Return the devices of these classes that belong to a machine's settings, in WMI's order."""
    links = source.instances("Msvm_VirtualSystemSettingDataComponent")
    parts = [_end(link, "PartComponent") for link in links if _end(link, "GroupComponent") == setting["InstanceID"]]
    known = {_str(each, "InstanceID"): each for name in classes for each in source.instances(name)}
    return [known[part] for part in parts if part in known]


def read_machines(source: WmiSource, unread: list[Json]) -> Iterator[Json]:
    """Yield each machine; one whose settings cannot be read goes to `unread`, and hides none of the others."""
    clustered = _clustered(source)
    for system, setting in _settings(source):
        machine = {"id": _str(system, "Name").lower(), "name": _str(system, "ElementName")}
        try:
            yield {**machine, **_machine(source, system, setting, clustered)}
        except NotRead as problem:
            unread.append({**machine, "error": problem.error, "message": problem.message})


def _clustered(source: WmiSource) -> frozenset[str]:
    """Return the ids of the machines that a failover cluster has, in lower case.

    Without its namespace the host is not in a cluster.
    """
    try:
        resources = source.instances(CLUSTER)
    except NotRead as problem:
        if problem.denied:
            raise
        return frozenset()
    properties = [each["PrivateProperties"] for each in resources if _str(each, "Type") == "Virtual Machine"]
    return frozenset(str(each["VmID"]).lower() for each in properties if each is not None and "VmID" in each)


def _machine(
    source: WmiSource, system: WmiInstance, setting: WmiInstance, clustered: frozenset[str]
) -> dict[str, Json]:
    (cpu,) = _parts(source, setting, "Msvm_ProcessorSettingData")[:1] or (_lacks("processor"),)
    (memory,) = _parts(source, setting, "Msvm_MemorySettingData")[:1] or (_lacks("memory"),)
    snapshots = source.instances("Msvm_SnapshotOfVirtualSystem")
    threads = cpu["HwThreadsPerCore"]
    return {
        "state": _state(system),
        "generation": 2 if _str(setting, "VirtualSystemSubType").endswith(":2") else 1,
        "notes": "\n".join(setting["Notes"] or ()),
        "processors": _int(cpu, "VirtualQuantity"),
        "reserve": _int(cpu, "Reservation") // 1000,  # cmdlets show whole per cents (windows.md 1.3)
        "limit": _int(cpu, "Limit") // 1000,
        "weight": _int(cpu, "Weight"),
        "threads_per_core": "" if threads is None else str(threads),
        "memory": _int(memory, "VirtualQuantity") * 2**20,
        "dynamic_memory": bool(memory["DynamicMemoryEnabled"]),
        "start_action": _named(START_ACTIONS, setting, "AutomaticStartupAction"),
        "stop_action": _named(STOP_ACTIONS, setting, "AutomaticShutdownAction"),
        "checkpoints": _named(CHECKPOINTS, setting, "UserSnapshotType"),
        "checkpoint_count": sum(_end(each, "Antecedent") == system["Name"] for each in snapshots),
        "clustered": str(_str(system, "Name").lower() in clustered),
        "replication_mode": _named(REPLICATION_MODES, system, "ReplicationMode"),
        "disks": list(_disks(source, setting)),
    }


def _lacks(device: str) -> WmiInstance:
    raise NotRead("NotFound", f"it has no {device} settings in WMI")


def _state(system: WmiInstance) -> str:
    state = _named(STATES, system, "EnabledState")
    return f"{state}Critical" if DEGRADED in list(system["OperationalStatus"] or ())[:1] else state


def _disks(source: WmiSource, setting: WmiInstance) -> Iterator[str]:
    for part in _parts(source, setting, "Msvm_StorageAllocationSettingData"):
        if _str(part, "ResourceSubType") == DISK:
            yield from part["HostResource"] or ()


def paths_of_disks(source: WmiSource) -> Iterator[str]:
    """Yield the virtual disks that machines have."""
    for _, setting in _settings(source):
        yield from _disks(source, setting)


def read_disk(source: WmiSource, path: str) -> Json:
    """Return a machine's disk; of one that cannot be read only its path."""
    try:
        found = source.disk(path)
    except NotRead:
        return {"path": path, "type": "", "parent": ""}
    return {"path": path, "type": _named(DISK_TYPES, found, "Type"), "parent": found["ParentPath"] or ""}


def read_switches(source: WmiSource) -> Json:
    """Return the names of the virtual switches."""
    return [_str(each, "ElementName") for each in source.instances(SWITCH)]


def read_cpu_groups(source: WmiSource) -> Json:
    """Return the processor settings as they lie there, those of checkpoints too."""
    instance, group, reservation = (_str, "InstanceID"), (_str, "CpuGroupId"), (_int, "Reservation")
    rows = _rows(source, "Msvm_ProcessorSettingData", instance=instance, group=group, reservation=reservation)
    return [*rows]


def read_firmware(source: WmiSource) -> Iterator[Json]:
    """Yield secure boot of each machine of generation 2."""
    for system, setting in _settings(source):
        if _str(setting, "VirtualSystemSubType").endswith(":2"):
            template = str(setting["SecureBootTemplateId"] or "").strip("{}").lower()
            yield {
                "machine": _str(system, "Name").lower(),
                "secure_boot": "On" if setting["SecureBootEnabled"] else "Off",
                "template": TEMPLATES.get(template, template),
            }


def read_guests(source: WmiSource) -> Json:
    """Return the claims of guests about their system."""
    return [
        {
            "machine": _str(each, "SystemName").lower(),
            "system": [
                item
                for item in each["GuestIntrinsicExchangeItems"] or ()
                if ">OSName<" in item or ">OSBuildNumber<" in item
            ],
        }
        for each in source.instances("Msvm_KvpExchangeComponent")
    ]


def read_shutdown_services(source: WmiSource) -> Json:
    """Return whether guests can be asked to shut down."""
    status: Column = (lambda each, name: [int(number) for number in each[name] or ()], "OperationalStatus")
    enabled, machine = (_int, "EnabledState"), (_lower, "SystemName")
    return [*_rows(source, "Msvm_ShutdownComponent", machine=machine, enabled=enabled, status=status)]


def _lower(instance: WmiInstance, name: str) -> str:
    return _str(instance, name).lower()


def _str(instance: WmiInstance, name: str) -> str:
    return str(instance[name] or "")


def _int(instance: WmiInstance, name: str) -> int:
    return int(instance[name] or 0)


def _named(names: Mapping[int, str], instance: WmiInstance, name: str) -> str:
    number = _int(instance, name)
    if number not in names:
        raise NotRead("UnknownNumber", f"{name} is {number}, which is unknown")
    return names[number]


def _end(link: WmiInstance, name: str) -> str:
    return _key_of(_str(link, name))


def _key_of(path: str) -> str:
    """Return the key of the instance that a path leads to; backslashes are doubled in it."""
    found = _REFERENCE.search(path)
    return re.sub(r"\\(.)", r"\1", found[1]) if found else ""


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
    """The answers of this computer's Windows; each raises `NotRead`."""

    def bits(self) -> int:
        """Return the word size of this process."""

    def key(self, path: str, *, of_user: bool = False) -> RegistryKey:
        """Return a key below HKEY_LOCAL_MACHINE, or of the user; never the one that 32-bit programs are shown."""

    def is_elevated(self) -> bool:
        """Return whether the caller is an administrator, with all rights of one."""

    def is_hyperv_administrator(self) -> bool:
        """Return whether the caller is a member of Hyper-V Administrators."""

    def scheduler(self) -> int:
        """Return the data of the newest event 2 of the hypervisor."""

    def journal(self) -> tuple[str, str]:
        """Return the SID of its owner, and its text."""

    def is_script_running(self) -> bool:
        """Return whether a script of rarms holds the computer: it has its owner's file open."""

    def modules(self) -> Sequence[str]:
        """Return the versions of PowerShell's module Hyper-V that are installed."""


def local_document(windows: LocalWindows) -> dict[str, Json]:
    """Return everything that `observe.ps1` looks at, in its own form."""
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
    """Yield the policies of the five scopes; this process has one for those that it starts, which rarms gives then."""
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
