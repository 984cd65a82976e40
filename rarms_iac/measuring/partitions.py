"""P1 and P2 on a host: what it can give them, and how they are made and removed.

They are marked like every partition, and removed after success, after failure, or by the next run. All of it is
operations that a step of a plan may hold, too; the caller holds the host's lock.
"""

from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fractions import Fraction
from types import MappingProxyType

from rarms_iac.model.capacity import Capacity, capacity_of, fits, packs_by_first_fit, shared_processors
from rarms_iac.model.claims import WHOLE, Claim, load_of
from rarms_iac.model.host import Host, ProviderKind
from rarms_iac.model.loads import Interference, equal_parts
from rarms_iac.model.operations import (
    CreatePartition,
    RemovePartition,
    RenamePartition,
    StartPartition,
    StopPartition,
    WriteMark,
    WriteTaskClass,
    set_to,
)
from rarms_iac.model.plan import Scope
from rarms_iac.model.quantities import LEAST_MEMORY, MEMORY_GRAIN, LogicalProcessors, ReservePercent
from rarms_iac.model.setting import LOAD_PARTITIONS, P1, P2_WEIGHT, EnvironmentSetup, PartitionShape
from rarms_iac.model.state import Checkpoints, Partition, RegistryValue, RunState, StartAction, State, StopAction
from rarms_iac.providers.interface import StepwiseHost
from rarms_iac.providers.measuring import ScriptedMeasuringHost

USUAL_LOAD_MEMORY = 512 * 2**20
"""Bytes that P2 has, as in the paper's Table 1; less where the host has less left."""

_LOAD_PROCESS_MEMORY = 16 * 2**20
"""Bytes for a process of a load; a control group has no operating system of its own, and a load a process for each LP.
"""

_AT_REST = {RunState.OFF, RunState.SAVED}


MEASURING = "0" * 12
"""Stands where a plan's id stands in pending names: test partitions belong to no plan."""

NOTHING_SET = "0" * 12
"""The digest in a test partition's mark: no manifest ever wanted it, so it is never as wanted."""

GENERATION = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuringResources:
    """The resources of a host, and the part of them that is promised already."""

    capacity: Capacity
    claims: tuple[Claim, ...]  # of every machine that counts and is not a test partition
    shared_processors: LogicalProcessors  # that all partitions can use together
    load_memory: int = USUAL_LOAD_MEMORY  # bytes that P2 gets where so many are left
    least_part: int = USUAL_LOAD_MEMORY  # bytes without which P2 has fewer parts

    @property
    def unreserved(self) -> bool:
        """Whether P1 and P2 can have all of every logical processor between them, as CMCPUR takes for granted."""
        whole = self.capacity.processors == self.capacity.logical_processors
        return whole and not any(other.reserve and other.processors for other in self.claims)


def host_resources(host: Host, state: State, application: str) -> MeasuringResources:
    """Add up what this host has to give: partitions of the application count while they run, all claims as always.

    Args:
        application: whose partitions count only while they run.

    Returns:
        Its capacity, and the claims of all machines but test partitions.
    """
    capacity, has_groups = capacity_of(host, state.facts), host.provider is ProviderKind.LINUX
    of_group = LEAST_MEMORY + capacity.logical_processors * _LOAD_PROCESS_MEMORY
    return MeasuringResources(
        capacity=capacity,
        shared_processors=shared_processors(host, capacity.logical_processors),
        claims=tuple(partition.claim for partition in state.partitions if _counts(partition, application)),
        # A control group's memory is a limit that costs nothing, and ten real browsers need more than the usual.
        load_memory=int(host.memory) if has_groups else USUAL_LOAD_MEMORY,
        least_part=of_group if has_groups else USUAL_LOAD_MEMORY,
    )


def other_running_partitions(state: State) -> tuple[Partition, ...]:
    """List what would run with P1 and P2 and change what is measured, by name: every partition that is not off.

    Returns:
        Partitions of anybody, ordered by name.
    """
    running = [partition for partition in state.partitions if not partition.is_test and partition.state not in _AT_REST]
    return tuple(sorted(running, key=lambda partition: (partition.shown_name, partition.id)))


def memory_for_load(resources: MeasuringResources, setup: EnvironmentSetup) -> int:
    """Say how many bytes P2 gets next to P1: the usual, or what is left where that is less.

    Args:
        setup: of P1, whose memory is taken.

    Returns:
        Whole MiB in bytes; negative where P1 alone needs more than there is.
    """
    return free_memory(resources, setup.memory)


