"""The loop of measuring: a strategy asks for a setting, the host runs it, samples are judged, the log records it.

A strategy is a pure function of the recorded settings. So a run that was killed goes on by asking it again, and a
setting that is recorded is never run a second time.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import Protocol

from rarms_iac.manifest.text.positions import FirstLine
from rarms_iac.measuring.evidence import TRIES, disturbance, with_evidence
from rarms_iac.measuring.partitions import (
    MeasuringBudget,
    memory_for_load,
    reserve_for_load,
    running_test_partitions,
    set_reserves,
    shapes_of_test_partitions,
)
from rarms_iac.measuring.sampling import watch
from rarms_iac.measuring.search.trials import is_clear
from rarms_iac.measuring.settling import Contender, Settling, wants_all_processors
from rarms_iac.measuring.setup import Experiment
from rarms_iac.measuring.strategies import goal_of
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.measurement import P1, P2, Setting, SettingEvidence, join_settings
from rarms_iac.model.outcomes import Conclusion, ExperimentStep, Measure, SettingFailed, Stopped, TooManyFailures
from rarms_iac.model.processor_number import ProcessorSource
from rarms_iac.model.run import Run, SampleCount
from rarms_iac.model.series import MOST_SAMPLES, Series
from rarms_iac.planner.task_classes import ClassValues, classes_of, registry_values
from rarms_iac.providers.measuring import MeasuringHost, PartitionShape, PartitionWork, Work
from rarms_iac.statistics.verdicts import until_share
from rarms_iac.storage.datalog.columns import as_recorded
from rarms_iac.storage.datalog.files import append_setting, begin_log, read_log
from rarms_iac.storage.datalog.log import Header, Provenance, Recorded
from rarms_iac.storage.disk import make_folders

SEED_STEP = 101
"""More than there are settings, so that no two of them share a seed."""


class Strategy(Protocol):
    """Which setting is next; the same settings give the same answer."""

    def step(self, settings: Sequence[Setting]) -> ExperimentStep:
        """Say what to do after these settings, in the order in which they were run.

        Args:
            settings: those that count for this run.

        Returns:
            The next setting, or how the experiment ends.
        """
        ...


class MeasuringReporter:
    """Told what happens, as it happens; must not raise. This one drops what it is told."""

    def experiment_started(self, experiment: Experiment, recorded: tuple[Setting, ...]) -> None:
        """Measuring begins, or goes on after the settings that are recorded.

        Args:
            experiment: what is measured.
            recorded: its settings so far.
        """

    def setting_started(self, experiment: Experiment, reserve: int, number: int) -> None:
        """The setting of this CR begins; it is the number-th, from 1.

        Args:
            experiment: what is measured.
            reserve: the CR in per cent of P1's own processors.
            number: of the setting, from 1.
        """

    def samples_came(self, experiment: Experiment, reserve: int, seen: Mapping[str, Series]) -> None:
        """Some samples more were seen.

        Args:
            experiment: what is measured.
            reserve: the CR in per cent of P1's own processors.
            seen: by component, the series so far.
        """

    def setting_ended(self, experiment: Experiment, setting: Setting) -> None:
        """The setting is recorded.

        Args:
            experiment: what is measured.
            setting: as it is recorded.
        """

    def setting_disturbed(self, experiment: Experiment, reserve: int, reason: str) -> None:
        """The setting of this CR was disturbed, and is measured once more.

        Args:
            experiment: what is measured.
            reserve: the CR in per cent of P1's own processors.
            reason: what disturbed it, in words.
        """

    def experiment_ended(self) -> None:
        """There is nothing more to run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingsLog:
    """The data log of an experiment: a file that is begun with the first setting."""

    path: Path
    header: Header
    provenance: Callable[[Setting], Provenance]  # of what is recorded now
    anew: int | None = None  # a strategy sees reservations only once they were measured with this seed; None: all
    replaces_stale: bool = False  # what is there is stale, and gives way to the first setting

    @property
    def is_simulated(self) -> bool:
        """Whether samples are drawn from seeds."""
        return self.header.platform_facts.provider is ProviderKind.SIMULATED

    def runs(self) -> tuple[Setting, ...]:
        """Read all that count, each run by itself, in the order in which they were recorded.

        Returns:
            Those with as many processors as the header has; none where there is no log yet, or it is stale.

        Raises:
            LogUnreadable: the file is no whole data log.
        """
        log = None if self.replaces_stale else read_log(self.path)
        if log is None:
            return ()
        return tuple(record.setting for record in log.of(self.header.setup.processors).counting)

    def settings(self) -> tuple[Setting, ...]:
        """Join what counts to one setting a reservation (`join_settings`).

        Returns:
            As `runs`.

        Raises:
            LogUnreadable: the file is no whole data log.
        """
        return join_settings(self.runs(), simulated=self.is_simulated)

    def add(self, setting: Setting) -> None:
        """Record a setting, whole or not at all; it is on the disk when this returns.

        Args:
            setting: one that is not in the log.

        Raises:
            LogUnreadable: the file is no whole data log.
            OSError: it cannot be written.
        """
        log = read_log(self.path)
        if log is None or (self.replaces_stale and log.header != self.header):
            make_folders(self.path.parent)
            begin_log(self.path, self.header)
        append_setting(self.path, Recorded(setting=setting, provenance=self.provenance(setting)))


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuringContext:
    """What a run of the loop is given beside the experiment."""

    host: MeasuringHost  # its lock is held by who calls
    budget: Callable[[], MeasuringBudget]  # asked once, before the first setting that must be run; may refuse
    seed: int
    reporter: MeasuringReporter
    should_stop: Callable[[], bool]
    others: tuple[PartitionWork, ...] = ()  # what goes on in partitions beside P1 and P2, and is not looked at


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherProcessors:
    """P1 was seen to use another number of processors than it has: what was measured so far is no curve of it."""

    number: int


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopResult:
    """How an experiment ended, and what that rests on."""

    conclusion: Conclusion | OtherProcessors
    settings: tuple[Setting, ...]
    new: int  # how many of them were run now


