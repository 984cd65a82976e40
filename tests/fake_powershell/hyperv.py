"""The cmdlets of the Hyper-V module, with what Hyper-V refuses (windows.md 1.2, 3, 4).

With `host.py` it is the model of the host, which knows nothing of the interpreter: in, a host and the parameters of a
call; out, a value.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

from rarms_iac.model.capacity import decide_packing
from rarms_iac.model.claims import Claim
from tests.builders import a_capacity
from tests.fake_powershell.host import Vm, WindowsHost
from tests.fake_powershell.values import (
    EMPTY,
    Enumerated,
    Guid,
    Long,
    Record,
    ScriptError,
    Thing,
    Value,
    elements,
    guid,
    number,
    text,
)

Given = Mapping[str, Value]


class Caller(Protocol):
    """A process on the host that calls cmdlets, with the jobs that it started and did not remove."""

    host: WindowsHost
    jobs: list[Value]


WINDOWS_10 = 10240
CORE, ROOT = 3, 4
"""Event data of the schedulers that are told apart."""

ADAPTER = "Network Adapter"
FIVE_MINUTES = 300_000
"""What Stop-VM -Force gives the programs of a guest."""
MOST_PROCESSORS = {1: 64, 2: 240}


class Live(Thing):
    """An object of Hyper-V: its properties are what the machine is whenever they are read."""

    def __init__(self, kind: str, vm: Vm, read: Callable[[Vm], dict[str, Value]]) -> None:
        self.type_name = f"Microsoft.HyperV.PowerShell.{kind}"
        self.vm = vm
        self._read = read

    @property
    def properties(self) -> dict[str, Value]:  # type: ignore[override]  # they are read, not kept
        return self._read(self.vm)


def machine_of(host: WindowsHost, vm: Vm) -> Live:
    """What Get-VM gives of it."""

    def read(vm: Vm) -> dict[str, Value]:
        found = {
            "Id": Guid(vm.id),
            "Name": vm.name,
            "Path": vm.folder or host.machine_folder,
            "State": Enumerated(vm.state),
            "Generation": vm.generation,
            "Version": vm.version,
            "Notes": vm.notes,
            "ProcessorCount": Long(vm.processors),
            "MemoryStartup": Long(vm.memory),
            "MemoryAssigned": Long((vm.assigned or vm.memory) * vm.active),
            "DynamicMemoryEnabled": vm.dynamic_memory,
            "AutomaticStartAction": Enumerated(vm.start_action),
            "AutomaticStartDelay": vm.start_delay,
            "AutomaticStopAction": Enumerated(vm.stop_action),
            "CheckpointType": Enumerated(vm.checkpoints),
            "ReplicationMode": Enumerated(vm.replication_mode),
        }
        return found | ({"IsClustered": vm.clustered == "True"} if vm.clustered else {})

    return Live("VirtualMachine", vm, read)


def settle(host: WindowsHost) -> None:
    """Guests that were asked to shut down are off when their time has come."""
    for vm in host.vms.values():
        if vm.stopping is not None and vm.stopping <= host.clock:
            vm.state, vm.stopping = "Off", None
        if vm.services_at is not None and vm.services_at <= host.clock:
            vm.shutdown_service = True


def refuse(says: str, command: str, error_id: str = "InvalidState") -> ScriptError:
    where = f"Microsoft.HyperV.PowerShell.Commands.{command}"
    return ScriptError(says, error_id=f"{error_id},{where}", category="InvalidOperation")


def _vm(caller: Caller, given: Given) -> Vm:
    machine = given.get("vm")
    if not isinstance(machine, Live):
        raise ScriptError("Cannot bind parameter 'VM'.", error_id="ParameterArgumentTransformationError")
    found = caller.host.vms.get(machine.vm.id)
    if found is None:
        raise ScriptError("Hyper-V was unable to find the virtual machine.", error_id="ObjectNotFound")
    return found


def _each(read: Callable[[Vm], Value]) -> Callable[[Caller, Given], Value]:
    """A cmdlet that reads one machine or several: what it gives of each, one after another."""

    def read_all(caller: Caller, given: Given) -> Value:
        machines = given.get("vm")
        if not isinstance(machines, list):
            return read(_vm(caller, given))
        if not machines:
            raise ScriptError("Cannot bind argument to parameter 'VM': it is an empty array.")
        return [found for machine in machines for found in elements(read(_vm(caller, {"vm": machine})))]

    return read_all


def _changing(caller: Caller) -> None:
    if not caller.host.elevated:
        raise ScriptError(
            "You do not have the required permission.", error_id="AccessDenied", category="PermissionDenied"
        )


def _off(vm: Vm, what: str, command: str) -> None:
    if vm.state != "Off":
        raise refuse(f"Failed to modify {what} of '{vm.name}': it is {vm.state}, not off.", command)


def get_vm(caller: Caller, given: Given) -> Value:
    host = caller.host
    settle(host)
    if "id" not in given:
        return [machine_of(host, vm) for vm in host.vms.values()] if host.elevated else []
    found = host.vms.get(str(guid(given["id"])))
    if found is None:
        raise ScriptError(
            "Hyper-V was unable to find a virtual machine with that id.",
            error_id="InvalidParameter,Microsoft.HyperV.PowerShell.Commands.GetVM",
            category="InvalidArgument",
        )
    return machine_of(host, found)


def get_host(caller: Caller, given: Given) -> Thing:
    host = caller.host
    return Record(
        Name=host.computer,
        LogicalProcessorCount=host.logical_processors,
        MemoryCapacity=Long(host.memory),
        NumaSpanningEnabled=host.numa_spanning,
        VirtualMachinePath=host.machine_folder,
        VirtualHardDiskPath=host.disk_folder,
    )


def get_processor(vm: Vm) -> Thing:
    def read(vm: Vm) -> dict[str, Value]:
        found = {
            "VMId": Guid(vm.id),
            "VMName": vm.name,
            "Count": Long(vm.processors),
            "Reserve": Long(vm.reserve),
            "Maximum": Long(vm.limit),
            "RelativeWeight": vm.weight,
        }
        return found | ({"HwThreadCountPerCore": Long(int(vm.threads_per_core))} if vm.threads_per_core else {})

    return Live("VMProcessor", vm, read)


def get_memory(vm: Vm) -> Thing:
    def read(vm: Vm) -> dict[str, Value]:
        sizes = {"Startup": vm.memory, "Minimum": vm.memory_minimum, "Maximum": vm.memory_maximum}
        found = {name: Long(size) for name, size in sizes.items()}
        return {"VMId": Guid(vm.id), "DynamicMemoryEnabled": vm.dynamic_memory, **found}

    return Live("VMMemory", vm, read)


def new_vm(caller: Caller, given: Given) -> Value:
    _changing(caller)
    host = caller.host
    name, switch = text(given["name"]), text(given.get("switchname", ""))
    generation = number(given.get("generation", 1))
    if "switchname" in given and switch not in host.switches:
        raise refuse(f'Hyper-V was unable to find a virtual switch with name "{switch}".', "NewVM", "InvalidParameter")
    if generation not in MOST_PROCESSORS or not 0 < len(name) <= 100:
        raise refuse("New-VM: the parameter is incorrect.", "NewVM", "InvalidParameter")
    memory = _memory_of(given.get("memorystartupbytes", 512 * 2**20), "NewVM")

    def make() -> None:
        host.made += 1
        new = f"{host.made:08x}-5ade-4000-8000-{host.made:012x}"
        host.vms[new] = Vm(id=new, name=name, generation=generation, memory=memory, adapters=[(ADAPTER, switch)])
        if "path" in given:
            host.vms[new].folder = f"{text(given['path']).rstrip(chr(92))}\\{name}"
            host.write_file(host.vms[new].folder, None)
        host.vms[new].dynamic_memory = True  # as on a client; a server's is static: a script may rely on neither

    host.effect(f"New-VM {name}", make)
    return machine_of(host, list(host.vms.values())[-1])


def _memory_of(value: Value, command: str) -> int:
    size = number(value)
    if size < 32 * 2**20 or size % 2**21:
        raise refuse(f"Invalid startup memory {size}.", command, "InvalidParameter")
    return size


def set_vm(caller: Caller, given: Given) -> Value:
    _changing(caller)
    vm = _vm(caller, given)
    if "automaticstopaction" in given:
        _off(vm, "the automatic stop action", "SetVM")
    names = {
        "notes": "notes",
        "automaticstartaction": "start_action",
        "automaticstopaction": "stop_action",
        "checkpointtype": "checkpoints",
    }
    _set(caller, vm, "Set-VM", {names[key]: text(value) for key, value in given.items() if key != "vm"})
    return EMPTY


def _set(caller: Caller, vm: Vm, command: str, values: Mapping[str, Value]) -> None:
    def do() -> None:
        for name, value in values.items():
            setattr(vm, name, value)

    caller.host.effect(f"{command} {vm.name} {', '.join(values)}", do)


def set_processor(caller: Caller, given: Given) -> Value:
    _changing(caller)
    vm = _vm(caller, given)
    names = {"count": "processors", "reserve": "reserve", "maximum": "limit", "relativeweight": "weight"}
    wanted = {names[key]: number(value) for key, value in given.items() if key != "vm"}
    if "processors" in wanted:
        _off(vm, "the processor count", "SetVMProcessor")
        if not 1 <= wanted["processors"] <= MOST_PROCESSORS[vm.generation]:
            raise refuse("Failed to modify device 'Processor'.", "SetVMProcessor", "InvalidParameter")
    if vm.state == "Saved":
        _off(vm, "the processor", "SetVMProcessor")
    reserve, limit = wanted.get("reserve", vm.reserve), wanted.get("limit", vm.limit)
    weight = wanted.get("weight", vm.weight)
    if not 0 <= reserve <= limit <= 100 or not 1 <= weight <= 10_000:
        raise refuse("Failed to modify device 'Processor'.", "SetVMProcessor", "InvalidParameter")
    _set(caller, vm, "Set-VMProcessor", wanted)
    return EMPTY


def set_memory(caller: Caller, given: Given) -> Value:
    _changing(caller)
    vm, host = _vm(caller, given), caller.host
    size = _memory_of(given.get("startupbytes", vm.memory), "SetVMMemory")
    dynamic = given.get("dynamicmemoryenabled", vm.dynamic_memory)
    is_live = vm.state == "Running" and not vm.dynamic_memory and vm.guest_build >= WINDOWS_10
    if dynamic != vm.dynamic_memory or (size != vm.memory and not is_live):
        _off(vm, "the memory", "SetVMMemory")
    if vm.state == "Running" and size > vm.memory:
        _check_memory(host, vm, size, "SetVMMemory")
    _set(caller, vm, "Set-VMMemory", {"memory": size, "dynamic_memory": dynamic})
    return EMPTY


def _check_memory(host: WindowsHost, vm: Vm, size: int, command: str) -> None:
    taken = sum(other.memory for other in host.vms.values() if other.active and other.id != vm.id)
    if taken + size > host.memory:
        raise refuse(f"Not enough memory in the system to start '{vm.name}'. (0x800705AA)", command, "Unspecified")


def start_vm(caller: Caller, given: Given) -> Value:
    _changing(caller)
    vm, host = _vm(caller, given), caller.host
    settle(host)
    if vm.state == "Running":
        return EMPTY
    if vm.state not in ("Off", "Saved", "Paused"):
        raise refuse(f"'{vm.name}' failed to start: it is {vm.state}.", "StartVM")
    _check_memory(host, vm, vm.memory, "StartVM")
    claims = [vm, *(other for other in host.vms.values() if other.active and other.id != vm.id)]
    smt = host.scheduler == CORE and any(each["logical"] != each["cores"] for each in host.processors)
    places = host.logical_processors // (2 if smt else 1)
    promises = [Claim(processors=places_of(each, smt=smt), reserve=each.reserve) for each in claims]
    if host.scheduler != ROOT and vm.reserve and decide_packing(promises, a_capacity(places)) is False:
        raise refuse(f"'{vm.name}' failed to start: the reserve cannot be met.", "StartVM", "Unspecified")
    writes = vm.wrote_entry or (vm.generation == 2 and bool(vm.disks))  # as Windows, shim and grub do
    _set(caller, vm, "Start-VM", {"state": "Running", "started_at": host.clock, "wrote_entry": writes})
    return EMPTY


def places_of(vm: Vm, *, smt: bool) -> int:
    """The LPs of a machine, or its cores where no core runs two machines: core scheduler with SMT (windows.md 2)."""
    return -(-vm.processors // 2) if smt and vm.threads_per_core != "1" else vm.processors


def stop_vm(caller: Caller, given: Given) -> Value:
    _changing(caller)
    vm, host = _vm(caller, given), caller.host
    settle(host)
    if vm.state == "Off":
        return EMPTY
    if given.get("turnoff"):
        _set(
            caller, vm, "Stop-VM", {"state": "Off", "stopping": None, "was_cut": vm.stopping is not None or vm.was_cut}
        )
        for process in host.processes:
            process.alive &= process.vm != vm.id
    elif vm.state != "Running":
        raise refuse(f"'{vm.name}' cannot shut down: it is {vm.state}.", "StopVM")
    elif not given.get("asjob"):
        raise AssertionError("a shutdown that waits for ever")
    else:
        force = bool(given.get("force"))
        refuses = vm.stop_fails or not vm.shutdown_service or (vm.locked and not force) or vm.stopping is not None
        if not refuses:
            allowed = FIVE_MINUTES if force else vm.needs_ms
            off = host.clock + min(vm.needs_ms, allowed)
            cut = vm.was_cut or off < (vm.asked_at or host.clock) + vm.needs_ms
            asked: dict[str, Value] = {"asked_at": vm.asked_at or host.clock, "was_forced": force}
            goes = vm.obeys and (force or not vm.unsaved)
            _set(caller, vm, "Stop-VM", asked | ({"stopping": off, "was_cut": cut} if goes else {}))
        return StopJob(caller, failed=refuses)
    return EMPTY


class StopJob(Thing):
    """What Stop-VM -AsJob gives."""

    type_name = "Microsoft.HyperV.PowerShell.VMJob"
    problem = "The guest refused to shut down. (0x80070015)"

    def __init__(self, caller: Caller, *, failed: bool) -> None:
        super().__init__(State=Enumerated("Failed" if failed else "Running"))
        caller.jobs.append(self)


def remove_job(caller: Caller, given: Given) -> Value:
    caller.jobs.remove(given["job"])
    return EMPTY


def receive_job(_: Caller, given: Given) -> Value:
    if text(given["job"].get("State")) == "Running":
        return EMPTY
    raise ScriptError(StopJob.problem, error_id="OperationFailed")


def get_services(caller: Caller, given: Given) -> Value:
    vm = _vm(caller, given)
    answers = "Ok" if vm.shutdown_service and vm.state == "Running" else "NoContact"
    return [
        Record(Id=f"Microsoft:{vm.id.upper()}\\{guid}", Enabled=True, PrimaryOperationalStatus=Enumerated(answers))
        for guid in ("2A34B1C2-FD73-4043-8A5B-DD2159BC743F", "9F8233AC-BE49-4C79-8EE3-E7E1985B2077")
    ]


def remove_vm(caller: Caller, given: Given) -> Value:
    _changing(caller)
    vm, host = _vm(caller, given), caller.host
    if vm.state not in ("Off", "Saved"):
        raise refuse(f"'{vm.name}' is {vm.state} and cannot be removed.", "RemoveVM")
    if not given.get("force"):
        raise ScriptError("nobody is there to answer the prompt of Remove-VM")
    host.effect(f"Remove-VM {vm.name}", lambda: host.vms.pop(vm.id))
    return EMPTY


def get_firmware(vm: Vm) -> Thing:
    if vm.generation == 1:
        raise refuse(
            f"'{vm.name}' has generation 1, which does not have firmware.", "GetVMFirmware", "InvalidParameter"
        )

    def read(vm: Vm) -> dict[str, Value]:
        order = [Record(BootType=Enumerated(entry)) for entry in ("File", vm.boots_from)[not vm.wrote_entry :]]
        known = {"SecureBoot": Enumerated(vm.secure_boot), "SecureBootTemplate": vm.template, "BootOrder": order}
        return {"VMId": Guid(vm.id), **known}

    return Live("VMFirmware", vm, read)


def set_firmware(caller: Caller, given: Given) -> Value:
    _changing(caller)
    vm = _vm(caller, given)
    get_firmware(vm)
    _off(vm, "the firmware", "SetVMFirmware")
    values: dict[str, Value] = {}
    if "enablesecureboot" in given:
        values["secure_boot"] = text(given["enablesecureboot"])
    if "secureboottemplate" in given:
        values["template"] = text(given["secureboottemplate"])
        if values["template"] not in ("MicrosoftWindows", "MicrosoftUEFICertificateAuthority"):
            raise refuse("Set-VMFirmware: there is no such template.", "SetVMFirmware", "InvalidParameter")
    if "firstbootdevice" in given:
        if not vm.disks:
            raise refuse("Set-VMFirmware: the device is not the machine's.", "SetVMFirmware", "InvalidParameter")
        values |= {"boots_from": "Drive", "wrote_entry": False}
    _set(caller, vm, "Set-VMFirmware", values)
    return EMPTY


def move_storage(caller: Caller, given: Given) -> Value:
    """The old folder stays, empty."""
    _changing(caller)
    vm, host, path = _vm(caller, given), caller.host, text(given["virtualmachinepath"])
    if path.lower() == vm.folder.lower():
        raise refuse("The virtual machine is there already.", "MoveVMStorage")

    def do() -> None:
        host.write_file(path, None)
        vm.folder = path

    host.effect(f"Move-VMStorage {vm.name}", do)
    return EMPTY


def rename_vm(caller: Caller, given: Given) -> Value:
    _changing(caller)
    new = text(given["newname"])
    if not 0 < len(new) <= 100:
        raise refuse("Rename-VM: the parameter is incorrect.", "RenameVM", "InvalidParameter")
    _set(caller, _vm(caller, given), "Rename-VM", {"name": new})
    return EMPTY


def new_vhd(caller: Caller, given: Given) -> Value:
    _changing(caller)
    host, path, parent = caller.host, text(given["path"]), text(given["parentpath"])
    if host.file(parent) is None or not path.lower().endswith(".vhdx"):
        raise refuse(f"Failed to create the virtual hard disk: '{parent}' does not exist.", "NewVHD", "ObjectNotFound")
    if host.file(path) is not None:
        raise refuse(f"Failed to create the virtual hard disk: '{path}' exists.", "NewVHD", "OperationFailed")
    folder = path.rpartition("\\")[0]
    if folder.lower() != host.disk_folder.lower() and host.file(folder) is None:
        says = "Failed to create the virtual hard disk: the system cannot find the path specified. (0x80070003)"
        raise refuse(says, "NewVHD", "ObjectNotFound")
    host.effect(f"New-VHD {path}", lambda: host.write_file(path, CHILD + parent.encode()))
    return Record(Path=path)


CHILD = b"child of "
"""Begins what the stand-in keeps as the content of a differencing disk; its parent's path follows."""