def free_memory(resources: MeasuringResources, taken: int = 0, parts: int = 1) -> int:
    """Say how many bytes there are for each part of P2: the usual, or what is left where that is less; whole MiB.

    Args:
        taken: bytes that are promised in addition to its claims.

    Returns:
        Bytes; negative where more is promised than there is.
    """
    free = (resources.capacity.memory - load_of(resources.claims).memory - taken) // parts
    return min(resources.load_memory, free // MEMORY_GRAIN * MEMORY_GRAIN)


def parts_that_fit(resources: MeasuringResources, wanted: int, taken: int = 0) -> int:
    """Say in how many parts P2 can be made: the most of those wanted that all have enough memory, and at least 1.

    Args:
        taken: bytes that are promised in addition to its claims.
    """
    fitting = (parts for parts in range(wanted, 1, -1) if free_memory(resources, taken, parts) >= resources.least_part)
    return next(fitting, 1)


def processors_of_load(
    resources: MeasuringResources, setup: EnvironmentSetup, load: Interference, most_parts: int
) -> tuple[int, ...]:
    """Say how many virtual processors each part of P2 has next to P1.

    P2 has one on every LP, and each reserves the same. So where P1 has fewer, P2 can reserve only what P1 leaves on its
    own LPs, and one more part reserves the rest of the other LPs. Without it P1 would get a share of that rest, which
    other partitions have in a layout.

    Args:
        setup: of P1.
        most_parts: for which there is memory; 1: the P2 of the paper.

    Returns:
        One number for each part.
    """
    wide = resources.capacity.logical_processors
    others = wide - resources.capacity.sharing.claim(setup.processors, WHOLE, setup.memory).processors
    return _parts(wide, others, load, most_parts)


def _parts(wide: int, others: int, load: Interference, most_parts: int) -> tuple[int, ...]:
    """Return the processors of each part; where one is too many, the part for the rest stays."""
    rest = (others,) if others > 0 and most_parts > 1 else ()
    return (*[wide] * min(equal_parts(load), most_parts - len(rest)), *rest)


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadShare:
    """The processor time of P2 while P1 reserves a CR."""

    reserve: int  # per cent of each LP, of all parts that have a processor on every LP
    reserves: Mapping[str, ReservePercent]  # of each part, by its name: per cent of each of its own processors
    processors: Fraction  # LPs that a load takes at least if it never sleeps
    others: Fraction  # LPs of what partitions can use together that P2 does not reserve


def load_share(
    resources: MeasuringResources, setup: EnvironmentSetup, reserve: ReservePercent, parts: Sequence[int]
) -> LoadShare | None:
    """Work out the reservation of P2 and the time that its load takes, while P1 reserves this.

    P2 reserves all the rest of what partitions can use together, 100 - CR on an empty host. Where they may use what is
    kept for the host, it is part of the rest: in service the host may use it. Were it free, P1 would get a share of it
    here, and need more than was measured there. On Linux a limit keeps it from both.

    Args:
        parts: the processors of each part of P2 (`processors_of_load`).

    Returns:
        None: the host cannot give P1 so much.
    """
    if not _can_give(resources, setup, reserve):
        return None
    p1 = resources.capacity.sharing.claim(setup.processors, reserve, setup.memory)
    return share_of_parts(resources, (p1,), memory_for_load(resources, setup), parts)


def _can_give(resources: MeasuringResources, setup: EnvironmentSetup, reserve: ReservePercent) -> bool:
    """Return whether the host can give this reserve to P1, with the memory of P2."""
    p1 = resources.capacity.sharing.claim(setup.processors, reserve, setup.memory)
    p2 = Claim(
        processors=resources.capacity.logical_processors, reserve=0, memory=max(0, memory_for_load(resources, setup))
    )
    return fits(resources.capacity, (*resources.claims, p1, p2))


def share_of_parts(
    resources: MeasuringResources, claims: tuple[Claim, ...], memory: int, parts: Sequence[int]
) -> LoadShare:
    """Reserve all the rest of what partitions can use together for the parts of P2.

    Args:
        claims: in addition to what is promised.
        memory: of P2, in bytes.
        parts: the processors of each part. Those with as many as the first divide what it would reserve; a last one
            with fewer reserves what they leave.
    """
    wide = parts[0]
    p2 = Claim(processors=wide, reserve=0, memory=max(0, memory))
    reserve = _highest_reserve(resources, claims, p2)
    each, left = divmod(reserve, parts.count(wide))
    reserves = [each + left, *[each] * (parts.count(wide) - 1)]
    if parts[-1] < wide:
        rest = Claim(processors=parts[-1], reserve=0, memory=0)
        reserves.append(_highest_reserve(resources, (*claims, replace(p2, reserve=reserve)), rest))
    takes = Fraction(sum(vps * each for vps, each in zip(parts, reserves, strict=True)), WHOLE)
    return LoadShare(
        reserve=reserve,
        reserves=dict(zip(LOAD_PARTITIONS, reserves, strict=False)),
        processors=takes,
        others=resources.shared_processors - takes,
    )


LEAST_REST = 10
"""Per cent of an LP: less is not worth one more part of P2 next to a layout."""


def share_next_to_layout(
    resources: MeasuringResources, load: Interference, memory: int, most_parts: int
) -> tuple[tuple[int, ...], LoadShare]:
    """Work out the parts of P2 and their reservations next to what runs.

    Args:
        resources: of the host, with all that runs.
        memory: of each part, in bytes.
        most_parts: for which there is memory.

    Returns:
        The processors of each part, and what they reserve.
    """
    wide = resources.capacity.logical_processors
    one = share_of_parts(resources, (), memory, (wide,))
    if most_parts == 1:
        return (wide,), one
    taken = (*resources.claims, Claim(processors=wide, reserve=one.reserve, memory=0))

    def rest_of(others: int) -> int:  # by first fit: an exact search for each number takes seconds on many LPs
        rest = Claim(processors=others, reserve=0, memory=0)
        return others * _highest(rest, resources, taken, lambda claims: packs_by_first_fit(claims, resources.capacity))

    others = max(range(1, wide), key=rest_of)
    rest = rest_of(others)
    parts = _parts(wide, others if rest >= LEAST_REST else 0, load, most_parts)
    return parts, share_of_parts(resources, (), memory, parts)


def highest_reserve(resources: MeasuringResources, setup: EnvironmentSetup) -> ReservePercent:
    """Find the highest CR that the host can give to P1; 0 where it can give none.

    Args:
        setup: of P1, with its limit.

    Returns:
        Whole per cent of each of P1's own processors.
    """
    if memory_for_load(resources, setup) < LEAST_MEMORY:
        return 0
    possible = range(min(WHOLE, setup.limit), 0, -1)
    return next((reserve for reserve in possible if _can_give(resources, setup, reserve)), 0)


def _highest_reserve(resources: MeasuringResources, claims: tuple[Claim, ...], wanted: Claim) -> ReservePercent:
    """Return the most that this claim can reserve, in whole per cent of each of its processors; 0: nothing is left."""
    whole = replace(resources.capacity, processors=resources.shared_processors)
    return _highest(wanted, resources, (*resources.claims, *claims), lambda together: fits(whole, together))


def _highest(
    wanted: Claim,
    resources: MeasuringResources,
    taken: tuple[Claim, ...],
    fit: Callable[[tuple[Claim, ...]], bool],
) -> ReservePercent:
    """Return the most that a claim can reserve beside what is taken, by a question that has one answer up to there."""
    most = min(WHOLE, int(WHOLE * resources.shared_processors - load_of(taken).percent) // wanted.processors)
    reserves = range(1, most + 1)
    return bisect_left(reserves, True, key=lambda reserve: not fit((*taken, replace(wanted, reserve=reserve))))


def _counts(partition: Partition, application: str) -> bool:
    if partition.is_test:
        return False
    if partition.mark is not None and partition.mark.application == application:
        return partition.state not in _AT_REST
    return partition.claims_resources


def shapes_of_test_partitions(
    setup: EnvironmentSetup, load_memory: int, parts: Sequence[int]
) -> tuple[PartitionShape, ...]:
    """Shape P1 and P2: the load may use all of every logical processor.

    Args:
        load_memory: of each part of P2, in bytes.
        parts: the virtual processors of each part of P2.

    Returns:
        P1, then the parts of P2.
    """
    p1 = PartitionShape(
        name=P1, processors=setup.processors, memory=setup.memory, limit=setup.limit, weight=setup.weight
    )
    return p1, *load_shapes(load_memory, parts)


def load_shapes(load_memory: int, parts: Sequence[int]) -> tuple[PartitionShape, ...]:
    """Shape P2 alone, for an interfering load that was asked for: it gets what no other claims.

    Args:
        load_memory: of each part, in bytes.
        parts: the virtual processors of each part.

    Returns:
        The parts of P2 without a limit and with the highest weight.
    """
    return tuple(
        PartitionShape(name=name, processors=processors, memory=load_memory, limit=100, weight=P2_WEIGHT)
        for name, processors in zip(LOAD_PARTITIONS, parts, strict=False)
    )


Classes = Mapping[str, Mapping[str, RegistryValue]]
"""Values of task classes, by name."""


@contextmanager
def running_test_partitions(
    host: StepwiseHost | ScriptedMeasuringHost,
    application: str,
    shapes: Sequence[PartitionShape],
    classes: Classes = MappingProxyType({}),
) -> Iterator[None]:
    """Have the test partitions there and running while the context lasts; they are gone after it, however it ends.

    `classes` are the task classes in the operating system of P1: they go with it.

    Args:
        host: its lock is held by who calls.
        application: to which their marks say they belong.
        classes: values of task classes in the operating system of P1, by name; they go with it.

    Yields:
        Nothing, once they run.

    Raises:
        HostError: one cannot be made, started or removed.
    """
    if isinstance(host, ScriptedMeasuringHost):
        with host.test_partitions(shapes):
            yield
        return
    try:
        for shape in shapes:
            _make(host, shape, Scope(application=application, plan=MEASURING))
        for name, values in classes.items():
            operation = WriteTaskClass(task=name, inside=P1, values=values)
            host.execute(operation, Scope(application=application, plan=MEASURING))
        yield
    finally:
        remove_test_partitions(host)


def set_reserves(
    host: StepwiseHost | ScriptedMeasuringHost,
    application: str,
    shapes: Sequence[PartitionShape],
    reserves: Mapping[str, int],
) -> None:
    """Have each test partition reserve so many per cent; what gives back comes before what takes.

    Args:
        host: its lock is held by who calls.
        reserves: per cent of each processor, by the name of a test partition.

    Raises:
        HostError: the host did not do it.
    """
    if isinstance(host, ScriptedMeasuringHost):
        host.set_reserves(reserves)
        return
    now = {
        partition.mark.name: partition.settings.reserve
        for partition in host.observe().of(application).partitions
        if partition.mark
    }
    for shape in sorted(shapes, key=lambda shape: (reserves[shape.name] - now.get(shape.name, 0), shape.name)):
        wanted = reserves[shape.name]
        if now.get(shape.name) != wanted:
            cpu = set_to(shape.name, reserve=wanted, limit=shape.limit, weight=shape.weight)
            host.execute(cpu, Scope(application=application, plan=MEASURING))


def remove_test_partitions(host: StepwiseHost | ScriptedMeasuringHost) -> tuple[str, ...]:
    """Remove every P1 and P2 on the host, made by any run: who holds the lock knows that no run measures.

    Args:
        host: its lock is held by who calls.

    Returns:
        What was removed, by name.

    Raises:
        HostError: one cannot be removed.
    """
    partitions = [partition for partition in host.observe().partitions if partition.is_test]
    if not isinstance(host, ScriptedMeasuringHost):
        for partition in partitions:
            _remove(host, partition)
    elif partitions:
        host.remove_test_partitions()
    return tuple(sorted(partition.shown_name for partition in partitions))


def _make(host: StepwiseHost, shape: PartitionShape, scope: Scope) -> None:
    """Make a partition in the order of a plan: mark it first, name it last."""
    name = shape.name
    for operation in (
        CreatePartition(partition=name, generation=GENERATION, memory=shape.memory),
        WriteMark(partition=name, application=scope.application, name=name, set=NOTHING_SET),
        set_to(name, processors=shape.processors),
        set_to(name, reserve=0, limit=shape.limit, weight=shape.weight),
        set_to(
            name,
            start_action=StartAction.NOTHING,
            stop_action=StopAction.TURN_OFF,
            checkpoints=Checkpoints.DISABLED,
        ),
        RenamePartition(partition=name, name=name),
        StartPartition(partition=name),
    ):
        host.execute(operation, scope)


def _remove(host: StepwiseHost, partition: Partition) -> None:
    name = partition.shown_name
    scope = Scope(application=partition.mark.application if partition.mark else "", plan=MEASURING)
    if partition.state is not RunState.OFF:
        host.execute(StopPartition(partition=name, grace_ms=0, machine=partition.id), scope)
    host.execute(RemovePartition(partition=name, machine=partition.id), scope)
