"""P1 and P2 on a host: made marked, like every partition, and removed after success, failure, or by the next run.

All of it is operations that a step of a plan may hold, too; whoever calls holds the host's lock.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import MappingProxyType

from rarms_iac.measuring.room import called, is_test_partition
from rarms_iac.model.measurement import P1, P2, EnvironmentSetup
from rarms_iac.model.operations import (
    CreatePartition,
    RemovePartition,
    RenamePartition,
    SetActions,
    SetCpu,
    SetProcessors,
    StartPartition,
    StopPartition,
    WriteMark,
    WriteTaskClass,
)
from rarms_iac.model.plan import Scope
from rarms_iac.model.state import Checkpoints, Partition, RegistryValue, RunState, StartAction, StopAction
from rarms_iac.providers.interface import StepwiseHost

MEASURING = "0" * 12
"""Stands where a plan's id stands in pending names: test partitions belong to no plan."""

NOTHING_SET = "0" * 12
"""The digest in a test partition's mark: no manifest ever wanted it, so it is never as wanted."""

GENERATION = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """What a test partition is made as; its reserve is set for each setting."""

    name: str
    processors: int
    memory: int  # bytes
    limit: int
    weight: int


def shapes_of(setup: EnvironmentSetup, logical_processors: int, load_memory: int) -> tuple[Shape, Shape]:
    """P1 and P2: the load may use all of every logical processor."""
    p1 = Shape(name=P1, processors=setup.processors, memory=setup.memory, limit=setup.limit, weight=setup.weight)
    return p1, load_shape(logical_processors, load_memory)


def load_shape(logical_processors: int, load_memory: int) -> Shape:
    """P2 alone: what keeps an interfering load that was asked for."""
    return Shape(name=P2, processors=logical_processors, memory=load_memory, limit=100, weight=100)


Classes = Mapping[str, Mapping[str, RegistryValue]]
"""Values of task classes, by name."""


@contextmanager
def standing(
    host: StepwiseHost, application: str, shapes: Sequence[Shape], classes: Classes = MappingProxyType({})
) -> Iterator[None]:
    """The test partitions are there and run while the context lasts, and are gone after it, however it ends.

    `classes` are the task classes in the operating system of P1: they go with it.

    Raises:
        HostError: one cannot be made, started or removed.
    """
    try:
        for shape in shapes:
            _make(host, shape, Scope(application=application, plan=MEASURING))
        for name, values in classes.items():
            operation = WriteTaskClass(task=name, inside=P1, values=values)
            host.execute(operation, Scope(application=application, plan=MEASURING))
        yield
    finally:
        remove_test_partitions(host)


def set_reserves(host: StepwiseHost, application: str, shapes: Sequence[Shape], reserves: Mapping[str, int]) -> None:
    """Have each test partition reserve so many per cent; what gives back comes before what takes.

    Raises:
        HostError: the host did not do it.
    """
    now = {
        partition.mark.name: partition.settings.reserve
        for partition in host.observe().of(application).partitions
        if partition.mark
    }
    for shape in sorted(shapes, key=lambda one: (reserves[one.name] - now.get(one.name, 0), one.name)):
        wanted = reserves[shape.name]
        if now.get(shape.name) != wanted:
            cpu = SetCpu(partition=shape.name, reserve=wanted, limit=shape.limit, weight=shape.weight)
            host.execute(cpu, Scope(application=application, plan=MEASURING))


def remove_test_partitions(host: StepwiseHost) -> tuple[str, ...]:
    """Remove every P1 and P2 that is on the host, whoever made it: who holds the lock knows that nobody measures.

    Returns:
        What was removed, by name.

    Raises:
        HostError: one cannot be removed.
    """
    found = [partition for partition in host.observe().partitions if is_test_partition(partition)]
    for one in found:
        _remove(host, one)
    return tuple(sorted(called(partition) for partition in found))


def _make(host: StepwiseHost, shape: Shape, scope: Scope) -> None:
    """In the order in which a plan makes a partition: marked at once, named last."""
    name = shape.name
    for operation in (
        CreatePartition(partition=name, generation=GENERATION, memory=shape.memory),
        WriteMark(partition=name, application=scope.application, name=name, set=NOTHING_SET),
        SetProcessors(partition=name, processors=shape.processors),
        SetCpu(partition=name, reserve=0, limit=shape.limit, weight=shape.weight),
        SetActions(
            partition=name,
            start=StartAction.NOTHING,
            stop=StopAction.TURN_OFF,
            checkpoints=Checkpoints.DISABLED,
        ),
        RenamePartition(partition=name, name=name),
        StartPartition(partition=name),
    ):
        host.execute(operation, scope)


def _remove(host: StepwiseHost, partition: Partition) -> None:
    name = called(partition)
    scope = Scope(application=partition.mark.application if partition.mark else "", plan=MEASURING)
    if partition.state is not RunState.OFF:
        host.execute(StopPartition(partition=name, grace_ms=0, machine=partition.id), scope)
    host.execute(RemovePartition(partition=name, machine=partition.id), scope)