def get_vhd(caller: Caller, given: Given) -> Value:
    if isinstance(given["path"], list):
        return [get_vhd(caller, {"path": path}) for path in given["path"]]
    path = text(given["path"])
    if set(path) & set("*?[]`"):
        raise AssertionError(f"Get-VHD reads {path} as a pattern")
    file = caller.host.file(path)
    if not path or file is None or file.data is None:
        raise refuse(f"Getting the virtual disk failed: '{path}' does not exist.", "GetVHD", "ObjectNotFound")
    child = file.data.startswith(CHILD)
    parent = file.data.removeprefix(CHILD).decode() if child else None
    return Record(Path=file.path, VhdType=Enumerated("Differencing" if child else "Dynamic"), ParentPath=parent)


def get_drives(caller: Caller, given: Given) -> Value:
    if "vmsnapshot" in given:
        snapshot = given["vmsnapshot"]
        return [_drive(snapshot.vm, path) for path in snapshot.vm.checkpoint_disks]
    return _each(lambda vm: [_drive(vm, disk) for disk in vm.disks])(caller, given)


def _drive(vm: Vm, path: str) -> Live:
    return Live("HardDiskDrive", vm, lambda vm: {"VMId": Guid(vm.id), "Path": path})


def get_snapshots(vm: Vm) -> Value:
    return [
        Live("VMSnapshot", vm, lambda vm, name=str(number): {"VMId": Guid(vm.id), "Name": name})  # type: ignore[misc]  # its own name
        for number in range(vm.checkpoint_count)
    ]


