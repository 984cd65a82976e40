"""A change as steps: one operation each, guarded by what is read before and after, with its undo."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import assert_never

from rarms_iac.diff.disruption import disruption_of_task
from rarms_iac.diff.partition_steps import (
    adopt_partition,
    create_partition,
    release_partition,
    remove_partition,
    rename_mark,
    update_partition,
)
from rarms_iac.diff.readings import record_readings, values_readings
from rarms_iac.diff.step_context import NO_CLAIM, StepContext
from rarms_iac.model.changes import Address, Adopt, Change, Create, Delete, Reason, Release, Update
from rarms_iac.model.mmcss import SYSTEM_RESPONSIVENESS
from rarms_iac.model.names import BETWEEN
from rarms_iac.model.operation_effects import reverse_task, values_operation
from rarms_iac.model.operations import (
    EraseTaskRecord,
    Operation,
    RemoveTaskClass,
    TaskOperation,
    WriteMark,
    WriteTaskClass,
    WriteTaskRecord,
)
from rarms_iac.model.plan import Step, Undo, UndoLevel
from rarms_iac.model.state import Partition, RegistryValue, Responsiveness, TaskClass
from rarms_iac.texts.plans import operation_text


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedChange:
    """A change with its steps, in the order that the change itself needs."""

    change: Change
    steps: tuple[Step, ...]


def plan_changes(changes: Iterable[Change], context: StepContext) -> tuple[PlannedChange, ...]:
    """Give each change its steps.

    Args:
        context: the host's facts, disks and grace periods.

    Returns:
        The changes with their steps, in the same order; `order.py` decides the order in which they are applied.
    """
    return tuple(PlannedChange(change=change, steps=steps_for(change, context)) for change in changes)


def steps_for(change: Change, context: StepContext) -> tuple[Step, ...]:
    """Find what has to be done for a change, in its own order: what gives something back comes first.

    Args:
        change: a change that `compare` found, or an import or release.
        context: the facts of the host, and what only the making or removal of a partition needs.

    Returns:
        The steps of this change alone; `order` mixes them with those of others.
    """
    return tuple(_steps(change, context))


def _steps(change: Change, context: StepContext) -> Iterator[Step]:
    address, reason = change.address, change.reason
    match change:
        case Create(after=Partition() as after):
            yield from create_partition(address, after, reason, context)
        case Update(before=Partition() as before, after=Partition() as after):
            yield from update_partition(address, before, after, reason, context)
        case Delete(before=Partition() as before):
            yield from remove_partition(address, before, reason, context)
        case Adopt():
            yield from adopt_partition(address, change.before, change.after, reason)
        case Release():
            yield from release_partition(address, change.before, reason)
        case Create():
            assert not isinstance(change.after, Partition)
            yield from write_registry(address, None, change.after, reason)
        case Update():
            assert not isinstance(change.before, Partition), "a partition does not become a task class"
            assert not isinstance(change.after, Partition), "a task class does not become a partition"
            yield from write_registry(address, change.before, change.after, reason)
        case Delete():
            assert not isinstance(change.before, Partition)
            yield from restore_registry(address, change.before, reason)
        case _:
            assert_never(change)


def mark_moves(planned: Sequence[PlannedChange]) -> tuple[tuple[Step, ...], tuple[PlannedChange, ...]]:
    """Take the steps that pass names on out of the changes, because a mark must never stand on two machines.

    Partitions that exchange names: the first by name steps aside, under a name that no manifest can give.

    Args:
        planned: every change of one host with its steps.

    Returns:
        Those steps, in an order in which each name is free when it is taken; and the changes with their other steps.
    """
    moving = {
        name: change
        for change in planned
        if (name := _name_given_up(change)) and change.steps and isinstance(change.steps[0].operation, WriteMark)
    }
    steps: list[Step] = []
    waiting = dict(sorted(moving.items()))
    aside: set[str] = set()
    while waiting:
        free = [name for name, change in waiting.items() if change.change.address.partition not in waiting]
        for name in free:
            change = waiting.pop(name)
            steps += _step_back(change) if name in aside else [change.steps[0]]
        if not free:
            first = min(waiting)
            change = waiting.pop(first)
            steps += _step_aside(change)
            aside.add(first + BETWEEN)
            waiting[first + BETWEEN] = change
    started = {id(change) for change in moving.values()}
    rest = tuple(replace(change, steps=change.steps[1:]) if id(change) in started else change for change in planned)
    return tuple(steps), rest


def _name_given_up(planned: PlannedChange) -> str:
    """Return the name that the change's partition gives up; empty where it keeps its name."""
    match planned.change:
        case Update(before=Partition(mark=mark)) if mark and mark.name != planned.change.address.partition:
            return mark.name
        case _:
            return ""