def measure(experiment: Experiment, strategy: Strategy, log: SettingsLog, context: MeasuringContext) -> LoopResult:
    """Run settings until the strategy has its answer; P1 and P2 are there only meanwhile.

    Args:
        experiment: what is measured.
        strategy: asked for each next setting.
        log: settings in it are not run again; new ones are added as they end.
        context: the host, locked, and who is told.

    Returns:
        How it ended, with all settings that count.

    Raises:
        HostError: the host did not do what was asked; what is recorded stays.
        OSError: the log cannot be written.
    """
    known, new = _Known(runs=log.runs(), simulated=log.is_simulated), 0
    context.reporter.experiment_started(experiment, known.settings)
    with ExitStack() as ends:
        ends.callback(context.reporter.experiment_ended)
        partitions: _TestPartitions | None = None
        anew = log.anew
        step: ExperimentStep | OtherProcessors
        while True:
            step = strategy.step(known.seen_with(anew))
            if not isinstance(step, Measure):
                if anew is None:
                    break
                anew = None  # what was asked for is measured anew: all that counts gives the answer
                continue
            if context.should_stop():
                step = Stopped()
                break
            partitions = partitions or _make_test_partitions(experiment, context, ends)
            context.reporter.setting_started(experiment, step.reserve, len(known.seen_with(anew)) + 1)
            setting = _run_setting(experiment, context, partitions, step, known)
            if not isinstance(setting, Setting):
                step = setting
                break
            log.add(setting)
            known, new = known.with_run(setting), new + 1
            context.reporter.setting_ended(experiment, known.at(setting.reserve))
            if (number := other_processors(experiment, setting.used_processors)) is not None:
                step = OtherProcessors(number=number)
                break
    return LoopResult(conclusion=step, settings=known.settings, new=new)


