"""What is to be measured: components together in P1, with how many processors, and a load in P2, on one host."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from fractions import Fraction

from rarms_iac.model.claims import WHOLE
from rarms_iac.model.host import Host
from rarms_iac.model.loads import Interference, load_parts
from rarms_iac.model.output import OutputText
from rarms_iac.model.quantities import LogicalProcessors, Percent, ReservePercent, in_processors, per_virtual_processor
from rarms_iac.model.run import Run, SampleCount
from rarms_iac.model.setting import EnvironmentSetup
from rarms_iac.model.system import (
    USUAL_WEIGHT,
    Component,
    MeasuringLimits,
    PartitionRequest,
    System,
    TaskRequest,
    Threshold,
    run_of,
)


class ProcessorSource(Enum):
    """The source of the number of a partition's virtual processors."""

    MANIFEST = "manifest"  # `processors` of the partition, or of each of its components
    USED = "used"  # the most that its components were seen to use at once
    MEMBERS = "members"  # those of its components together, at most the host's
    HOST = "host"  # the host's: never measured, or what is used could not be seen


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessorNumber:
    """A number of virtual processors with its source."""

    number: int
    source: ProcessorSource


Used = Callable[[tuple[str, ...]], int | None]
"""The most processors that components, by sorted names, were seen to use at once together; None: that was not seen."""


def never_seen(_names: tuple[str, ...]) -> None:
    """Return a `Used` for nothing measured."""


def together(numbers: Sequence[int], host_lp: int) -> int:
    """Add up the virtual processors of components that share a partition.

    Args:
        numbers: of each of them, at least one.

    Returns:
        Their sum, at most the host's number; never fewer than one of them has.
    """
    return max(*numbers, min(sum(numbers), host_lp))


RARE = 0.01
"""A part of the time with a job under way: threads at once for no longer do not count."""


def most_at_once(times: Mapping[int, float], under_way: float) -> int:
    """Find the most threads that ran, or waited for a processor, at once.

    Args:
        times: how long so many did, by their number, in any unit.
        under_way: how long a job was under way, in the same unit.

    Returns:
        The greatest number that lasted for more than `RARE` of that time together with all above it; at least 1.
    """
    so_long = 0.0
    for threads in sorted(times, reverse=True):
        so_long += times[threads]
        if so_long > RARE * under_way:
            return max(1, threads)
    return 1


