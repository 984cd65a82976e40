"""An operation as the calls of a `Set` block: cmdlets and the module's functions, with literals only.

What is set on a machine, and can be set again, is one step of a script with what is set right before it: read once,
compared, set, read again. A run that was killed between two of its calls finds each value old or new, and sets all
again.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import assert_never

from rarms_iac.model import operations
from rarms_iac.model.changes import SLASH
from rarms_iac.model.facets import FACETS, Facet, Reading, Readings
from rarms_iac.model.mmcss import SYSTEM_RESPONSIVENESS
from rarms_iac.model.plan import Step
from rarms_iac.model.state import SECURE_BOOT_OFF, RegistryValue, ValueKind
from rarms_iac.powershell.literals import Literal, NoLiteral, literal
from rarms_iac.powershell.templates import VM, guarded
from rarms_iac.storage.codec import encode
from rarms_iac.storage.json_text import canonical
from rarms_iac.texts.quantities import write_bytes

_FREE: Readings = {"taken": False}
"""No foreign machine has the name: one that came after the plan must not get a namesake."""

NO_EMPTY_KEYS: Readings = {"empty": False}
"""No key is left that holds nothing: a kill may have left one where nothing is to be."""

_CLEARING = (operations.RemoveTaskClass, operations.EraseTaskRecord)
_JOINING = operations.RenamePartition | operations.WriteMark | operations.EraseMark | operations.Set

_WRITE_MARK = "Write-Mark"
_BLIND = ("Hyper-V\\", _WRITE_MARK)
"""What begins the calls that do not look whether it is done already."""

_NEVER_SET = {"exists", "state", "running"}
"""What a step of several calls asks, and none of them sets."""

READER = "Get-PartitionReading"
"""What reads a machine: `-Machine` one that was there before the plan, by its id; `-Name` one that the plan makes."""

VALUE = "value:"
"""Stands before a task class's value in readings."""

_TYPES = {ValueKind.DWORD: "DWord", ValueKind.SZ: "String", ValueKind.QWORD: "QWord"}
"""Of the kinds that are written; a plan that would have to bring back another is refused."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptPiece:
    """One guarded piece of a step: what is read, what is done, and what is read then."""

    address: str
    action: str
    read: str
    before: Readings
    after: Readings
    calls: tuple[str, ...]
    joins: bool = False  # its calls may be made twice, so that it is one step with such pieces before it
    sets: tuple[tuple[str, ...], ...] = ()  # of several that were joined: what each call sets; none: it looks itself


def clustered(piece: ScriptPiece) -> ScriptPiece:
    """Return the piece with a reader that accepts a machine of a failover cluster."""
    return replace(piece, read=f"{piece.read} -Clustered") if piece.read.startswith(f"{READER} -Machine") else piece


def cluster_piece(address: str, machine: str) -> ScriptPiece:
    """Return the piece that updates a cluster's copy of a machine's configuration: due once a step changed the machine.

    It is a step of its own, so that a run that ended right before it makes it when it goes on.
    """
    return ScriptPiece(
        address=f"{address}/cluster",
        action="update the cluster's copy of its configuration",
        read=call("Get-ClusterReading"),
        before={"updated": False},
        after={"updated": True},
        calls=(call("FailoverClusters\\Update-ClusterVirtualMachineConfiguration", VMId=literal(machine)),),
    )


def join_pieces(piece: ScriptPiece, following: ScriptPiece) -> ScriptPiece:
    """Join two pieces: read before the first call and after the last, and call a cmdlet once for the same object."""
    made = {name: value for name, value in following.before.items() if name not in piece.after}
    calls = list(zip(piece.calls, _set_by(piece), strict=True))
    for new, names in zip(following.calls, _set_by(following), strict=True):
        cmdlet, machine, values = new.partition(f" -VM {VM}")
        same = next((at for at, (old, _) in enumerate(calls) if machine and old.startswith(f"{cmdlet}{machine}")), None)
        if same is not None:
            old, had = calls[same]
            calls[same] = (old + values, (*had, *names) if had and names else ())
        else:
            calls = [(old, had) for old, had in calls if old != new] + [(new, names)]
    is_new = piece.read.startswith(f"{READER} -Name")
    actions = [part.action for part in (piece, following) if not _is_known_mark(part)]
    return replace(
        piece,
        action="set all its settings, and its name last" if is_new else "; ".join(actions) or piece.action,
        before={**made, **piece.before},
        after={**piece.after, **following.after},
        calls=tuple(call for call, _ in calls),
        sets=tuple(tuple(dict.fromkeys(names)) for _, names in calls),
    )


def _is_known_mark(piece: ScriptPiece) -> bool:
    """Return whether it writes a mark whose digest of the settings alone differs; the step's readings show that."""
    return piece.calls == (_WRITE_MARK,) and piece.before.get("mark") == piece.after.get("mark")


