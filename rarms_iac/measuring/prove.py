"""Runs all components together in the layout that is applied, and judges every index beside its threshold."""

from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import assert_never

from rarms_iac.manifest.text.positions import FirstLine
from rarms_iac.measuring.partitions import (
    MeasuringBudget,
    free_memory,
    free_reserve,
    load_shape,
    running_test_partitions,
    set_reserves,
)
from rarms_iac.measuring.performance import MeasuredIndex
from rarms_iac.measuring.sampling import watch
from rarms_iac.measuring.settling import Contender, Settling, wants_all_processors
from rarms_iac.model.loads import Interference
from rarms_iac.model.measurement import P2, SettingEvidence
from rarms_iac.model.outcomes import (
    Estimate,
    Met,
    Missed,
    Overload,
    TooFewSamples,
    TooManyFailures,
    Unsteady,
    Verdict,
    WithinNoise,
)
from rarms_iac.model.output import Internal, output
from rarms_iac.model.quantities import LEAST_MEMORY, Milliseconds
from rarms_iac.model.run import Elapsed, Run, SampleCount
from rarms_iac.model.series import Series
from rarms_iac.model.system import Component, TaskRequest, run_of
from rarms_iac.planner.task_classes import classes_of
from rarms_iac.providers.measuring import MeasuringHost, PartitionShape, PartitionWork, Work
from rarms_iac.statistics.error_probability import ERROR, shared_error
from rarms_iac.statistics.overload import describe_overload
from rarms_iac.statistics.verdicts import judge_each