def other_processors(experiment: Experiment, used: int | None) -> int | None:
    """Say with how many processors the experiment goes on after a setting.

    Args:
        experiment: what is measured.
        used: what was used at once there, by `Experiment.used`.

    Returns:
        Another number than P1 has: what it uses, where the first setting shows that, and later only more; None: it
        keeps its own, as where the manifest fixes it.
    """
    processors = experiment.setup.processors
    if used is None or experiment.fixes_processors or used == processors:
        return None
    is_first = experiment.processors_from is ProcessorSource.HOST
    return used if is_first or used > processors else None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Known:
    """What was measured, each run by itself, and joined to one setting a reservation."""

    runs: tuple[Setting, ...]
    simulated: bool
    joined: dict[int, Setting] = field(default_factory=dict)  # by reserve, what `at` worked out

    @property
    def settings(self) -> tuple[Setting, ...]:
        return tuple(map(self.at, dict.fromkeys(run.reserve for run in self.runs)))

    def seen_with(self, seed: int | None) -> tuple[Setting, ...]:
        """The settings that were measured with this seed, with all that counts there; None: all."""
        reserves = {run.reserve for run in self.runs if seed is None or run.seed == seed}
        return tuple(setting for setting in self.settings if setting.reserve in reserves)

    def at(self, reserve: int) -> Setting:
        """NOTE: worked out once, since estimates are kept with the samples that they are made of."""
        if reserve not in self.joined:
            self.joined[reserve] = self.joined_with(reserve)
        return self.joined[reserve]

    def joined_with(self, reserve: int, *more: Setting) -> Setting:
        """The setting of a reservation, with a run more."""
        runs = [run for run in self.runs if run.reserve == reserve]
        (joined,) = join_settings((*runs, *more), simulated=self.simulated)
        return joined

    def spent_ms(self, reserve: int, seed: int) -> float:
        """The host's time that was spent there before: a simulated host runs through that of the same seed again."""
        runs = [run for run in self.runs if run.reserve == reserve and not (self.simulated and run.seed == seed)]
        return join_settings(runs, simulated=self.simulated)[0].host_ms if runs else 0.0

    def with_run(self, run: Setting) -> "_Known":
        joined = {reserve: setting for reserve, setting in self.joined.items() if reserve != run.reserve}
        return replace(self, runs=(*self.runs, run), joined=joined)


@dataclass(frozen=True, slots=True, kw_only=True)
class _TestPartitions:
    """The test partitions, and what there is room for."""

    budget: MeasuringBudget
    shapes: tuple[PartitionShape, PartitionShape]


def _make_test_partitions(experiment: Experiment, context: MeasuringContext, ends: ExitStack) -> _TestPartitions:
    budget = context.budget()
    shapes = shapes_for(experiment, budget)
    classes = {values.name: registry_values(values) for values in _task_classes(experiment)}
    ends.enter_context(running_test_partitions(context.host, experiment.application, shapes, classes))
    return _TestPartitions(budget=budget, shapes=shapes)


def shapes_for(experiment: Experiment, budget: MeasuringBudget) -> tuple[PartitionShape, PartitionShape]:
    """Shape the test partitions of an experiment.

    Args:
        experiment: what is measured.
        budget: of its host.

    Returns:
        P1, then P2.
    """
    memory = memory_for_load(budget, experiment.setup)
    return shapes_of_test_partitions(experiment.setup, budget.capacity.logical_processors, memory)


def work_in_test_partitions(experiment: Experiment) -> tuple[PartitionWork, PartitionWork]:
    """Say what runs in P1 and in P2.

    Args:
        experiment: what is measured.

    Returns:
        P1's work, then P2's.
    """
    return (
        PartitionWork(partition=P1, components=experiment.members, classes=_task_classes(experiment)),
        PartitionWork(partition=P2, load=experiment.load),
    )


def _task_classes(experiment: Experiment) -> tuple[ClassValues, ...]:
    """The task classes that the members name, as a plan would set them in a partition of just these."""
    return classes_of(experiment.members, experiment.tasks, P1, FirstLine(file="")).classes


def _run_setting(
    experiment: Experiment, context: MeasuringContext, partitions: _TestPartitions, step: Measure, known: _Known
) -> Setting | SettingFailed | Stopped:
    """One setting, of a reservation that the budget has; where something disturbed it, measured again."""
    load_reserve = reserve_for_load(partitions.budget, experiment.setup, step.reserve)
    if load_reserve is None:
        raise ValueError(f"{step.reserve} % was asked for, and the host cannot give that")
    set_reserves(context.host, experiment.application, partitions.shapes, {P1: step.reserve, P2: load_reserve})
    processors = partitions.budget.capacity.logical_processors
    takes = load_reserve * processors / 100 if wants_all_processors(experiment.load, processors) else None
    left_ms = float(experiment.limits.setting) - known.spent_ms(step.reserve, context.seed)
    disturbances: list[str] = []
    spent_ms = 0.0
    while True:
        empty = Setting(
            reserve=step.reserve,
            series=(),
            beside=load_reserve,
            seed=context.seed,
            spent_ms=spent_ms,
            processors=experiment.setup.processors,
        )
        setting, evidence = _try_setting(experiment, context, partitions, step, empty, known)
        if not isinstance(setting, Setting) or evidence is None:
            return setting
        spent_ms = setting.host_ms
        reason = disturbance(evidence, processors, takes)
        disturbances += [reason] if reason else []
        if not reason or len(disturbances) == TRIES or (step.until_clear and spent_ms >= left_ms):
            return as_recorded(with_evidence(setting, evidence, disturbances, undisturbed=not reason))
        context.reporter.setting_disturbed(experiment, step.reserve, reason)


