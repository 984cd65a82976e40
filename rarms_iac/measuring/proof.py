"""Runs all components together in the layout that is applied, and judges every index against its threshold.

They begin again at least `STARTS` times, since periodic ones keep the phase in which they began, and go on until every
threshold was shown to be met or missed, or the budget is spent. What was not shown until then is not met. A layout in
which a component was shown to be overloaded ends with that start.
"""

from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from fractions import Fraction
from math import ceil, inf
from typing import assert_never

from rarms_iac.app.control import Control
from rarms_iac.manifest.text.tree import first_line
from rarms_iac.measuring.duration import least_samples
from rarms_iac.measuring.evidence import MeasuredIndex, with_memory_kills
from rarms_iac.measuring.partitions import (
    MeasuringResources,
    free_memory,
    load_shapes,
    parts_that_fit,
    running_test_partitions,
    set_reserves,
    share_next_to_layout,
)
from rarms_iac.measuring.sampling import Contender, Settling, WatchEnd, wants_all_processors, watch
from rarms_iac.model.loads import Interference, load_parts
from rarms_iac.model.outcomes import (
    Condition,
    Estimate,
    Met,
    Missed,
    Overload,
    Stopped,
    TooFewSamples,
    TooManyFailures,
    Unsteady,
    Verdict,
    WithinNoise,
)
from rarms_iac.model.output import Internal, output
from rarms_iac.model.quantities import LEAST_MEMORY, Milliseconds, ReservePercent
from rarms_iac.model.run import Elapsed, Periodic, SampleCount
from rarms_iac.model.series import MOST_SAMPLES, Series, join_series
from rarms_iac.model.setting import PartitionShape, SettingEvidence
from rarms_iac.model.system import Component, TaskRequest, Threshold, run_of
from rarms_iac.planner.task_classes import classes_of
from rarms_iac.providers.measuring import MeasuringHost, PartitionWork, Work
from rarms_iac.statistics.conditions import conditions_of, more_samples_lift
from rarms_iac.statistics.distributions import ERROR, samples_needed
from rarms_iac.statistics.overload import describe_overload, more_processors_help
from rarms_iac.statistics.samples import response_times, starts_differ
from rarms_iac.statistics.verdicts import judge_early, judge_look, samples_to_clear

STARTS = 8
"""So often the components of a layout begin again at least."""

NOT_GIVEN_UP = 1e-3
"""The part that counts as done where nothing is to end for what the rest would hardly show (`judge_early`)."""