LONGER = 4
"""So many times as long real processes run once more where the first run did not decide."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AppliedLayout:
    """What runs where on one host."""

    application: str
    host_processors: int  # LPs of the host
    reserved: Fraction  # LPs that the running partitions of the application reserve there
    partitions: Mapping[str, tuple[Component, ...]]  # by name
    reserves: Mapping[str, float] = field(default_factory=dict)  # LPs of each that has a reserve, by name
    on_host: tuple[Component, ...] = ()  # in the host's own operating system
    tasks: Mapping[str, TaskRequest] = field(default_factory=dict)  # what the manifest fixes of task classes
    deadline_periods_us: Mapping[str, int] = field(default_factory=dict)  # of partitions with that mechanism, by name

    @property
    def components(self) -> tuple[Component, ...]:
        """All of them, by name."""
        inside = [member for members in self.partitions.values() for member in members]
        return tuple(sorted((*inside, *self.on_host), key=lambda component: component.name))

    @property
    def judged(self) -> tuple[Component, ...]:
        """Those with thresholds, by name."""
        return tuple(component for component in self.components if component.apt)


@dataclass(frozen=True, slots=True, kw_only=True)
class IndexVerdict:
    """One index of a component in the layout: what was seen beside its threshold, and the verdict on it."""

    measured: MeasuredIndex  # its bounds are the verdict's: wrong, on either side, with the verdict's error
    verdict: Verdict

    @property
    def met(self) -> bool:
        """Whether it was shown to meet its threshold: within the noise or without a steady state it was not."""
        return isinstance(self.verdict, Met)

    @property
    @output
    def error(self) -> float | None:
        """The probability that any verdict on the layout is wrong; None: there is no verdict on this."""
        return ERROR if isinstance(self.verdict, Met | Missed) else None


@dataclass(frozen=True, slots=True, kw_only=True)
class LayoutProof:
    """What a layout showed."""

    host: str
    layout: Internal[AppliedLayout]
    series: Internal[Mapping[str, Series]]  # by component, of those with thresholds
    verdicts: tuple[IndexVerdict, ...]  # every index of every threshold, components by name

    @property
    @output
    def host_lp(self) -> int:
        """LPs that the host has."""
        return self.layout.host_processors

    @property
    @output
    def reserved_lp(self) -> Fraction:
        """LPs that the partitions reserve that ran."""
        return self.layout.reserved

    @property
    @output
    def partitions(self) -> Mapping[str, tuple[str, ...]]:
        """The components of each partition that ran, by name."""
        return {name: tuple(member.name for member in members) for name, members in self.layout.partitions.items()}

    @property
    def is_decided(self) -> bool:
        """Whether every threshold was shown to be met, or to be missed."""
        return all(isinstance(each.verdict, Met | Missed) for each in self.verdicts)

    @property
    def not_met(self) -> tuple[IndexVerdict, ...]:
        """The indexes that were not shown to meet their thresholds."""
        return tuple(verdict for verdict in self.verdicts if not verdict.met)


def with_samples(layout: AppliedLayout, samples: int | None) -> AppliedLayout:
    """Have so many samples of each component taken; None: as each `run.until` says.

    Args:
        layout: what runs where.
        samples: of each component.

    Returns:
        The same layout with other runs.
    """
    return layout if samples is None else _with_ends(layout, lambda _run: SampleCount(samples=samples))


def _with_ends(layout: AppliedLayout, end: Callable[[Run], SampleCount | Elapsed]) -> AppliedLayout:
    """The same layout with other ends of its runs."""

    def changed(components: Iterable[Component]) -> tuple[Component, ...]:
        return tuple(
            replace(component, run=replace(run_of(component), until=end(run_of(component)))) for component in components
        )

    partitions = {name: changed(members) for name, members in layout.partitions.items()}
    return replace(layout, partitions=partitions, on_host=changed(layout.on_host))


def _longer(run: Run) -> SampleCount | Elapsed:
    """The end of a run that goes on `LONGER` times as long."""
    match run.ends:
        case SampleCount(samples=samples):
            return SampleCount(samples=LONGER * samples)
        case Elapsed(time=time):
            return Elapsed(time=Milliseconds(LONGER * time))


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadPartition:
    """P2 beside a layout: a load with all that the host has left, so that what is reserved stays reserved."""

    load: Interference
    shape: PartitionShape
    reserve: int  # per cent of each of its processors


def load_partition(load: Interference, budget: MeasuringBudget) -> LoadPartition | None:
    """Make a partition for a load beside what runs.

    Args:
        load: what runs in it.
        budget: of the host, with all that runs.

    Returns:
        P2; None where the least memory of a partition is not left.
    """
    memory = free_memory(budget)
    if memory < LEAST_MEMORY:
        return None
    shape = load_shape(budget.capacity.logical_processors, memory)
    return LoadPartition(load=load, shape=shape, reserve=free_reserve(budget, memory))


@dataclass(frozen=True, slots=True, kw_only=True)
class ProofConditions:
    """What a layout is run under."""

    beside: LoadPartition | None  # None: there is no load
    seed: int  # of chance, where the host draws it

    @property
    def load(self) -> Interference | None:
        """The interference in P2."""
        return None if self.beside is None else self.beside.load


def prove(
    host: MeasuringHost,
    layout: AppliedLayout,
    conditions: ProofConditions,
    should_stop: Callable[[], bool],
    samples_came: Callable[[Mapping[str, Series]], None],
) -> LayoutProof | TooManyFailures | None:
    """Run everything that is applied, each component as long as its `run.until` says, and judge those with thresholds.

    Where that does not decide on real processes, which wander between processors, they run anew, `LONGER` times longer.

    Args:
        host: Its lock is held by the caller.
        layout: What runs where.
        conditions: What it is run under.
        should_stop: Asked after every sample.
        samples_came: Told now and then what was seen so far.

    Returns:
        None: an end was asked for.

    Raises:
        HostError: the host did not do what was asked.
    """

    def to_its_end(seen: Mapping[str, Series]) -> bool:
        samples_came(seen)
        return False

    def run_once(tried: AppliedLayout) -> tuple[LayoutProof | TooManyFailures | None, SettingEvidence | None]:
        with host.run(_work_of(tried, conditions, settling)) as running:
            series = watch(running, tried.judged, settling, to_its_end, should_stop)
            evidence = running.evidence()
        if series is None or isinstance(series, TooManyFailures):
            return series, evidence
        verdicts = judge_layout(tried.judged, series, is_real=evidence is not None)
        return LayoutProof(host=host.name, layout=tried, series=series, verdicts=verdicts), evidence

    settling = Settling(memory_ms=host.scheduler_memory_ms, contenders=_contenders(layout, conditions.load))
    with ExitStack() as ends:
        if beside := conditions.beside:
            ends.enter_context(running_test_partitions(host, layout.application, (beside.shape,)))
            set_reserves(host, layout.application, (beside.shape,), {P2: beside.reserve})
        proof, evidence = run_once(layout)
        if isinstance(proof, LayoutProof) and not proof.is_decided and evidence is not None:
            proof, _ = run_once(_with_ends(layout, _longer))
    return proof


def _work_of(layout: AppliedLayout, conditions: ProofConditions, settling: Settling) -> Work:
    """All that is applied, each component for as long as its `run.until` says, and the load in P2."""
    partitions = [
        PartitionWork(
            partition=name,
            components=members,
            classes=classes_of(members, layout.tasks, name, FirstLine(file="")).classes,
            deadline_period_us=layout.deadline_periods_us.get(name),
        )
        for name, members in sorted(layout.partitions.items())
    ]
    if layout.on_host:
        classes = classes_of(layout.on_host, layout.tasks, "", FirstLine(file="")).classes
        partitions.append(PartitionWork(partition="", components=layout.on_host, classes=classes))
    if conditions.load is not None:
        partitions.append(PartitionWork(partition=P2, load=conditions.load))
    return Work(
        application=layout.application,
        partitions=tuple(partitions),
        until={component.name: run_of(component).ends for component in layout.judged},
        seed=conditions.seed,
        least_ms=settling.least_ms,
    )


def _contenders(layout: AppliedLayout, load: Interference | None) -> tuple[Contender, ...]:
    """Partitions whose consumption shows what the scheduler does; what others leave idle is theirs to use for good."""
    if not wants_all_processors(load, layout.host_processors):
        return ()
    return tuple(
        Contender(
            components=tuple(member.name for member in members if member.apt),
            processors=layout.reserves[name],
            excess_forbids_verdict=False,
        )
        for name, members in sorted(layout.partitions.items())
        if name in layout.reserves
    )


def judge_layout(
    components: tuple[Component, ...],
    seen: Mapping[str, Series],
    *,
    is_real: bool = False,
) -> tuple[IndexVerdict, ...]:
    """Judge every index of every component's APT; each series is looked at whole and once.

    All verdicts together are wrong in `ERROR` of the runs at most: each has an equal part of it. Real processes may be
    run anew where a proof decides nothing: each of the two looks has half.

    Args:
        components: those with thresholds.
        seen: the series of each, by name.
        is_real: whether it ran as processes of a machine whose speed wanders.

    Returns:
        A verdict for each index, components in the order given.
    """
    looks = 2 if is_real else 1
    error = shared_error(looks * sum(len(component.apt) for component in components))
    series = {name: replace(each, wanders=is_real) for name, each in seen.items()}
    return tuple(
        _judge_index(component, index, verdict)
        for component in components
        for index, verdict in judge_each(series[component.name], component.apt, run_of(component), error=error).items()
    )


def _judge_index(component: Component, index: str, verdict: Verdict) -> IndexVerdict:
    estimate, reason = _estimate_of(verdict)
    measured = MeasuredIndex(
        component=component.name,
        index=index,
        threshold=component.apt[index],
        estimate=estimate,
        reason=reason,
        overload=verdict.overload if isinstance(verdict, Missed) else None,
    )
    return IndexVerdict(measured=measured, verdict=verdict)


def _estimate_of(verdict: Verdict) -> tuple[Estimate | None, str]:
    """What the verdict on a single index rests on, or why there is nothing."""
    match verdict:
        case Missed(overload=Overload() as overload):
            return None, describe_overload(overload)
        case Met(judged=(only,)) | Missed(judged=(only,)) | WithinNoise(judged=(only,)):
            return only.estimate, ""
        case Unsteady(reason=reason) | TooFewSamples(reason=reason):
            return None, reason
        case TooManyFailures(failures=failures, allowed=allowed):
            return None, f"{len(failures)} samples failed, and {allowed} may"
        case Met() | Missed() | WithinNoise():
            raise ValueError("a verdict on one index was asked for")
        case _:
            assert_never(verdict)