def _try_setting(
    experiment: Experiment,
    context: MeasuringContext,
    partitions: _TestPartitions,
    step: Measure,
    empty: Setting,
    known: _Known,
) -> tuple[Setting | SettingFailed | Stopped, SettingEvidence | None]:
    """A setting from the first sample to the last, and what the host counted meanwhile."""
    goal = replace(goal_of(experiment), ends_at_until=step.within_until)

    def used() -> int | None:
        """NOTE: the paper's strategy does not look at what is used."""
        return None if step.within_until else experiment.used(running.used_processors(P1))

    def so_far(seen: Mapping[str, Series], elapsed_ms: float) -> Setting:
        """As the log records it, so that a run that goes on from the log decides by the same numbers."""
        series = tuple(seen[name] for name in sorted(seen))
        spent_ms = empty.host_ms + elapsed_ms
        return as_recorded(replace(empty, series=series, spent_ms=spent_ms, used_processors=used()))

    def is_enough(seen: Mapping[str, Series]) -> bool:
        context.reporter.samples_came(experiment, step.reserve, seen)
        if not step.until_clear or not all(_has_until(seen[name], run) for name, run in goal.runs.items()):
            return False
        setting = so_far(seen, running.elapsed_ms())
        if other_processors(experiment, setting.used_processors) is not None:
            return True
        joined = known.joined_with(step.reserve, setting)
        return is_clear(joined, goal, precision=step.precision)

    settling = Settling(
        memory_ms=context.host.scheduler_memory_ms, contenders=_contenders(experiment, partitions.budget, step.reserve)
    )
    work = replace(_work(experiment, context, step), least_ms=settling.least_ms)
    limit_ms = goal.budget_ms - known.spent_ms(step.reserve, context.seed) - empty.host_ms
    with context.host.run(work) as running:
        series = watch(
            running,
            experiment.members,
            settling,
            is_enough,
            context.should_stop,
            limit_ms=max(0.0, limit_ms) if step.until_clear else inf,
            restarts=step.until_clear and not step.within_until,
            needs_starts=lambda: other_processors(experiment, used()) is None,
        )
        evidence, elapsed_ms = running.evidence(), running.elapsed_ms()
    if series is None:
        return Stopped(), None
    if isinstance(series, TooManyFailures):
        return SettingFailed(reserve=step.reserve, verdict=series), None
    return so_far(series, elapsed_ms), evidence


def _has_until(series: Series, run: Run) -> bool:
    return run.until is None or until_share(series, run.until) >= 1.0


def _contenders(experiment: Experiment, budget: MeasuringBudget, reserve: int) -> tuple[Contender, ...]:
    """P1, where P2 wants all that it does not reserve; what others reserve and leave idle is shared, and no excess."""
    others = any(claim.reserve and claim.processors for claim in budget.claims)
    if others or not wants_all_processors(experiment.load, budget.capacity.logical_processors):
        return ()
    names = tuple(member.name for member in experiment.members)
    processors = experiment.setup.processors * reserve / 100
    return (Contender(components=names, processors=processors, excess_forbids_verdict=True),)


def _work(experiment: Experiment, context: MeasuringContext, step: Measure) -> Work:
    """What runs at this setting.

    Each setting has a seed of its own, so that settings do not share one lucky or unlucky draw.
    """
    # NOTE: more than count, since jobs that end while something settles are none of them: `is_clear` ends the setting.
    goes_on, all_samples = step.until_clear and not step.within_until, SampleCount(samples=4 * MOST_SAMPLES)
    return Work(
        application=experiment.application,
        partitions=(*work_in_test_partitions(experiment), *context.others),
        until={name: all_samples if goes_on else run.ends for name, run in experiment.runs.items()},
        seed=context.seed * SEED_STEP + step.reserve,
    )
