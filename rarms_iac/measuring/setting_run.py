"""A setting of an experiment: P1 with its components, P2 with the load, samples until they are enough.

What disturbed it is measured once more.
"""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from math import inf

from rarms_iac.app.control import UNATTENDED, Control
from rarms_iac.manifest.text.tree import first_line
from rarms_iac.measuring.evidence import TRIES, disturbance, with_evidence, with_memory_kills
from rarms_iac.measuring.experiment_log import KnownSettings
from rarms_iac.measuring.partitions import (
    MeasuringResources,
    free_memory,
    load_share,
    processors_of_load,
    running_test_partitions,
    set_reserves,
    shapes_of_test_partitions,
)
from rarms_iac.measuring.sampling import Contender, Settling, WatchEnd, wants_all_processors, watch
from rarms_iac.measuring.search.crossings import is_known
from rarms_iac.measuring.search.first_pass import is_near_enough
from rarms_iac.measuring.search.trials import is_clear
from rarms_iac.measuring.strategies import goal_of
from rarms_iac.model.experiment import Experiment, ProcessorSource
from rarms_iac.model.outcomes import Measure, SettingFailed, Stopped, TooManyFailures
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.run import SampleCount
from rarms_iac.model.series import MOST_SAMPLES, Series
from rarms_iac.model.setting import P1, PartitionShape, Setting, SettingEvidence
from rarms_iac.planner.task_classes import ClassValues, classes_of, registry_values
from rarms_iac.providers.measuring import MeasuringHost, PartitionWork, Work
from rarms_iac.statistics.first_look import LONGEST_MS
from rarms_iac.statistics.verdicts import until_share
from rarms_iac.storage.datalog.log import as_recorded

SEED_STEP = 101
"""More than there are settings, so that no two of them share a seed."""

FIRST_PASS_SEED = 1_000_000
"""Added to the seed of a first pass: the jobs that chose a setting are not among those that judge it."""