def _step_aside(planned: PlannedChange) -> list[Step]:
    """Rename from the old name to one between the two."""
    address = planned.change.address
    return list(
        rename_mark(address, _moved_partition(planned), planned.change.reason, between=address.partition + BETWEEN)
    )


def _step_back(planned: PlannedChange) -> list[Step]:
    """Rename from the name between the two to the new one."""
    before, address = _moved_partition(planned), planned.change.address
    assert before.mark is not None
    between = replace(before, mark=replace(before.mark, name=address.partition + BETWEEN))
    return list(rename_mark(address, between, planned.change.reason))


def _moved_partition(planned: PlannedChange) -> Partition:
    assert isinstance(planned.change, Update)
    assert isinstance(planned.change.before, Partition)
    return planned.change.before


Values = Mapping[str, RegistryValue]


def write_registry(
    address: Address, before: TaskClass | Responsiveness | None, after: TaskClass | Responsiveness, reason: Reason
) -> Iterator[Step]:
    """Make the class, or the value, exactly as wanted, and record what was there before rarms.

    Args:
        address: of the class, or of SystemResponsiveness.
        before: as observed; None: nothing is there.
        after: as wanted, with its record.
        reason: shown to the reviewer of every step.

    Yields:
        The record's step first, then that of the values; neither where nothing differs.
    """
    assert after.record is not None, "every class that rarms writes has a record"
    old_values, old_record = (before.values, before.record) if before else ({}, None)
    if after.record != old_record:
        name = _recorded_name(before or after)
        writing = WriteTaskRecord(task=name, inside=address.partition, record=after.record)
        yield _registry_step(address, writing, before, reason)
    if dict(old_values) != dict(after.values):
        operation = values_operation(_registry_name(address), address.partition, after.values)
        yield _registry_step(address, operation, before, reason)


def restore_registry(address: Address, before: TaskClass | Responsiveness, reason: Reason) -> Iterator[Step]:
    """Bring back what was there before rarms, then erase the record of it.

    Args:
        address: of the class, or of SystemResponsiveness.
        before: as observed, with rarms' record.
        reason: shown to the reviewer of every step.

    Yields:
        The values' step where they differ, then that of the record.
    """
    assert before.record is not None, "only managed classes are restored"
    restored = before.record.before or {}
    if isinstance(before, Responsiveness):
        restored = {name: value for name, value in restored.items() if name == SYSTEM_RESPONSIVENESS}
    if dict(before.values) != dict(restored):
        operation = values_operation(_registry_name(address), address.partition, restored)
        yield _registry_step(address, operation, before, reason)
    name, application = _recorded_name(before), before.record.application
    erasing = EraseTaskRecord(task=name, inside=address.partition, application=application)
    yield _registry_step(address, erasing, before, reason)


def _recorded_name(resource: TaskClass | Responsiveness) -> str:
    return resource.name if isinstance(resource, TaskClass) else SYSTEM_RESPONSIVENESS


def _registry_name(address: Address) -> str:
    return SYSTEM_RESPONSIVENESS if address.responsiveness else address.task


def _registry_step(
    address: Address, operation: TaskOperation, before: TaskClass | Responsiveness | None, reason: Reason
) -> Step:
    values, record = (before.values, before.record) if before else ({}, None)
    match operation:
        case WriteTaskRecord() | EraseTaskRecord():
            new_record = operation.record if isinstance(operation, WriteTaskRecord) else None
            readings = record_readings(record), record_readings(new_record)
            title = operation_text(operation)
            why = "last, after the values are restored"
            if new_record:
                why = "first, so that the earlier values can be restored"
        case WriteTaskClass() | RemoveTaskClass():
            new_values = operation.values if isinstance(operation, WriteTaskClass) else {}
            readings = values_readings(values), values_readings(new_values)
            title = _title(operation, values, new_values)
            why = "it takes effect when the guest's Windows restarts"
            if address.responsiveness:
                why = "it takes effect when the host restarts"
        case _:
            assert_never(operation)
    return Step(
        address=address,
        title=title,
        operation=operation,
        before=readings[0],
        after=readings[1],
        undo=Undo(level=UndoLevel.FULL, operation=reverse_task(operation, before)),
        disruption=disruption_of_task(address.partition),
        claim_before=NO_CLAIM,
        claim_after=NO_CLAIM,
        comment=why,
        place=reason.place,
    )


def _title(operation: Operation, old: Values, new: Values) -> str:
    if not new:
        return operation_text(operation)
    words = [
        f"{name} {old[name].data} -> {new[name].data}" if name in old else f"{name} {new[name].data}"
        for name in sorted(new)
        if old.get(name) != new[name]
    ]
    return f"set {', '.join(words)}" if words else "remove the values that are not in the manifest"
