"""What an operation makes of a simulated host's content. Pure: what is refused was refused before (rules.py)."""

from collections.abc import Mapping
from dataclasses import replace
from typing import assert_never

from rarms_iac.diff.readings import disk_readings
from rarms_iac.model.changes import SLASH, Address
from rarms_iac.model.mmcss import SYSTEM_RESPONSIVENESS
from rarms_iac.model.operations import (
    CreatePartition,
    EraseMark,
    EraseResponsiveness,
    EraseResponsivenessRecord,
    EraseTaskRecord,
    Operation,
    PartitionOperation,
    RemoveDisk,
    RemovePartition,
    RemoveTaskClass,
    RenamePartition,
    ResponsivenessOperation,
    SetActions,
    SetCpu,
    SetMemory,
    SetProcessors,
    StartPartition,
    StopPartition,
    TaskOperation,
    WriteMark,
    WriteResponsiveness,
    WriteResponsivenessRecord,
    WriteTaskClass,
    WriteTaskRecord,
    disk_file,
)
from rarms_iac.model.plan import Scope
from rarms_iac.model.state import (
    Checkpoints,
    Disk,
    DiskKind,
    PartitionSettings,
    RegistryValue,
    RunState,
    StartAction,
    StopAction,
    ValueKind,
)
from rarms_iac.providers.marks import erase_mark, mark_for, write_mark
from rarms_iac.providers.simulated.content import Content, Registry, SimulatedMachine, next_id
from rarms_iac.providers.simulated.rules import Refusal

LONGEST_KEY = 255
"""Characters of a registry key's name (FACTS 6.1)."""


def address_of(operation: Operation) -> Address:
    """What the operation is about, as faults name it."""
    match operation:
        case WriteTaskClass() | RemoveTaskClass() | WriteTaskRecord() | EraseTaskRecord():
            return Address(partition=operation.inside, task=operation.task)
        case WriteResponsiveness() | EraseResponsiveness() | WriteResponsivenessRecord() | EraseResponsivenessRecord():
            return Address(responsiveness=True)
        case CreatePartition():
            return Address(partition=operation.partition)
        case RemoveDisk():
            return Address(partition=operation.partition, disk=operation.path)
        case _:
            return Address(partition=operation.partition, machine=operation.machine)


def new_settings(operation: CreatePartition, scope: Scope) -> PartitionSettings:
    """A new machine, off, without reserve, under its pending name; the rest as Hyper-V makes it."""
    return PartitionSettings(
        name=scope.pending(operation.partition),
        generation=operation.generation,
        processors=1,
        reserve=0,
        limit=100,
        weight=100,
        memory=operation.memory,
        dynamic_memory=False,
        start_action=StartAction.START_IF_RUNNING,
        stop_action=StopAction.SAVE,
        checkpoints=Checkpoints.PRODUCTION,
        running=False,
    )


def with_new_machine(content: Content, settings: PartitionSettings) -> Content:
    """With one machine more."""
    machine = SimulatedMachine(id=next_id(content, settings.name), settings=settings, state=RunState.OFF)
    return replace(content, made=content.made + 1).with_machine(machine)


def with_new_disk(content: Content, machine: str, operation: CreatePartition, folder: str, scope: Scope) -> Content:
    """With the disk of a machine that grows out of an image."""
    path = f"{(operation.vm_path or folder).rstrip(SLASH)}{SLASH}{disk_file(operation, scope.plan)}"
    disk = Disk(path=path, kind=DiskKind.DIFFERENCING, parent=operation.image, machine=machine)
    return content.with_disk(disk)


def refuse_disk_removal(content: Content, operation: RemoveDisk) -> Refusal | None:
    """Why this disk cannot be deleted, None where it can."""
    live = disk_readings(content.disks, operation.path)
    if not live["exists"]:
        return Refusal(message=f"there is no disk {operation.path}", advice="look at the host again: rarms plan")
    if live["used"]:
        return Refusal(message=f"{operation.path} is in use", advice="remove what has it first")
    return None


def change_machine(content: Content, machine: SimulatedMachine, operation: PartitionOperation) -> Content:
    """The content after the operation on this machine."""
    settings = machine.settings
    match operation:
        case CreatePartition():
            raise AssertionError("a machine that exists is not made again")
        case RemovePartition():
            return content.without_machine(machine.id)
        case RenamePartition(name=name):
            changed = replace(machine, settings=replace(settings, name=name))
        case WriteMark(application=application, name=name, set=settings_digest, stopped_by=stopped_by):
            mark = mark_for(machine.id, application, name, settings_digest, stopped_by)
            changed = replace(machine, notes=write_mark(machine.notes, mark))
        case EraseMark():
            changed = replace(machine, notes=erase_mark(machine.notes))
        case SetProcessors(processors=processors):
            changed = replace(machine, settings=replace(settings, processors=processors))
        case SetCpu(reserve=reserve, limit=limit, weight=weight):
            changed = replace(machine, settings=replace(settings, reserve=reserve, limit=limit, weight=weight))
        case SetMemory(memory=memory, dynamic=dynamic):
            changed = replace(machine, settings=replace(settings, memory=memory, dynamic_memory=dynamic))
        case SetActions(start=start, stop=stop, checkpoints=checkpoints):
            actions = replace(settings, start_action=start, stop_action=stop, checkpoints=checkpoints)
            changed = replace(machine, settings=actions)
        case StartPartition():
            changed = machine.now(RunState.RUNNING)
        case StopPartition():
            changed = machine.now(RunState.OFF)
        case _:
            assert_never(operation)
    return content.with_machine(changed)


