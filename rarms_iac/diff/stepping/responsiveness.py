"""The steps of SystemResponsiveness: as of a task class, the record first, so that nothing before is forgotten."""

from collections.abc import Iterator

from rarms_iac.diff.readings import record_readings, values_readings
from rarms_iac.diff.stepping.tasks import registry_step
from rarms_iac.model.changes import RESPONSIVENESS, Reason
from rarms_iac.model.mmcss import SYSTEM_RESPONSIVENESS
from rarms_iac.model.operations import (
    EraseResponsiveness,
    EraseResponsivenessRecord,
    ResponsivenessOperation,
    WriteResponsiveness,
    WriteResponsivenessRecord,
)
from rarms_iac.model.plan import Step
from rarms_iac.model.state import RegistryValue, Responsiveness, TaskRecord


def write_responsiveness(before: Responsiveness | None, after: Responsiveness, reason: Reason) -> Iterator[Step]:
    """Set the value, and keep what was there before rarms."""
    old = before or Responsiveness()
    assert after.record is not None, "what rarms writes, it records"
    if after.record != old.record:
        yield _record_step(old.record, after.record, reason)
    if old.value != after.value:
        yield _value_step(old.value, after.value, reason)


def remove_responsiveness(before: Responsiveness, reason: Reason) -> Iterator[Step]:
    """Bring back what was there before rarms, then forget it."""
    assert before.record is not None, "only what is ours is removed"
    restored = (before.record.before or {}).get(SYSTEM_RESPONSIVENESS)
    if before.value != restored:
        yield _value_step(before.value, restored, reason)
    yield _record_step(before.record, None, reason)


def _record_step(old: TaskRecord | None, new: TaskRecord | None, reason: Reason) -> Step:
    def keep(record: TaskRecord | None, other: TaskRecord | None) -> ResponsivenessOperation:
        if record is not None:
            return WriteResponsivenessRecord(record=record)
        assert other is not None
        return EraseResponsivenessRecord(application=other.application)

    return registry_step(
        RESPONSIVENESS,
        keep(new, old),
        keep(old, new),
        record_readings(old),
        record_readings(new),
        "record that it is ours, and what was there" if new else "forget it: it is no longer ours",
        reason,
        "first, so that what was there before can be brought back" if new else "last, after what was there is back",
    )


def _value_step(old: RegistryValue | None, new: RegistryValue | None, reason: Reason) -> Step:
    def write(value: RegistryValue | None) -> ResponsivenessOperation:
        return EraseResponsiveness() if value is None else WriteResponsiveness(value=value)

    if new is None:
        title = "take the value away: there was none before"
    else:
        title = f"set SystemResponsiveness {new.data}" if old is None else f"set {old.data} -> {new.data}"
    return registry_step(
        RESPONSIVENESS,
        write(new),
        write(old),
        values_readings(Responsiveness(value=old).values),
        values_readings(Responsiveness(value=new).values),
        title,
        reason,
        "MMCSS reads it when the host starts again",
    )