SEED_STEP = 1009
"""More than there are starts, so that no two of them share a seed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AppliedLayout:
    """What runs where on one host."""

    application: str
    host_processors: int  # LPs of the host
    reserved: Fraction  # LPs that the running partitions of the application reserve there
    partitions: Mapping[str, tuple[Component, ...]]  # by name
    reserves: Mapping[str, float] = field(default_factory=dict)  # LPs of each that has a reserve, by name
    processors: Mapping[str, int] = field(default_factory=dict)  # VPs of each, by name
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

    def partition_of(self, component: str) -> str:
        """Return the partition that a component is in.

        Returns:
            The partition's name; empty: it is in none.
        """
        inside = {member.name: name for name, members in self.partitions.items() for member in members}
        return inside.get(component, "")

    def more_processors_help(self, component: str, overload: Overload) -> bool:
        """Tell whether a larger reservation could end an overload.

        Args:
            component: who is overloaded, by name.

        Returns:
            As for the component alone; yes where others of its partition may be the reason.
        """
        name = self.partition_of(component)
        reserved, processors = self.reserves.get(name), self.processors.get(name, 0)
        if not reserved or len(self.partitions[name]) > 1:
            return True
        return more_processors_help(overload, reserved / processors, processors)


@dataclass(frozen=True, slots=True, kw_only=True)
class IndexVerdict:
    """One index of a component in the layout: what was seen against its threshold, and the verdict on it."""

    measured: MeasuredIndex  # its bounds are the verdict's: wrong, on either side, with the verdict's error
    verdict: Verdict
    samples_needed: int | None = None  # that would show it, where it is inconclusive; None: unknown
    condition: Condition | None = None  # on which it is met

    @property
    def met(self) -> bool:
        """Whether it was shown to meet its threshold: inconclusive or without a steady state, it was not."""
        return isinstance(self.verdict, Met)

    @output
    def error(self) -> float | None:
        """The probability that it is wrong; None: no verdict on this."""
        return ERROR if isinstance(self.verdict, Met | Missed) else None


@dataclass(frozen=True, slots=True, kw_only=True)
class LayoutProof:
    """What a layout showed with a load, or without one."""

    host: str
    interference: str | None  # the load that ran with it; None: there was none
    layout: Internal[AppliedLayout]
    series: Internal[Mapping[str, Series]]  # by component, of those with thresholds
    verdicts: tuple[IndexVerdict, ...]  # every index of every threshold, components by name
    starts: int  # how often its components began again
    evidence: Internal[tuple[SettingEvidence, ...]] = ()  # of each start, where the host counts something
    host_ms: Internal[float] = 0.0  # what it took of the host's time
    wall_seconds: Internal[float] = 0.0  # what it took its user

    @output
    def host_lp(self) -> int:
        """LPs that the host has."""
        return self.layout.host_processors

    @output
    def reserved_lp(self) -> Fraction:
        """LPs that the partitions reserve that ran."""
        return self.layout.reserved

    @output
    def partitions(self) -> Mapping[str, tuple[str, ...]]:
        """The components of each partition that ran, by name."""
        return {name: tuple(member.name for member in members) for name, members in self.layout.partitions.items()}

    @property
    def not_met(self) -> tuple[IndexVerdict, ...]:
        """The indexes that were not shown to meet their thresholds."""
        return tuple(verdict for verdict in self.verdicts if not verdict.met)


def with_samples(layout: AppliedLayout, samples: int | None) -> AppliedLayout:
    """Have at least so many samples of each component taken; None: as each `run.until` says.

    Returns:
        The same layout with other runs.
    """
    if samples is None:
        return layout
    until = SampleCount(samples=samples)

    def changed(components: Iterable[Component]) -> tuple[Component, ...]:
        return tuple(replace(component, run=replace(run_of(component), until=until)) for component in components)

    partitions = {name: changed(members) for name, members in layout.partitions.items()}
    return replace(layout, partitions=partitions, on_host=changed(layout.on_host))


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadPartition:
    """P2 next to a layout: a load with all that the host has left, so that what is reserved stays reserved."""

    load: Interference
    shapes: tuple[PartitionShape, ...]  # its parts
    reserves: Mapping[str, ReservePercent]  # of each part, by its name: per cent of each of its processors
    lacks_part: bool = False  # whether the host has no memory for all parts that the load usually has


def load_partition(load: Interference, resources: MeasuringResources) -> LoadPartition | None:
    """Make a partition for a load next to what runs.

    Args:
        resources: of the host, with all that runs.

    Returns:
        P2; None where the least memory of a partition is not left.
    """
    usual = load_parts(load, resources.capacity.logical_processors)
    most = parts_that_fit(resources, usual)
    memory = free_memory(resources, parts=most)
    if memory < LEAST_MEMORY:
        return None
    parts, share = share_next_to_layout(resources, load, memory, most)
    shapes = load_shapes(memory, parts)
    return LoadPartition(load=load, shapes=shapes, reserves=share.reserves, lacks_part=most < usual)


@dataclass(frozen=True, slots=True, kw_only=True)
class ProofConditions:
    """What a layout is run under."""

    load_partition: LoadPartition | None  # None: no load
    interference: str | None  # its name
    seed: int  # of chance, where the host draws it
    budget_ms: float  # of the host's time, in which a start may begin
    statements: int = 1  # thresholds, times the loads with which they are proven: one that is missed shares the error
    slow_job: int = 1  # as of `policy.measuring`

    @property
    def load(self) -> Interference | None:
        """The interference in P2."""
        return None if self.load_partition is None else self.load_partition.load


def least_duration_ms(layout: AppliedLayout, scheduler_window_ms: float, budget_ms: float) -> float:
    """Work out how long a layout runs with a load at least.

    Args:
        scheduler_window_ms: the longest window of the host's scheduler.

    Returns:
        Of the host's time, in ms: every start settles, and takes its part of the samples of periodic components, as far
            as the budget has that.
    """
    settles = Settling(scheduler_window_ms=scheduler_window_ms).least_ms
    periodic = [
        least_samples(component) * float(arrival.period)
        for component in layout.judged
        if isinstance(arrival := run_of(component).arrival, Periodic)
    ]
    timed = [float(until.time) for component in layout.judged if isinstance(until := run_of(component).until, Elapsed)]
    needed = STARTS * settles + max(settles, *periodic, *timed, 0.0)
    return needed if _outlasts_budget(layout) else min(needed, max(budget_ms, 2 * STARTS * settles))


def _outlasts_budget(layout: AppliedLayout) -> bool:
    """Return whether `run.until` fixes the amount measured, which the budget does not shorten."""
    return any(run_of(component).until is not None for component in layout.judged)


def prove(
    host: MeasuringHost,
    layout: AppliedLayout,
    conditions: ProofConditions,
    control: Control,
    look: Callable[[float], None] = lambda _: None,
) -> LayoutProof | TooManyFailures | None:
    """Run everything that is applied, start after start, until each threshold is met or missed, or the budget spent.

    Args:
        host: Its lock is held by the caller.
        look: Hears the time of the host so far, in ms, each time that samples came.

    Returns:
        None: an end was asked for.

    Raises:
        HostError: the host did not do what was asked.
    """
    proof = _Proof(host=host, layout=layout, conditions=conditions, control=control, look=look)
    with ExitStack() as ends:
        ends.callback(control.reporter.settings.experiment_ended)
        if load_partition := conditions.load_partition:
            shapes = load_partition.shapes
            ends.enter_context(running_test_partitions(host, layout.application, shapes))
            set_reserves(host, layout.application, shapes, load_partition.reserves)
        while not proof.is_over:
            if (ended := proof.start_anew()) is not None:
                return None if isinstance(ended, Stopped) else ended
    return LayoutProof(
        host=host.name,
        interference=conditions.interference,
        layout=layout,
        series=proof.series,
        verdicts=judge_layout(layout, proof.series, statements=conditions.statements, slow_job=conditions.slow_job),
        starts=proof.starts,
        evidence=proof.evidence,
        host_ms=proof.spent_ms,
    )


@dataclass(slots=True, kw_only=True)
class _Proof:
    """The starts of a layout so far."""

    host: MeasuringHost
    layout: AppliedLayout
    conditions: ProofConditions
    control: Control
    look: Callable[[float], None]
    series: Mapping[str, Series] = field(default_factory=dict)  # by component, of all starts
    starts: int = 0
    spent_ms: float = 0.0
    evidence: tuple[SettingEvidence, ...] = ()

    @property
    def is_over(self) -> bool:
        if self.starts and self._is_overloaded:
            return True  # queues that grow miss their thresholds by arithmetic: more starts tell nothing else
        if self.starts < STARTS:
            return False
        return self.spent_ms >= self.conditions.budget_ms or not any(map(self._undecided, self.layout.judged))

    def start_anew(self) -> TooManyFailures | Stopped | None:
        """Add a start to the series; or why there is none."""
        left_ms = inf if _outlasts_budget(self.layout) else self.conditions.budget_ms - self.spent_ms
        most_ms = left_ms / max(1, STARTS - self.starts)
        reporter, stop = self.control.reporter.settings, self.control.stop

        def is_spent(seen: Mapping[str, Series]) -> bool:
            so_far = {name: self._with(name, part) for name, part in seen.items()}
            reporter.proof_samples_came(self.host.name, self.conditions.interference, so_far)
            self.look(self.spent_ms + running.elapsed_ms())
            return running.elapsed_ms() >= most_ms

        settling = Settling(
            scheduler_window_ms=self.host.scheduler_memory_ms, contenders=_contenders(self.layout, self.conditions.load)
        )
        seed = self.conditions.seed * SEED_STEP + self.starts
        work = _work_of(self.layout, self.conditions.load_partition, seed, least_ms=settling.least_ms / STARTS)
        until = {component.name: self._until(component) for component in self.layout.judged}
        with self.host.run(replace(work, until=until)) as running:
            end = WatchEnd(is_enough=is_spent, should_stop=stop.should_stop, limit_ms=most_ms)
            seen = watch(running, self.layout.judged, settling, end)
            evidence, elapsed_ms = running.evidence(), running.elapsed_ms()
        if seen is None:
            return Stopped()
        if isinstance(seen, TooManyFailures):
            return with_memory_kills(seen, evidence)
        is_real = evidence is not None
        self.evidence += () if evidence is None else (evidence,)
        self.series = {name: replace(self._with(name, part), wanders=is_real) for name, part in seen.items()}
        self.starts, self.spent_ms = self.starts + 1, self.spent_ms + elapsed_ms
        return None

    @property
    def _is_overloaded(self) -> bool:
        """Whether a component was shown to ask for more than it gets."""
        verdicts = judge_layout(
            self.layout, self.series, statements=self.conditions.statements, slow_job=self.conditions.slow_job
        )
        return any(isinstance(each.verdict, Missed) and each.verdict.overload is not None for each in verdicts)

    def _with(self, name: str, part: Series) -> Series:
        return join_series((self.series[name], part)) if name in self.series else part

    def _until(self, component: Component) -> SampleCount | Elapsed:
        """Return how much a start measures: a part of what the thresholds need, then of what was seen.

        Where the starts differ they are the samples: then there are more of them, as long as the first ones.
        """
        if self.starts >= STARTS:
            series = self.series[component.name]
            if not self._undecided(component):
                return SampleCount(samples=1)
            if not self._starts_differ(component):
                return SampleCount(samples=ceil(len(series.samples) / STARTS))
        until = run_of(component).until
        if isinstance(until, Elapsed):
            return Elapsed(time=Milliseconds(until.time / STARTS))
        return SampleCount(samples=ceil(least_samples(component) / STARTS))

    def _starts_differ(self, component: Component) -> bool:
        series = self.series[component.name]
        return starts_differ(response_times(series.samples), series.runs)

    def _undecided(self, component: Component) -> bool:
        """Return whether more starts may show that a threshold is met or missed.

        NOTE: where starts differ, a few of them do not show whether many will decide: none is given up before the end.
        """
        series = self.series[component.name]
        done = 1.0
        if self.spent_ms < self.conditions.budget_ms:
            done = min(1.0, max(self.spent_ms / self.conditions.budget_ms, len(series.samples) / MOST_SAMPLES))
        if done < 1.0 and self._starts_differ(component):
            done = NOT_GIVEN_UP
        return any(
            self._goes_on(component, series, index, threshold, done) for index, threshold in component.apt.items()
        )

    def _goes_on(self, component: Component, series: Series, index: str, threshold: Threshold, done: float) -> bool:
        """Return whether more starts may show that a threshold is met, without a condition, or missed."""
        run, slow_job = run_of(component), self.conditions.slow_job
        verdict = judge_early(series, {index: threshold}, run, done=done, members=self.conditions.statements)
        if done >= 1.0 or not isinstance(verdict, Met):
            return verdict is None
        return more_samples_lift(verdict.judged, series, run, slow_job, samples=len(series.samples) / done)


def _work_of(layout: AppliedLayout, load: LoadPartition | None, seed: int, least_ms: float) -> Work:
    """Return everything that is applied, and the load in P2."""
    partitions = [
        PartitionWork(
            partition=name,
            components=members,
            classes=classes_of(members, layout.tasks, name, first_line("")).classes,
            deadline_period_us=layout.deadline_periods_us.get(name),
        )
        for name, members in sorted(layout.partitions.items())
    ]
    if layout.on_host:
        classes = classes_of(layout.on_host, layout.tasks, "", first_line("")).classes
        partitions.append(PartitionWork(partition="", components=layout.on_host, classes=classes))
    if load is not None:
        partitions += (PartitionWork(partition=shape.name, load=load.load) for shape in load.shapes)
    return Work(
        application=layout.application,
        partitions=tuple(partitions),
        until={},
        seed=seed,
        least_ms=least_ms,
    )


def _contenders(layout: AppliedLayout, load: Interference | None) -> tuple[Contender, ...]:
    """Return the partitions whose consumption shows the scheduler's behaviour; they may keep what others leave idle."""
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
    layout: AppliedLayout, seen: Mapping[str, Series], *, statements: int | None, slow_job: int
) -> tuple[IndexVerdict, ...]:
    """Judge every index of every component's APT; the error holds for all looks at it together.

    That all are met shares nothing: it is wrong only where one that misses was shown to meet. That one misses shares
    the error among all that is said.

    Args:
        seen: the series of each component with thresholds, by name.
        statements: thresholds, times the loads with which they are judged; None: with one.

    Returns:
        A verdict for each index, components by name.
    """
    members = statements or sum(len(component.apt) for component in layout.judged)
    return tuple(
        _with_condition(
            _judge_index(layout, component, index, seen[component.name], members), seen, component, slow_job
        )
        for component in layout.judged
        for index in component.apt
    )