def refuse_task_change(registry: Registry, operation: TaskOperation) -> Refusal | None:
    """Why this cannot be done to the registry, None where it can."""
    key, record = _key(registry, operation.task), registry.records.get(operation.task.lower())
    match operation:
        case WriteTaskClass(task=task, values=values):
            problem = _impossible_key(task) or _impossible_values(values)
            return Refusal(message=f"task class {task!r}: {problem}", advice="correct it") if problem else None
        case RemoveTaskClass(task=task) if key is None:
            return Refusal(message=f"there is no task class {task}", advice="look at the host again: rarms plan")
        case WriteTaskRecord(task=task, record=wanted) if record and record.application != wanted.application:
            return _belongs_to(task, record.application)
        case EraseTaskRecord(task=task, application=application) if record and record.application != application:
            return _belongs_to(task, record.application)
        case _:
            return None


def change_registry(registry: Registry, operation: TaskOperation) -> Registry:
    """The registry after the operation. A key that exists keeps the case of its name."""
    key = _key(registry, operation.task) or operation.task
    record = operation.task.lower()
    match operation:
        case WriteTaskClass(values=values):
            return replace(registry, tasks={**registry.tasks, key: dict(values)})
        case RemoveTaskClass():
            return replace(registry, tasks={name: values for name, values in registry.tasks.items() if name != key})
        case WriteTaskRecord(record=wanted):
            return replace(registry, records={**registry.records, record: wanted})
        case EraseTaskRecord():
            return replace(
                registry, records={name: known for name, known in registry.records.items() if name != record}
            )
        case _:
            assert_never(operation)


def refuse_responsiveness_change(registry: Registry, operation: ResponsivenessOperation) -> Refusal | None:
    """Why this cannot be done to the registry, None where it can."""
    there = registry.responsiveness
    match operation:
        case WriteResponsiveness(value=value):
            problem = _impossible_values({SYSTEM_RESPONSIVENESS: value})
            return Refusal(message=problem, advice="correct it") if problem else None
        case EraseResponsiveness() if there.value is None:
            return Refusal(message=f"there is no {SYSTEM_RESPONSIVENESS}", advice="look at the host again: rarms plan")
        case WriteResponsivenessRecord(record=wanted):
            asks = wanted.application
        case EraseResponsivenessRecord(application=application):
            asks = application
        case _:
            return None
    if there.record is None or there.record.application == asks:
        return None
    message = f"{SYSTEM_RESPONSIVENESS} belongs to the application {there.record.application}"
    return Refusal(message=message, advice="set it in one of the two manifests")


def change_responsiveness(registry: Registry, operation: ResponsivenessOperation) -> Registry:
    """The registry after the operation."""
    there = registry.responsiveness
    match operation:
        case WriteResponsiveness(value=value):
            changed = replace(there, value=value)
        case EraseResponsiveness():
            changed = replace(there, value=None)
        case WriteResponsivenessRecord(record=record):
            changed = replace(there, record=record)
        case EraseResponsivenessRecord():
            changed = replace(there, record=None)
        case _:
            assert_never(operation)
    return replace(registry, responsiveness=changed)


def _key(registry: Registry, task: str) -> str | None:
    wanted = task.lower()
    return next((name for name in registry.tasks if name.lower() == wanted), None)


def _belongs_to(task: str, application: str) -> Refusal:
    return Refusal(
        message=f"the task class {task} belongs to the application {application}",
        advice="use another class, or release it there",
    )


def _impossible_key(task: str) -> str:
    if not task or len(task) > LONGEST_KEY or not task.isprintable() or "\\" in task or "/" in task:
        return f"a key's name has 1 to {LONGEST_KEY} printable characters and no slash"
    return ""


def _impossible_values(values: Mapping[str, RegistryValue]) -> str:
    if len({name.lower() for name in values}) != len(values):
        return "two values differ only by case"
    for name, value in values.items():
        if value.kind is ValueKind.DWORD and not (isinstance(value.data, int) and 0 <= value.data < 2**32):
            return f"{name} is no 32-bit number"
        if value.kind is ValueKind.SZ and not isinstance(value.data, str):
            return f"{name} is no text"
    return ""