def other_processors(experiment: Experiment, used: int | None) -> int | None:
    """Say with how many processors the experiment goes on after a setting.

    Args:
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
class Site:
    """A held host with the test partitions of an experiment, and who hears of its settings."""

    host: MeasuringHost
    experiment: Experiment
    resources: MeasuringResources
    seed: int
    control: Control = UNATTENDED
    others: tuple[PartitionWork, ...] = ()  # that goes on in other partitions, and is not looked at

    @property
    def shapes(self) -> tuple[PartitionShape, ...]:
        """The shapes of P1 and the parts of P2."""
        return shapes_for(self.experiment, self.resources)

    def partitions(self) -> AbstractContextManager[None]:
        """Have P1 and P2 on the host inside.

        Raises:
            HostError: The host did not make or remove them.
        """
        classes = {values.name: registry_values(values) for values in _task_classes(self.experiment)}
        return running_test_partitions(self.host, self.experiment.application, self.shapes, classes)


def shapes_for(experiment: Experiment, resources: MeasuringResources) -> tuple[PartitionShape, ...]:
    """Shape the test partitions of an experiment.

    Returns:
        P1, then the parts of P2.
    """
    parts = _parts_of_load(experiment, resources)
    memory = free_memory(resources, experiment.setup.memory, len(parts))
    return shapes_of_test_partitions(experiment.setup, memory, parts)


def _parts_of_load(experiment: Experiment, resources: MeasuringResources) -> tuple[int, ...]:
    return processors_of_load(resources, experiment.setup, experiment.load, experiment.load_parts)


def work_in_test_partitions(experiment: Experiment, resources: MeasuringResources) -> tuple[PartitionWork, ...]:
    """Say what runs in P1 and in P2.

    Returns:
        P1's work, then that of each part of P2.
    """
    p1, *parts = shapes_for(experiment, resources)
    return (
        PartitionWork(partition=p1.name, components=experiment.members, classes=_task_classes(experiment)),
        *(PartitionWork(partition=part.name, load=experiment.load) for part in parts),
    )


def _task_classes(experiment: Experiment) -> tuple[ClassValues, ...]:
    """Return the task classes that the members name, as a plan would set them in a partition of just these."""
    return classes_of(experiment.members, experiment.tasks, P1, first_line("")).classes


def run_setting(
    site: Site, request: Measure, known: KnownSettings, before: Sequence[Setting]
) -> Setting | SettingFailed | Stopped:
    """Measure a setting; where something disturbed it, measure it again.

    Args:
        request: The reservation, one that the host can give, and when its samples are enough.
        before: Those at other reservations that the strategy knew when it asked for this one.

    Returns:
        The setting as the log is to have it, or why there is none.

    Raises:
        HostError: The host did not do what was asked.
    """
    experiment, control = site.experiment, site.control
    parts = _parts_of_load(experiment, site.resources)
    share = load_share(site.resources, experiment.setup, request.reserve, parts)
    if share is None:
        raise ValueError(f"the host cannot give {request.reserve} %")
    set_reserves(site.host, experiment.application, site.shapes, {P1: request.reserve, **share.reserves})
    processors = site.resources.capacity.logical_processors
    steady_share = share if wants_all_processors(experiment.load, processors) else None
    left_ms = experiment.budget.at(request.reserve) - known.spent_ms(request.reserve, site.seed)
    disturbances: list[str] = []
    spent_ms = 0.0
    while True:
        empty = Setting(
            reserve=request.reserve,
            series=(),
            beside=share.reserve,
            seed=site.seed,
            spent_ms=spent_ms,
            processors=experiment.setup.processors,
            first_pass=request.first_pass,
        )
        setting, evidence = _try_setting(site, request, empty, known, before)
        if not isinstance(setting, Setting) or evidence is None:
            return setting
        spent_ms = setting.host_ms
        reason = disturbance(evidence, processors, steady_share)
        disturbances += [reason] if reason else []
        if not reason or len(disturbances) == TRIES or (request.until_clear and spent_ms >= left_ms):
            return as_recorded(with_evidence(setting, evidence, disturbances, undisturbed=not reason))
        control.reporter.settings.setting_disturbed(experiment, request.reserve, reason)


def _try_setting(
    site: Site, request: Measure, empty: Setting, known: KnownSettings, before: Sequence[Setting]
) -> tuple[Setting | SettingFailed | Stopped, SettingEvidence | None]:
    """Return a setting from the first sample to the last, and what the host counted meanwhile."""
    experiment, control = site.experiment, site.control
    goal = replace(goal_of(experiment), ends_at_until=request.within_until)
    until = {name: run.until for name, run in goal.runs.items() if run.until is not None and not request.first_pass}

    def used() -> int | None:
        """Return the processors used; the paper's strategy does not look at them."""
        return None if request.within_until else experiment.used(running.used_processors(P1))

    def needs_starts() -> bool:
        return other_processors(experiment, used()) is None

    def so_far(seen: Mapping[str, Series], elapsed_ms: float) -> Setting:
        """Round a setting as the log records it, so that a run continued from the log decides by equal numbers."""
        measured, spent_ms = tuple(seen[name] for name in sorted(seen)), empty.host_ms + elapsed_ms
        return as_recorded(replace(empty, series=measured, spent_ms=spent_ms, used_processors=used()))

    def is_enough(seen: Mapping[str, Series]) -> bool:
        control.reporter.settings.samples_came(experiment, request.reserve, seen)
        if not request.until_clear or any(until_share(seen[name], each) < 1.0 for name, each in until.items()):
            return False
        setting = so_far(seen, running.elapsed_ms())
        if other_processors(experiment, setting.used_processors) is not None:
            return True
        if request.first_pass:
            return is_near_enough(setting, goal)
        joined = known.joined_with(request.reserve, setting)
        if request.until_known and is_known(joined, before, goal):
            return True
        return is_clear(joined, goal, precision=request.precision, unconditional=request.unconditional)

    contenders = _contenders(experiment, site.resources, request.reserve)
    settling = Settling(scheduler_window_ms=site.host.scheduler_memory_ms, contenders=contenders)
    work = replace(_work(site, request), least_ms=settling.least_ms)
    left_ms = goal.budget.at(request.reserve) - known.spent_ms(request.reserve, site.seed) - empty.host_ms
    if request.first_pass:
        left_ms = LONGEST_MS
    end = WatchEnd(
        is_enough=is_enough,
        should_stop=control.stop.should_stop,
        limit_ms=max(0.0, left_ms) if request.until_clear else inf,
        needs_starts=needs_starts if request.until_clear and not (request.within_until or request.first_pass) else None,
    )
    with site.host.run(work) as running:
        series = watch(running, experiment.members, settling, end)
        evidence, elapsed_ms = running.evidence(), running.elapsed_ms()
    if series is None:
        return Stopped(), None
    if isinstance(series, TooManyFailures):
        return SettingFailed(reserve=request.reserve, verdict=with_memory_kills(series, evidence)), None
    return so_far(series, elapsed_ms), evidence


def _contenders(
    experiment: Experiment, resources: MeasuringResources, reserve: ReservePercent
) -> tuple[Contender, ...]:
    """Return P1 if P2 wants everything unreserved; idle reserves of others are shared and are no excess."""
    others = any(claim.reserve and claim.processors for claim in resources.claims)
    if others or not wants_all_processors(experiment.load, resources.capacity.logical_processors):
        return ()
    names = tuple(member.name for member in experiment.members)
    processors = experiment.setup.processors * reserve / 100
    return (Contender(components=names, processors=processors, excess_forbids_verdict=True),)


def _work(site: Site, request: Measure) -> Work:
    """Return the work of this setting.

    Each setting has a seed of its own, so that settings do not share one lucky or unlucky draw.
    """
    # NOTE: more than count, since jobs that end while something settles are none of them: `is_clear` ends the setting.
    experiment = site.experiment
    goes_on, all_samples = request.until_clear and not request.within_until, SampleCount(samples=4 * MOST_SAMPLES)
    return Work(
        application=experiment.application,
        partitions=(*work_in_test_partitions(experiment, site.resources), *site.others),
        until={name: all_samples if goes_on else run.ends for name, run in experiment.runs.items()},
        seed=(site.seed + (FIRST_PASS_SEED if request.first_pass else 0)) * SEED_STEP + request.reserve,
    )
