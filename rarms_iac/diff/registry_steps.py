"""The steps of a task class's change and of SystemResponsiveness.

The record is written first and erased last, so that what was there before is never forgotten.
"""

from collections.abc import Iterator, Mapping

from rarms_iac.diff.claims import NO_CLAIM
from rarms_iac.diff.disruption import disruption_of_task
from rarms_iac.diff.readings import record_readings, values_readings
from rarms_iac.model.changes import Address, Reason
from rarms_iac.model.mmcss import SYSTEM_RESPONSIVENESS
from rarms_iac.model.operations import EraseTaskRecord, Operation, RemoveTaskClass, WriteTaskClass, WriteTaskRecord
from rarms_iac.model.plan import Readings, Step, Undo, UndoLevel
from rarms_iac.model.state import RegistryValue, Responsiveness, TaskClass, TaskRecord

Values = Mapping[str, RegistryValue]


def write_registry(
    address: Address, before: TaskClass | Responsiveness | None, after: TaskClass | Responsiveness, reason: Reason
) -> Iterator[Step]:
    """Make the class, or the value, exactly as wanted, and record what was there before rarms.

    Args:
        address: of the class, or of SystemResponsiveness.
        before: as observed; None: nothing is there.
        after: as wanted, with its record.
        reason: told to the reviewer of every step.

    Yields:
        The record's step first, then that of the values; neither where nothing differs.
    """
    assert after.record is not None, "what rarms writes, it records"
    old_values, old_record = (before.values, before.record) if before else ({}, None)
    if after.record != old_record:
        yield _record_step(address, _recorded_name(before or after), old_record, after.record, reason)
    if dict(old_values) != dict(after.values):
        yield _values_step(address, old_values, after.values, reason)


def restore_registry(address: Address, before: TaskClass | Responsiveness, reason: Reason) -> Iterator[Step]:
    """Bring back what was there before rarms, then erase the record of it.

    Args:
        address: of the class, or of SystemResponsiveness.
        before: as observed, with rarms' record.
        reason: told to the reviewer of every step.

    Yields:
        The values' step where they differ, then that of the record.
    """
    assert before.record is not None, "only what is managed is restored"
    restored = before.record.before or {}
    if isinstance(before, Responsiveness):
        restored = {name: value for name, value in restored.items() if name == SYSTEM_RESPONSIVENESS}
    if dict(before.values) != dict(restored):
        yield _values_step(address, before.values, restored, reason)
    yield _record_step(address, _recorded_name(before), before.record, None, reason)


def _recorded_name(resource: TaskClass | Responsiveness) -> str:
    return resource.name if isinstance(resource, TaskClass) else SYSTEM_RESPONSIVENESS


def _record_step(address: Address, name: str, old: TaskRecord | None, new: TaskRecord | None, reason: Reason) -> Step:
    def operation(record: TaskRecord | None, other: TaskRecord | None) -> Operation:
        if record is not None:
            return WriteTaskRecord(task=name, inside=address.partition, record=record)
        assert other is not None
        return EraseTaskRecord(task=name, inside=address.partition, application=other.application)

    why = "first, so that what was there before can be brought back" if new else "last, after what was there is back"
    before, after, forward = record_readings(old), record_readings(new), operation(new, old)
    return _registry_step(address, forward, operation(old, new), before, after, str(forward), reason, why)


def _values_step(address: Address, old: Values, new: Values, reason: Reason) -> Step:
    name = SYSTEM_RESPONSIVENESS if address.responsiveness else address.task

    def operation(values: Values) -> Operation:
        if not values:
            return RemoveTaskClass(task=name, inside=address.partition)
        return WriteTaskClass(task=name, inside=address.partition, values=dict(values))

    why = "threads see it when their Windows starts again"
    if address.responsiveness:
        why = "MMCSS reads it when the host starts again"
    before, after, forward = values_readings(old), values_readings(new), operation(new)
    return _registry_step(address, forward, operation(old), before, after, _title(forward, old, new), reason, why)


def _title(operation: Operation, old: Values, new: Values) -> str:
    if not new:
        return str(operation)
    words = [
        f"{name} {old[name].data} -> {new[name].data}" if name in old else f"{name} {new[name].data}"
        for name in sorted(new)
        if old.get(name) != new[name]
    ]
    return f"set {', '.join(words)}" if words else "remove what is not wanted"


def _registry_step(
    address: Address,
    operation: Operation,
    undo: Operation,
    before: Readings,
    after: Readings,
    title: str,
    reason: Reason,
    why: str,
) -> Step:
    return Step(
        address=address,
        title=title,
        operation=operation,
        before=before,
        after=after,
        undo=Undo(level=UndoLevel.FULL, operation=undo),
        disruption=disruption_of_task(address.partition),
        claim_before=NO_CLAIM,
        claim_after=NO_CLAIM,
        comment=f"{reason.message}; {why}" if reason.message else why,
        place=reason.place,
    )