def add_disk(caller: Caller, given: Given) -> Value:
    _changing(caller)
    vm, host, path = _vm(caller, given), caller.host, text(given["path"])
    if host.file(path) is None:
        raise refuse(f"'{path}' does not exist.", "AddVMHardDiskDrive", "ObjectNotFound")
    _set(caller, vm, "Add-VMHardDiskDrive", {"disks": [*vm.disks, path]})
    return EMPTY


def remove_adapter(caller: Caller, given: Given) -> Value:
    _changing(caller)
    vm = _vm(caller, given)
    if vm.generation == 1:
        _off(vm, "the network adapters", "RemoveVMNetworkAdapter")
    _set(caller, vm, "Remove-VMNetworkAdapter", {"adapters": []})
    return EMPTY


def update_cluster(caller: Caller, given: Given) -> Value:
    _changing(caller)
    vm, host = caller.host.vms[text(given["vmid"])], caller.host
    host.effect(f"Update-ClusterVirtualMachineConfiguration {vm.name}", lambda: setattr(vm, "cluster_knows", True))
    return EMPTY


CMDLETS: dict[str, Callable[[Caller, Given], Value]] = {
    "get-vm": get_vm,
    "get-vmhost": get_host,
    "get-vmprocessor": _each(get_processor),
    "get-vmmemory": _each(get_memory),
    "get-vmharddiskdrive": get_drives,
    "get-vhd": get_vhd,
    "get-vmnetworkadapter": _each(
        lambda vm: [Record(VMId=Guid(vm.id), Name=name, SwitchName=switch) for name, switch in vm.adapters]
    ),
    "get-vmsecurity": _each(lambda vm: Record(Shielded=vm.shielded)),
    "update-clustervirtualmachineconfiguration": update_cluster,
    "get-vmintegrationservice": get_services,
    "get-vmsnapshot": _each(get_snapshots),
    "get-vmswitch": lambda caller, given: [Record(Name=switch) for switch in caller.host.switches],
    "get-vmhostnumanode": lambda caller, given: [
        Record(
            MemoryAvailable=node["memory_available"],
            MemoryTotal=node["memory"],
            ProcessorsAvailability=[0] * node.get("processors", caller.host.logical_processors),
        )
        for node in caller.host.numa
    ],
    "get-vmfirmware": _each(get_firmware),
    "set-vmfirmware": set_firmware,
    "new-vm": new_vm,
    "set-vm": set_vm,
    "set-vmprocessor": set_processor,
    "set-vmmemory": set_memory,
    "start-vm": start_vm,
    "stop-vm": stop_vm,
    "remove-vm": remove_vm,
    "rename-vm": rename_vm,
    "move-vmstorage": move_storage,
    "new-vhd": new_vhd,
    "add-vmharddiskdrive": add_disk,
    "remove-vmnetworkadapter": remove_adapter,
}


def refused(host: WindowsHost, what: str) -> None:
    """Raise what the host has been told to answer this command with."""
    if found := host.refusals.get(what):
        error_id, category, says = found
        raise ScriptError(says, error_id=error_id, category=category)


def require_answer(host: WindowsHost, name: str, given: Given) -> None:
    """Raise where the host does not answer this cmdlet, or not for one of its machines."""
    refused(host, name)
    for machine in elements(given.get("vm", EMPTY)):
        if isinstance(machine, Thing):
            refused(host, f"{name} {machine.get('Name')}")