def _with_condition(
    verdict: IndexVerdict, seen: Mapping[str, Series], component: Component, slow_job: int
) -> IndexVerdict:
    if not isinstance(verdict.verdict, Met):
        return verdict
    found = conditions_of(verdict.verdict.judged, seen[component.name], run_of(component), slow_job)
    return replace(verdict, condition=next(iter(found), None))


def _judge_index(layout: AppliedLayout, component: Component, index: str, series: Series, members: int) -> IndexVerdict:
    threshold = component.apt[index]
    verdict = judge_look(series, {index: threshold}, run_of(component), members=members)
    estimate, reason = _estimate_of(verdict)
    overload = verdict.overload if isinstance(verdict, Missed) else None
    if overload is not None:
        reason = describe_overload(overload, helps=layout.more_processors_help(component.name, overload))
    measured = MeasuredIndex(
        component=component.name,
        index=index,
        threshold=threshold,
        estimate=estimate,
        reason=reason,
        overload=overload,
    )
    return IndexVerdict(measured=measured, verdict=verdict, samples_needed=_samples_needed(verdict, series, measured))


def _samples_needed(verdict: Verdict, series: Series, measured: MeasuredIndex) -> int | None:
    """Return the samples that will probably decide an index; None if a proof may not have so many."""
    match verdict:
        case WithinNoise(judged=(only,)):
            count = samples_to_clear(only, series)
            return None if count is None or count > MOST_SAMPLES else max(ceil(count), len(series.samples) + 1)
        case TooFewSamples():  # of so many that depend on one another, twice as many have their bounds sooner or later
            least, seen = samples_needed(measured.index, measured.threshold), len(series.samples)
            count = least if seen < least else 2 * seen
            return count if count <= MOST_SAMPLES else None
        case _:
            return None


def _estimate_of(verdict: Verdict) -> tuple[Estimate | None, str]:
    """Return the data of the verdict on a single index, or why there is none."""
    match verdict:
        case Missed(overload=Overload()):
            return None, ""
        case Met(judged=(only,)) | Missed(judged=(only,)) | WithinNoise(judged=(only,)):
            return only.estimate, ""
        case Unsteady(reason=reason) | TooFewSamples(reason=reason):
            return None, reason
        case TooManyFailures(failures=failures, allowed=allowed):
            return None, f"{len(failures)} samples failed; {allowed} are allowed"
        case Met() | Missed() | WithinNoise():
            raise ValueError("a verdict on one index was asked for")
        case _:
            assert_never(verdict)
