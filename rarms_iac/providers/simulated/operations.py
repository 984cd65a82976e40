"""Operations on a simulated host's content. Pure: what is refused was refused before (rules.py)."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar, assert_never

from rarms_iac.diff.readings import disk_readings
from rarms_iac.model import operations
from rarms_iac.model.changes import RESPONSIVENESS, Address
from rarms_iac.model.commands import PLAN, prose
from rarms_iac.model.mmcss import SYSTEM_RESPONSIVENESS
from rarms_iac.model.operation_effects import applied
from rarms_iac.model.plan import Scope
from rarms_iac.model.state import (
    Checkpoints,
    Disk,
    DiskKind,
    PartitionSettings,
    RegistryValue,
    Responsiveness,
    RunState,
    StartAction,
    StopAction,
    TaskRecord,
    ValueKind,
)
from rarms_iac.providers.marks import erase_mark, write_mark
from rarms_iac.providers.simulated.content import FRESH, Content, Registry, SimulatedMachine, Values, next_id
from rarms_iac.providers.simulated.refusals import Refusal

T = TypeVar("T")

LONGEST_KEY = 255
"""Characters of a registry key's name (windows.md 6.1)."""


def address_of(operation: operations.Operation) -> Address:
    """The address of what the operation changes, as faults name it."""
    match operation:
        case operations.CreatePartition() | operations.RestorePartition():
            return Address(partition=operation.partition)
        case operations.RemoveDisk():
            return Address(partition=operation.partition, disk=operation.path)
        case _ if isinstance(operation, operations.TaskOperation):
            if operation.task == SYSTEM_RESPONSIVENESS:
                return RESPONSIVENESS
            return Address(partition=operation.inside, task=operation.task)
        case _:
            return Address(partition=operation.partition, machine=operation.machine)


def new_settings(operation: operations.CreatePartition, scope: Scope) -> PartitionSettings:
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
        secure_boot=(operation.secure_boot or "MicrosoftWindows") if operation.generation == 2 else None,
    )


def with_new_machine(content: Content, settings: PartitionSettings) -> Content:
    """The content with one machine more."""
    machine = SimulatedMachine(id=next_id(content, settings.name), settings=settings, state=RunState.OFF)
    return replace(content, made=content.made + 1).with_machine(machine)


def with_restored_machine(content: Content, operation: operations.RestorePartition) -> Content:
    """The content with a machine again that was removed: off, and with rarms' task classes in its guest."""
    notes = write_mark(operation.other_notes, operation.mark) if operation.mark else operation.other_notes
    machine = SimulatedMachine(id=operation.machine, settings=operation.settings, state=RunState.OFF, notes=notes)
    if not operation.tasks:
        return content.with_machine(machine)
    registry = replace(
        FRESH,
        tasks={**FRESH.tasks, **{task.name: task.values for task in operation.tasks if task.values}},
        records={task.name.lower(): task.record for task in operation.tasks if task.record},
    )
    return content.with_machine(machine).with_registry(machine.id, registry)


def with_new_disk(
    content: Content, machine: str, operation: operations.CreatePartition, folder: str, scope: Scope
) -> Content:
    """The content with one disk more, of a machine, which grows out of an image."""
    path = operations.disk_path(operation, scope.plan, folder)
    disk = Disk(path=path, kind=DiskKind.DIFFERENCING, parent=operation.image, machine=machine)
    return content.with_disk(disk)


def refuse_disk_removal(content: Content, operation: operations.RemoveDisk) -> None:
    """Refuse to delete a disk that is not there or in use."""
    live = disk_readings(content.disks, operation.path)
    if not live["exists"]:
        raise Refusal(f"there is no disk {operation.path}", prose("Look at the host again: ", PLAN, "."))
    if live["used"]:
        raise Refusal(f"{operation.path} is in use", "Remove what has it first.")


def change_machine(content: Content, machine: SimulatedMachine, operation: operations.MachineOperation) -> Content:
    """The content after the operation on this machine."""
    match operation:
        case operations.RemovePartition():
            return content.without_machine(machine.id)
        case operations.WriteMark():
            changed = replace(machine, notes=write_mark(machine.notes, operation.mark(machine.id)))
        case operations.EraseMark():
            changed = replace(machine, notes=erase_mark(machine.notes))
        case operations.StartPartition():
            changed = machine.now(RunState.RUNNING)
        case operations.StopPartition():
            changed = machine.now(RunState.OFF)
        case _:
            changed = replace(machine, settings=applied(machine.settings, operation))
    return content.with_machine(changed)


def refuse_task_change(registry: Registry, operation: operations.TaskOperation) -> None:
    """Refuse what cannot be done to the registry."""
    task = operation.task
    values, record = _in_registry(registry, task)
    match operation:
        case operations.WriteTaskClass(values=wanted):
            if problem := _impossible_key(task) or _impossible_values(wanted):
                raise Refusal(f"{_described(task)}: {problem}", "Correct it.")
        case operations.RemoveTaskClass() if values is None:
            raise Refusal(f"there is no {_described(task)}", prose("Look at the host again: ", PLAN, "."))
        case operations.WriteTaskRecord(record=TaskRecord(application=application)):
            _refuse_record_of_others(task, record, application)
        case operations.EraseTaskRecord(application=application):
            _refuse_record_of_others(task, record, application)
        case _:
            pass


def change_registry(registry: Registry, operation: operations.TaskOperation) -> Registry:
    """The registry after the operation. A key that exists keeps the case of its name."""
    values, record = _in_registry(registry, operation.task)
    match operation:
        case operations.WriteTaskClass(values=wanted):
            values = dict(wanted)
        case operations.RemoveTaskClass():
            values = None
        case operations.WriteTaskRecord(record=wanted):
            record = wanted
        case operations.EraseTaskRecord():
            record = None
        case _:
            assert_never(operation)
    if operation.task == SYSTEM_RESPONSIVENESS:
        changed = Responsiveness(value=(values or {}).get(SYSTEM_RESPONSIVENESS), record=record)
        return replace(registry, responsiveness=changed)
    key = _key(registry, operation.task) or operation.task
    return replace(
        registry,
        tasks=_with_entry(registry.tasks, key, values),
        records=_with_entry(registry.records, operation.task.lower(), record),
    )


def _in_registry(registry: Registry, task: str) -> tuple[Values | None, TaskRecord | None]:
    """The values of a task class or of SystemResponsiveness, None where there is no key, and our record of it."""
    if task == SYSTEM_RESPONSIVENESS:
        return registry.responsiveness.values or None, registry.responsiveness.record
    key = _key(registry, task)
    return None if key is None else registry.tasks[key], registry.records.get(task.lower())


def _with_entry(entries: Mapping[str, T], name: str, entry: T | None) -> Mapping[str, T]:
    others = {known: value for known, value in entries.items() if known != name}
    return others if entry is None else {**others, name: entry}


def _key(registry: Registry, task: str) -> str | None:
    wanted = task.lower()
    return next((name for name in registry.tasks if name.lower() == wanted), None)


def _described(task: str) -> str:
    return task if task == SYSTEM_RESPONSIVENESS else f"task class {task}"


def _refuse_record_of_others(task: str, record: TaskRecord | None, application: str) -> None:
    if record is not None and record.application != application:
        raise Refusal(
            f"{_described(task)} belongs to the application {record.application}",
            "Take it out of one of the two manifests.",
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