def _set_by(piece: ScriptPiece) -> tuple[tuple[str, ...], ...]:
    """Return the names that each call sets; none for calls that check themselves whether it is done."""
    names = tuple(
        name for name, value in piece.after.items() if name not in _NEVER_SET and piece.before.get(name) != value
    )
    return piece.sets or tuple(names if call.startswith(_BLIND) else () for call in piece.calls)


def block_of(piece: ScriptPiece) -> tuple[str, ...]:
    """Return the lines of its block: of several calls each is made if the machine does not show yet what it sets.

    A run that is killed again and again at its same call comes to an end so.
    """
    if len(piece.calls) == 1 or not piece.sets:
        return piece.calls
    return tuple(
        guarded(call, map(literal, names)) if names else call
        for call, names in zip(piece.calls, piece.sets, strict=True)
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class NewFiles:
    """The whole paths of the files of a machine that a plan makes."""

    plan: str  # its id, which pending names and names of disks hold
    disk_folder: str  # of the host, where a partition says nothing else

    def pending_name(self, creation: operations.CreatePartition) -> str:
        """Return the machine's name while it is made; a dot cannot occur in a manifest's name."""
        return f"{creation.partition}.rarms-{self.plan}"

    def disk(self, creation: operations.CreatePartition) -> str:
        """Return the disk's path: in the partition's folder, or in the host's own.

        Raises:
            NoLiteral: the host did not tell its folder.
        """
        if not (creation.vm_path or self.disk_folder):
            raise NoLiteral(
                creation.partition, "the host did not report its folder for disks, and `hyperv.path` is not set"
            )
        return operations.disk_path(creation, self.plan, self.disk_folder)


def pieces_of(step: Step, files: NewFiles) -> tuple[ScriptPiece, ...]:
    """Return the guarded pieces of a step, in their order; only a creation has several."""
    match step.operation:
        case operations.CreatePartition() as creation:
            return _creation_pieces(step, creation, files)
        case operations.RestorePartition(partition=partition):
            raise NoLiteral(partition, "a Hyper-V machine cannot be created again")
        case operations.RemoveDisk() as removal:
            return (_disk_removal_piece(str(step.address), step.title, literal(removal.path), removal.parent),)
        case operation:
            return (_piece(step, operation),)


def _disk_removal_piece(address: str, action: str, path: Literal, parent: str) -> ScriptPiece:
    """Return the piece that deletes a file if it is what the plan knew: a child of that parent, unused."""
    return ScriptPiece(
        address=address,
        action=action,
        read=call("Get-DiskReading", Path=path, Parent=literal(parent), Everywhere=""),
        before={"exists": True, "child": True, "used": False},
        after={"exists": False},
        calls=(call("Remove-Item", LiteralPath=path),),
    )


def _piece(step: Step, operation: operations.MachineOperation | operations.TaskOperation) -> ScriptPiece:
    names_pending = isinstance(operation, operations.RenamePartition) and not operation.machine
    if isinstance(operation, operations.TaskOperation):
        calls = _task_calls(step, operation)
    else:
        calls = _machine_calls(operation)
        if step.wait_ms:
            calls = (call("Wait-Start", Milliseconds=literal(step.wait_ms)), *calls)
    return ScriptPiece(
        address=str(step.address),
        action=step.title,
        read=_reader(step),
        before={**step.before, **(_FREE if names_pending else {})},
        after={**step.after, **(NO_EMPTY_KEYS if isinstance(operation, _CLEARING) else {})},
        calls=calls,
        joins=isinstance(operation, _JOINING) and step.wait_ms is None,
    )


def creation_undo_pieces(step: Step, creation: operations.CreatePartition, files: NewFiles) -> tuple[ScriptPiece, ...]:
    """Return the pieces that remove a machine that the same plan made, unless it was changed since, and its disk."""
    path = literal(files.disk(creation)) if creation.image else ""
    machine = replace(
        _piece(step, operations.RemovePartition(partition=creation.partition)),
        read=call(READER, Name=literal(creation.partition), **({"Disk": path} if creation.image else {})),
        before={"exists": True, "added": ""},
    )
    pieces = [machine]
    if creation.image:
        action = f"delete the disk that is a child of {creation.image}"
        pieces.append(_disk_removal_piece(f"{step.address}/disk", action, path, creation.image))
    if creation.vm_path:
        pieces.append(
            ScriptPiece(
                address=f"{step.address}/folder",
                action="remove its empty folders",
                read=call("Get-FolderReading", **_folders(creation, files)),
                before={},
                after={"folders": 0},
                calls=(call("Remove-PartitionFolder", **_folders(creation, files)),),
            )
        )
    return tuple(pieces)


def call(name: str, **parameters: Literal) -> str:
    """Return a call with named parameters; an empty value stands for a switch."""
    return " ".join([name, *(f"-{key} {value}".rstrip() for key, value in parameters.items())])


def _reader(step: Step) -> str:
    at = step.address
    if task := SYSTEM_RESPONSIVENESS if at.responsiveness else at.task:
        return call("Get-TaskClassReading", Task=literal(task))
    if at.machine:
        return call(READER, Machine=literal(at.machine.lower()))
    return call(READER, Name=literal(at.partition))


def capacity_call(step: Step) -> str:
    """Return the call that asks whether the host has the capacity that it promises after this step."""
    claim = step.claim_after
    return call(
        "Test-Capacity",
        Processors=literal(claim.processors - claim.idle),
        Reserve=literal(claim.reserve),
        Memory=literal(claim.memory),
    )


def _machine_calls(operation: operations.MachineOperation) -> tuple[str, ...]:
    vm = {"VM": VM}
    match operation:
        case operations.WriteMark() | operations.EraseMark():
            return (call(_WRITE_MARK),)  # what the step's `After` says of it, which may be nothing
        case operations.StopPartition(grace_ms=grace):
            return (call("Stop-Partition", GraceMs=literal(grace)),)
        case operations.RemovePartition():
            change = call("Hyper-V\\Remove-VM", **vm, Force="")
        case operations.RenamePartition(name=name):
            change = call("Hyper-V\\Rename-VM", **vm, NewName=literal(name))
        case operations.Set(facet=facet, after=after):
            change = _set_call(facet, after)
        case operations.StartPartition():
            change = call("Hyper-V\\Start-VM", **vm)
        case _:
            assert_never(operation)
    return (change,)


def task_value_calls(task: str, values: Mapping[str, RegistryValue]) -> tuple[str, ...]:
    """Return the calls that write these values of a task class, by name."""
    return tuple(
        call(
            "Write-TaskValue",
            Task=literal(task),
            Name=literal(name),
            Type=literal(_TYPES[registry_value.kind]),
            Value=literal(registry_value.data),
        )
        for name, registry_value in sorted(values.items())
    )


def _task_calls(step: Step, operation: operations.TaskOperation) -> tuple[str, ...]:
    task = {"Task": literal(operation.task)}
    match operation:
        case operations.WriteTaskClass(values=values):
            wanted = {name.lower() for name in values}
            unwanted = sorted(name.removeprefix(VALUE) for name in step.before if name.startswith(VALUE))
            gone = [
                call("Remove-TaskValue", **task, Name=literal(name)) for name in unwanted if name.lower() not in wanted
            ]
            return (*task_value_calls(operation.task, values), *gone)
        case operations.RemoveTaskClass() if operation.task == SYSTEM_RESPONSIVENESS:
            return (call("Remove-TaskValue", **task, Name=literal(operation.task)),)
        case operations.RemoveTaskClass():
            return (call("Remove-TaskClass", **task),)
        case operations.WriteTaskRecord(record=record):
            before = literal(canonical(_plain(record.before)))
            own = {"Application": literal(record.application), "Robot": literal(record.robot)}
            return (call("Write-TaskRecord", **task, **own, Digest=literal(record.set), Before=before),)
        case operations.EraseTaskRecord(application=application):
            return (call("Remove-TaskRecord", **task, Application=literal(application)),)
        case _:
            assert_never(operation)


def _plain(values: Mapping[str, object] | None) -> object:
    return None if values is None else {name: encode(value) for name, value in values.items()}


def _creation_pieces(step: Step, creation: operations.CreatePartition, files: NewFiles) -> tuple[ScriptPiece, ...]:
    """Return the machine, its disk, and what Hyper-V gives it by itself."""
    address, read = str(step.address), _reader(step)

    def piece(action: str, before: Mapping[str, Reading], after: Mapping[str, Reading], call: str) -> ScriptPiece:
        before, after = {"exists": True, **before}, {"exists": True, **after}
        return ScriptPiece(
            address=address, action=action, read=read, before=before, after=after, calls=(call,), joins=True
        )

    made = [
        replace(piece(step.title, {**step.before, **_FREE}, step.after, _new_machine(creation, files)), joins=False)
    ]
    if creation.image:
        disk = literal(files.disk(creation))
        attach = call("Hyper-V\\Add-VMHardDiskDrive", VM=VM, Path=disk)
        made += [
            _new_disk(f"{address}/disk", creation, disk),
            piece("attach the disk", {"disks": 0}, {"disks": 1}, attach),
        ]
    # Whether a new machine's memory is static is the host's affair: a client's is dynamic.
    static: Readings = {"dynamic_memory": False, "memory": creation.memory}
    made.append(piece(f"memory static, {write_bytes(creation.memory)}", {}, static, _set_call(Facet.MEMORY, static)))
    if not creation.switch:
        removal = call("Hyper-V\\Remove-VMNetworkAdapter", VM=VM)  # Hyper-V gives one to every new machine
        made.append(piece("remove its network adapter", {"adapters": 1}, {"adapters": 0}, removal))
    if creation.generation == 2 and (creation.image or creation.secure_boot):
        made.append(piece(*_firmware(creation)))
    if creation.vm_path:
        made.append(piece("its own folder", {}, {}, call("Move-NewPartition", **_folders(creation, files))))
    return tuple(made)


def _folders(creation: operations.CreatePartition, files: NewFiles) -> dict[str, Literal]:
    """Return the folders of the pending name and of the final one."""
    names = {"From": files.pending_name(creation), "To": creation.partition}
    return {parameter: literal(operations.partition_folder(creation, name)) for parameter, name in names.items()}


def _firmware(creation: operations.CreatePartition) -> tuple[str, Readings, Readings, str]:
    """Set the disk as first boot device: a machine made without one tries its network adapter first (windows.md 3)."""
    after: Readings = {"secure_boot": creation.secure_boot} if creation.secure_boot else {}
    actions = [f"secure boot {creation.secure_boot}"] if creation.secure_boot else []
    if creation.image:
        after = {**after, "boots_from": "drive"}
        actions.insert(0, "boot from the disk")
    return ", ".join(actions), {}, after, _set_call(Facet.FIRMWARE, after)


def _set_call(facet: Facet, values: Readings) -> str:
    row = FACETS[facet]
    parameters: dict[str, Literal] = {}
    for name, parameter in row.parameters.items():
        if name in values:
            parameters |= _FORMS.get(name, _plain_parameter)(parameter, values[name])
    return call(f"Hyper-V{SLASH}{row.cmdlet}", VM=VM, **parameters)


def _plain_parameter(parameter: str, value: Reading) -> dict[str, Literal]:
    """Return a parameter with its value; an enumeration of Hyper-V has our word without underscores."""
    given = "".join(word.title() for word in value.split("_")) if isinstance(value, str) else value
    return {parameter: literal(given)}


def _secure_boot(parameter: str, template: Reading) -> dict[str, Literal]:
    if template == SECURE_BOOT_OFF:
        return {"EnableSecureBoot": literal("Off")}
    return {"EnableSecureBoot": literal("On"), parameter: literal(template)}


def _only_disk(parameter: str, _: Reading) -> dict[str, Literal]:
    return {parameter: f"({call('Hyper-V' + SLASH + 'Get-VMHardDiskDrive', VM=VM)})"}


_FORMS: Mapping[str, Callable[[str, Reading], dict[str, Literal]]] = {
    "secure_boot": _secure_boot,
    "boots_from": _only_disk,
}
"""How a value is written that takes more than its parameter with a literal."""


def _new_machine(creation: operations.CreatePartition, files: NewFiles) -> str:
    new = {
        "Name": literal(files.pending_name(creation)),
        "Generation": literal(creation.generation),
        "MemoryStartupBytes": literal(creation.memory),
        "NoVHD": "",
    }
    new |= {"SwitchName": literal(creation.switch)} if creation.switch else {}
    new |= {"Path": literal(creation.vm_path)} if creation.vm_path else {}
    return call("Hyper-V\\New-VM", **new)


def _new_disk(address: str, creation: operations.CreatePartition, path: str) -> ScriptPiece:
    """Return the piece that makes the differencing child of an image in the machine's final folder."""
    parent = literal(creation.image)
    folder = literal(operations.partition_folder(creation, creation.partition)) if creation.vm_path else ""
    return ScriptPiece(
        address=address,
        action=f"create a disk that is a child of {creation.image}",
        read=call("Get-DiskReading", Path=path, Parent=parent),
        before={"exists": False},
        after={"exists": True, "child": True},
        calls=(
            *((call("Add-Folder", Path=folder),) if folder else ()),
            call("Hyper-V\\New-VHD", Path=path, ParentPath=parent, Differencing=""),
        ),
    )
