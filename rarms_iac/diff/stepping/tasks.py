"""The steps of a task class's change: the record first, so that what was there before is never forgotten."""

from collections.abc import Iterator, Mapping

from rarms_iac.diff.claims import NO_CLAIM
from rarms_iac.diff.disruption import disruption_of_task
from rarms_iac.diff.readings import record_readings, values_readings
from rarms_iac.model.changes import Address, Reason
from rarms_iac.model.operations import (
    EraseTaskRecord,
    Operation,
    RemoveTaskClass,
    TaskOperation,
    WriteTaskClass,
    WriteTaskRecord,
)
from rarms_iac.model.plan import Readings, Step, Undo, UndoLevel
from rarms_iac.model.state import RegistryValue, TaskClass, TaskRecord

Values = Mapping[str, RegistryValue]


def write_task(address: Address, before: TaskClass | None, after: TaskClass, reason: Reason) -> Iterator[Step]:
    """Make the class exactly as wanted, and keep what was there before rarms."""
    old = before or TaskClass(name=after.name, inside=after.inside)
    assert after.record is not None, "what rarms writes, it records"
    if after.record != old.record:
        yield _record_step(address, old, after.record, reason)
    if dict(old.values) != dict(after.values):
        yield _values_step(address, old.values, after.values, reason)


def remove_task(address: Address, before: TaskClass, reason: Reason) -> Iterator[Step]:
    """Bring back what was there before rarms, then forget it."""
    record = before.record
    assert record is not None, "only what is ours is removed"
    restored = record.before or {}
    if dict(before.values) != dict(restored):
        yield _values_step(address, before.values, restored, reason)
    yield _record_step(address, before, None, reason)


def _record_step(address: Address, old: TaskClass, new: TaskRecord | None, reason: Reason) -> Step:
    def keep(record: TaskRecord | None, other: TaskRecord | None) -> TaskOperation:
        if record is not None:
            return WriteTaskRecord(task=old.name, inside=old.inside, record=record)
        assert other is not None
        return EraseTaskRecord(task=old.name, inside=old.inside, application=other.application)

    title = "record that it is ours, and what was there" if new else "forget it: it is no longer ours"
    why = "first, so that what was there before can be brought back" if new else "last, after what was there is back"
    return registry_step(
        address,
        keep(new, old.record),
        keep(old.record, new),
        record_readings(old.record),
        record_readings(new),
        title,
        reason,
        why,
    )


def _values_step(address: Address, old: Values, new: Values, reason: Reason) -> Step:
    def write(values: Values) -> TaskOperation:
        if not values:
            return RemoveTaskClass(task=address.task, inside=address.partition)
        return WriteTaskClass(task=address.task, inside=address.partition, values=dict(values))

    words = [
        f"{name} {old[name].data} -> {new[name].data}" if name in old and name in new else f"{name} {new[name].data}"
        for name in sorted(new)
        if old.get(name) != new[name]
    ]
    title = f"set {', '.join(words)}" if words else ("remove the class" if not new else "remove what is not wanted")
    return registry_step(
        address,
        write(new),
        write(old),
        values_readings(old),
        values_readings(new),
        title,
        reason,
        "threads see it when their Windows starts again",
    )


def registry_step(
    address: Address,
    operation: Operation,
    back: Operation,
    before: Readings,
    after: Readings,
    title: str,
    reason: Reason,
    why: str,
) -> Step:
    """A step in the registry of the operating system at this address, all of which an undo takes back."""
    return Step(
        address=address,
        title=title,
        operation=operation,
        before=before,
        after=after,
        undo=Undo(level=UndoLevel.FULL, operation=back),
        disruption=disruption_of_task(address.partition),
        claim_before=NO_CLAIM,
        claim_after=NO_CLAIM,
        comment=f"{reason.says}; {why}" if reason.says else why,
        place=reason.place,
    )
