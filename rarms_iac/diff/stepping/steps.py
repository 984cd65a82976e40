"""A change as steps: one operation each, guarded by what is read before and after, with its undo (DESIGN section 4)."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import assert_never

from rarms_iac.diff.disruption import Surroundings
from rarms_iac.diff.stepping.partitions import (
    create_partition,
    remove_partition,
    take_in,
    take_out,
    update_partition,
)
from rarms_iac.diff.stepping.responsiveness import remove_responsiveness, write_responsiveness
from rarms_iac.diff.stepping.tasks import remove_task, write_task
from rarms_iac.model.changes import Adopt, Change, Create, Delete, Release, Update
from rarms_iac.model.plan import Step
from rarms_iac.model.state import Partition, Responsiveness, TaskClass


@dataclass(frozen=True, slots=True, kw_only=True)
class Planned:
    """A change with its steps, in the order that the change itself needs."""

    change: Change
    steps: tuple[Step, ...]


def planned(changes: Iterable[Change], around: Surroundings) -> tuple[Planned, ...]:
    """Each change with its steps."""
    return tuple(Planned(change=change, steps=steps_for(change, around)) for change in changes)


def steps_for(change: Change, around: Surroundings) -> tuple[Step, ...]:
    """What has to be done for this change, in its own order: what gives something back comes first."""
    return tuple(_steps(change, around))


def _steps(change: Change, around: Surroundings) -> Iterator[Step]:
    match change:
        case Create():
            yield from _create(change, around)
        case Update():
            yield from _update(change, around)
        case Delete():
            yield from _delete(change, around)
        case Adopt():
            yield from take_in(change.address, change.before, change.after, change.reason)
        case Release():
            yield from take_out(change.address, change.before, change.reason)
        case _:
            assert_never(change)


def _create(change: Create, around: Surroundings) -> Iterator[Step]:
    match change.after:
        case Partition() as after:
            yield from create_partition(change.address, after, change.reason, around)
        case TaskClass() as task:
            yield from write_task(change.address, None, task, change.reason)
        case Responsiveness() as one:
            yield from write_responsiveness(None, one, change.reason)
        case _:
            assert_never(change.after)


def _delete(change: Delete, around: Surroundings) -> Iterator[Step]:
    match change.before:
        case Partition() as before:
            yield from remove_partition(change.address, before, change.reason, around)
        case TaskClass() as task:
            yield from remove_task(change.address, task, change.reason)
        case Responsiveness() as one:
            yield from remove_responsiveness(one, change.reason)
        case _:
            assert_never(change.before)


def _update(change: Update, around: Surroundings) -> Iterator[Step]:
    match change.before, change.after:
        case Partition() as before, Partition() as after:
            yield from update_partition(change.address, before, after, change.reason, around)
        case TaskClass() as old, TaskClass() as task:
            yield from write_task(change.address, old, task, change.reason)
        case Responsiveness() as there, Responsiveness() as wanted:
            yield from write_responsiveness(there, wanted, change.reason)
        case _:
            raise AssertionError("a partition does not become a task class")
