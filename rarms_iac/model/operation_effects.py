"""The effect of an operation on a partition, and the operation that undoes it.

Begin at `applied`, for settings, and `reverse`, given what was there before.
"""

from collections.abc import Mapping
from dataclasses import replace
from math import ceil
from typing import assert_never

from rarms_iac.model.facets import with_values
from rarms_iac.model.operations import (
    EraseMark,
    EraseTaskRecord,
    MachineOperation,
    Operation,
    RemovePartition,
    RemoveTaskClass,
    RenamePartition,
    Set,
    StartPartition,
    StopPartition,
    TaskOperation,
    WriteMark,
    WriteTaskClass,
    WriteTaskRecord,
)
from rarms_iac.model.state import (
    Mark,
    Partition,
    PartitionSettings,
    RegistryValue,
    Responsiveness,
    RunState,
    TaskClass,
    TaskRecord,
)
from rarms_iac.model.system import GRACE


def mark_operation(mark: Mark | None, partition: str, machine: str) -> WriteMark | EraseMark:
    """Write this mark on a machine; without one, erase the mark that it has."""
    if mark is None:
        return EraseMark(partition=partition, machine=machine)
    return WriteMark(
        partition=partition,
        application=mark.application,
        name=mark.name,
        set=mark.set,
        stopped_by=mark.stopped_by,
        robot=mark.robot,
        protected=mark.protected,
        machine=machine,
    )


def applied(settings: PartitionSettings, operation: MachineOperation) -> PartitionSettings:
    """Return a partition's settings after an operation.

    Args:
        operation: one that the host accepts.

    Returns:
        The settings after it; one that is about something else leaves them as they are.
    """
    match operation:
        case RenamePartition(name=name):
            return replace(settings, name=name)
        case Set(after=after):
            return with_values(settings, after)
        case StartPartition() | StopPartition():
            return replace(settings, running=isinstance(operation, StartPartition))
        case RemovePartition() | WriteMark() | EraseMark():
            return settings
        case _:
            assert_never(operation)


def partition_after(partition: Partition, operation: MachineOperation) -> Partition:
    """Return a machine after an operation on it that leaves it there: its settings, its state and its mark.

    Args:
        operation: one that the host accepts.

    Returns:
        The machine after it.
    """
    after = replace(partition, settings=applied(partition.settings, operation))
    match operation:
        case WriteMark():
            return replace(after, mark=operation.mark(partition.id))
        case EraseMark():
            return replace(after, mark=None)
        case StartPartition():
            return replace(after, state=RunState.RUNNING)
        case StopPartition():
            return replace(after, state=RunState.OFF)
        case _:
            return after


def reverse(operation: MachineOperation, before: Partition, *, grace_ms: int = ceil(GRACE)) -> Operation | None:
    """Return the operation that undoes this one, given the machine that was there before.

    Args:
        before: the machine before the operation.
        grace_ms: how long its guest may take to shut down, if the undo stops it.

    Returns:
        None if nothing undoes it: a machine is not made again, and one that was stopped while it was paused is
        not so again.
    """
    settings, partition, machine = before.settings, operation.partition, operation.machine
    match operation:
        case RenamePartition():
            return replace(operation, name=settings.name)
        case Set():
            return operation.reversed
        case WriteMark() | EraseMark():
            return mark_operation(before.mark, partition, machine)
        case StartPartition():
            return StopPartition(partition=partition, grace_ms=grace_ms, machine=machine)
        case StopPartition():
            return StartPartition(partition=partition, machine=machine) if settings.running else None
        case RemovePartition():
            return None
        case _:
            assert_never(operation)


def reverse_task(operation: TaskOperation, before: TaskClass | Responsiveness | None) -> TaskOperation:
    """Return the operation that undoes this one, given the task class, or SystemResponsiveness, before it.

    Args:
        before: as it was; None: nothing was there.

    Returns:
        One that brings back the values, or rarms' record, that were there.
    """
    task, inside = operation.task, operation.inside
    values, record = (before.values, before.record) if before else ({}, None)
    match operation:
        case WriteTaskClass() | RemoveTaskClass():
            return values_operation(task, inside, values)
        case WriteTaskRecord(record=TaskRecord(application=application)) | EraseTaskRecord(application=application):
            if record is None:
                return EraseTaskRecord(task=task, inside=inside, application=application)
            return WriteTaskRecord(task=task, inside=inside, record=record)
        case _:
            assert_never(operation)


def values_operation(task: str, inside: str, values: Mapping[str, RegistryValue]) -> WriteTaskClass | RemoveTaskClass:
    """Make a task class, or SystemResponsiveness, exactly these values; without values, remove it."""
    if not values:
        return RemoveTaskClass(task=task, inside=inside)
    return WriteTaskClass(task=task, inside=inside, values=dict(values))