def processor_number(
    members: Sequence[Component], requested: int | None, host_lp: int, used: Used = never_seen
) -> ProcessorNumber:
    """Say how many virtual processors a partition has.

    Args:
        members: all of its components, at least one.
        requested: what the manifest says of the partition itself; None: nothing.

    Returns:
        What the manifest fixes, else what its components were seen to use, else the host's number.
    """
    if requested is not None:
        return ProcessorNumber(number=requested, source=ProcessorSource.MANIFEST)
    fixed = [member.processors for member in members if member.processors is not None]
    if len(fixed) == len(members):
        return ProcessorNumber(number=together(fixed, host_lp), source=ProcessorSource.MANIFEST)
    most = used(tuple(sorted(member.name for member in members)))
    if most is not None:
        return ProcessorNumber(number=min(most, host_lp), source=ProcessorSource.USED)
    alone = [member.processors or used((member.name,)) for member in members] if len(members) > 1 else []
    known = [number for number in alone if number is not None]
    if known and len(known) == len(members):
        return ProcessorNumber(number=together(known, host_lp), source=ProcessorSource.MEMBERS)
    return ProcessorNumber(number=host_lp, source=ProcessorSource.HOST)


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """The host's time that a setting may take under one load, of what all loads of a reservation share."""

    most_ms: float = float(MeasuringLimits().setting)
    least_ms: float = 0.0  # however long the loads before it took
    spent_ms: Mapping[ReservePercent, float] = field(default_factory=dict)  # under these, by CR

    def at(self, reserve: ReservePercent) -> float:
        """Return the part of it that the loads before leave at a reservation, in ms."""
        return max(self.least_ms, self.most_ms - self.spent_ms.get(reserve, 0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment(OutputText):
    """One data log's worth of measuring."""

    application: str
    host: Host
    members: tuple[Component, ...]  # by name
    load: Interference
    setup: EnvironmentSetup
    loads: tuple[Interference, ...]  # that share the budget of a setting, its own among them
    tasks: Mapping[str, TaskRequest]  # what the manifest fixes of task classes
    budget: Budget
    slow_job: int  # as of the policy
    precision: Percent  # likewise
    processors_from: ProcessorSource = ProcessorSource.MANIFEST  # those of the setup
    load_parts: int = 1  # the most partitions that P2 is

    def __str__(self) -> str:
        return self.name

    @property
    def name(self) -> str:
        """What people call it: `vision`, `speech+vision`."""
        return "+".join(self.setup.members)

    @property
    def runs(self) -> dict[str, Run]:
        """How each member runs."""
        return {member.name: run_of(member) for member in self.members}

    @property
    def usual_load_parts(self) -> int:
        """The most partitions that its load has where there is memory for them."""
        return load_parts(self.load, self.host.logical_processors)

    @property
    def fixes_processors(self) -> bool:
        """Whether the manifest says how many virtual processors P1 has; otherwise what it uses does."""
        return self.processors_from is ProcessorSource.MANIFEST

    def used(self, seen: int | None) -> int | None:
        """Return the number of processors by which P1 is measured on.

        Args:
            seen: the most that its components were seen to use at once; None: that cannot be seen.

        Returns:
            At most the host's, and of a compound never fewer than its members have; None: it was not seen.
        """
        if seen is None:
            return None
        least = self.setup.processors if self.processors_from is ProcessorSource.MEMBERS else 1
        return max(least, min(seen, self.host.logical_processors))

    @property
    def apts(self) -> dict[str, Mapping[str, Threshold]]:
        """The thresholds by member, then by index."""
        return {member.name: member.apt for member in self.members}

    def with_processors(self, found: ProcessorNumber) -> "Experiment":
        """Return the experiment with another number of virtual processors."""
        setup, limit = self.setup, self.setup.limit
        if limit < WHOLE:
            limit = min(WHOLE, -(-limit * setup.processors // found.number))
        setup = replace(setup, processors=found.number, limit=limit)
        return replace(self, setup=setup, processors_from=found.source)


def experiments_of(
    system: System, host: Host, members: tuple[str, ...], interferences: Sequence[str], samples: int | None = None
) -> tuple[Experiment, ...]:
    """List the experiments with these components together in P1, one a load; the loads share the budget of a setting.

    Args:
        interferences: names of `interference`, each once.
        samples: how many of each component; None: as its `run.until` says.

    Returns:
        In the order of the loads; they differ in nothing else.
    """
    loads = tuple(system.interference[name] for name in interferences)
    experiments = (experiment_of(system, host, members, name) for name in interferences)
    return tuple(
        replace(each, loads=loads, members=tuple(_with_samples(member, samples) for member in each.members))
        for each in experiments
    )


def experiment_of(
    system: System, host: Host, members: tuple[str, ...], interference: str, used: Used = never_seen
) -> Experiment:
    """Return the experiment with these components together in P1; what a partition of just these asks for stands.

    Args:
        used: how many processors components were seen to use at once.

    Returns:
        What is run; nothing is looked at on the host.
    """
    names = tuple(sorted(members))
    components = tuple(system.components[name] for name in names)
    request = _requested_partition(system, names)
    found = processor_number(components, request.processors, host.logical_processors, used)
    processors = found.number
    setup = EnvironmentSetup(
        members=names,
        interference=interference,
        processors=processors,
        memory=int(request.memory if request.memory is not None else sum(component.memory for component in components)),
        limit=_limit(request, components, host, processors),
        weight=min(
            USUAL_WEIGHT,
            request.cpu.weight or max(component.cpu.weight or USUAL_WEIGHT for component in components),
        ),
    )
    return Experiment(
        application=system.application.name,
        host=host,
        members=components,
        load=system.interference[interference],
        loads=(system.interference[interference],),
        setup=setup,
        tasks=system.tasks,
        budget=Budget(most_ms=float(system.policy.measuring.setting)),
        slow_job=system.policy.measuring.slow_job,
        precision=system.policy.measuring.precision,
        processors_from=found.source,
    )


def _with_samples(component: Component, samples: int | None) -> Component:
    if samples is None:
        return component
    return replace(component, run=replace(run_of(component), until=SampleCount(samples=samples)))


def _requested_partition(system: System, names: tuple[str, ...]) -> PartitionRequest:
    """Return the manifest's settings for the partition of just these components."""
    for request in system.partitions.values():
        if tuple(sorted(request.components)) == names:
            return request
    return PartitionRequest(name=names[0], components=names)


def _limit(request: PartitionRequest, components: tuple[Component, ...], host: Host, processors: int) -> int:
    """Return fixed by the manifest, in the provider's grain; open: none, as a cap would falsify what is measured."""
    amounts = (
        [request.cpu.limit] if request.cpu.limit is not None else [component.cpu.limit for component in components]
    )
    total = Fraction(0)
    for amount in amounts:
        if amount is None:
            return 100
        total += in_processors(amount, host.logical_processors)
    return min(100, per_virtual_processor(LogicalProcessors(total), processors))
