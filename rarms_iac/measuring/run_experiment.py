"""One experiment on a held host: what is in the way is refused or stopped, then setting after setting is run.

Begin at `run_experiment`; `measure_with_each_load` asks it for one load after the other. Which experiments there are,
and in which order, is for `measure` and for tuning to say.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import groupby

from rarms_iac.app.data_logs import files_of, stale_advice, used_processors
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.measurement_files import hold_data_log
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.measuring import findings
from rarms_iac.measuring.duration import forecast, settings_to_run, with_part_of_budget
from rarms_iac.measuring.evidence import leaves_idle
from rarms_iac.measuring.experiment_log import ExperimentLog, data_log_path, read_experiment_log
from rarms_iac.measuring.findings import OCCUPIED
from rarms_iac.measuring.measure_request import USUAL_SEED, ExperimentResult
from rarms_iac.measuring.partitions import MeasuringResources, highest_reserve, host_resources, other_running_partitions
from rarms_iac.measuring.search.trials import conclude
from rarms_iac.measuring.session import (
    MeasuringSession,
    refuse_what_cannot_run,
    stop_own_partitions,
    stopped_to_measure,
)
from rarms_iac.measuring.setting_run import Site, other_processors, run_setting
from rarms_iac.measuring.strategies import (
    Method,
    Search,
    SettingCount,
    Strategy,
    Sweep,
    ThresholdCheck,
    goal_of,
    is_of_paper,
    strategy_of,
)
from rarms_iac.model.capacity import shared_processors
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import DIFFERENT, MISSING, Diagnostic
from rarms_iac.model.experiment import Experiment, ProcessorNumber, ProcessorSource, processor_number
from rarms_iac.model.loads import is_steady
from rarms_iac.model.outcomes import Conclusion, Measure, NotAchievable, NotResolved, SettingFailed, Stopped, Swept
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.setting import Setting, most_used
from rarms_iac.model.state import Partition
from rarms_iac.model.wording import counted
from rarms_iac.planner.groups import groups_of
from rarms_iac.planner.planning_findings import STALE
from rarms_iac.planner.verdicts import hardest
from rarms_iac.providers.measuring import PartitionWork
from rarms_iac.statistics.curves import curves_of, least_reserve


@dataclass(frozen=True, slots=True, kw_only=True)
class Availability:
    """What an experiment can get of its host, and what is in the way there."""

    resources: MeasuringResources
    running: tuple[Partition, ...]  # they run during the experiment, and rarms does not stop them
    highest_reserve: ReservePercent  # the highest CR that the host can give


def run_experiment(session: MeasuringSession, experiment: Experiment, method: Method) -> ExperimentResult:
    """Measure the settings of an experiment that its data log does not hold yet.

    Returns:
        How it ended, with every setting that counts, recorded ones included.

    Raises:
        UseCaseError: The host is busy or has other reservations (refused); it has no room, there is nothing to run or
            to search for, or the log is damaged (negative).
        HostError: The host did not do what was asked.
    """
    path, reporter = data_log_path(session.hosts, experiment), session.control.reporter
    with session.control.stop.gently(), hold_data_log(session.hosts.folder, path, session.lock_timeout_ms):
        experiment = with_part_of_budget(experiment, session.host_of(experiment).scheduler_memory_ms)
        experiment = with_observed_processors(session, experiment)
        says_duration = not isinstance(method, ThresholdCheck)  # tuning reports its own questions
        while True:
            run = _begin(session, experiment, method, says_duration=says_duration)
            answer = measure_settings(run)
            if run.available.running and (isinstance(answer, ProcessorNumber) or answer.new):
                reporter.findings([_busy_warning(experiment, run.available.running)])
            if isinstance(answer, ExperimentResult):
                break
            says_duration = False
            if experiment.processors_from is ProcessorSource.HOST:
                reporter.message(_describe_number(experiment, answer.number))
            else:
                finding = findings.more_processors(experiment, answer.number, session.hosts.manifest.places)
                reporter.findings([finding], session.hosts.manifest.sources)
                says_duration = not isinstance(method, ThresholdCheck)  # what was said counted for one curve
            experiment = experiment.with_processors(answer)
        if experiment.processors_from is ProcessorSource.HOST and most_used(answer.settings) is not None:
            experiment = replace(experiment, processors_from=ProcessorSource.USED)  # all of the host's are
        return replace(answer, experiment=experiment)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentRun:
    """An experiment with all that decides which settings are run, and how."""

    session: MeasuringSession
    experiment: Experiment
    method: Method
    strategy: Strategy
    log: ExperimentLog
    available: Availability
    count: SettingCount | None  # of the settings that are still to be run; None: as many as the strategy asks for
    says_duration: bool = False


def measure_settings(run: ExperimentRun) -> ExperimentResult | ProcessorNumber:
    """Run settings until the strategy has its answer; P1 and P2 are there only meanwhile.

    A strategy is a pure function of the recorded settings, so a run that was killed goes on by asking it again. It asks
    for a recorded setting again only where that is not finished, or where all is to be measured again.

    Returns:
        How it ended, with all settings that count; or the number of processors that P1 was seen to use, where it has
        another one: what was measured so far is no curve of it.

    Raises:
        UseCaseError: As of `stop_what_is_in_the_way`.
        HostError: The host did not do what was asked; what is recorded stays.
        OSError: The log cannot be written.
    """
    session, experiment, known, new = run.session, run.experiment, run.log.known, 0
    reporter, times = session.control.reporter.settings, session.wall_times
    remeasurement = session.remeasurements.get(run.log.path)
    again = None if remeasurement is None else remeasurement.seed
    seed = again or session.seed or max((each.seed for each in known.runs), default=0) or USUAL_SEED

    def ended(conclusion: Conclusion) -> ExperimentResult:
        return ExperimentResult(
            experiment=experiment,
            conclusion=conclusion,
            settings=known.settings,
            new=new,
            planned=least_shown(experiment, known.settings),
            log=run.log.path.as_posix(),
        )

    reporter.experiment_started(experiment, known.settings)
    with ExitStack() as ends:
        ends.callback(reporter.experiment_ended)
        site: Site | None = None
        while True:
            decision = run.strategy.decide(known.seen_with(again))
            if not isinstance(decision, Measure):
                if again is None:
                    return ended(decision)
                again = None  # all is measured again: now it decides by all that counts
                continue
            if run.count is not None and new >= run.count.most:
                return ended(conclude(known.settings, goal_of(experiment), run.count.most))
            if session.control.stop.should_stop():
                return ended(Stopped())
            if site is None:
                site = _prepared(run, seed)
                ends.enter_context(site.partitions())
            began, remaining = times.clock(), times.remaining(experiment, run.count, new, running=1)
            reporter.setting_started(experiment, decision.reserve, remaining)
            setting = run_setting(site, decision, known)
            if not isinstance(setting, Setting):
                return ended(setting)
            times.add(experiment, times.clock() - began)
            run.log.add(setting, tuple(each.shown_name for each in run.available.running))
            known, new = known.with_run(setting), new + 1
            remaining = times.remaining(experiment, run.count, new, running=0)
            reporter.setting_ended(experiment, known.at(setting.reserve), remaining)
            if (number := other_processors(experiment, setting.used_processors)) is not None:
                return ProcessorNumber(number=number, source=ProcessorSource.USED)


def least_shown(experiment: Experiment, settings: Sequence[Setting]) -> ReservePercent | None:
    """Return the least CR that these settings show to be enough, which a plan reserves; None: they show none."""
    return least_reserve(curves_of(settings, experiment.runs, experiment.apts))


def _prepared(run: ExperimentRun, seed: int) -> Site:
    """Return where the settings run: what is in the way there is refused or stopped, and the duration is told."""
    session, experiment, available = run.session, run.experiment, run.available
    stop_what_is_in_the_way(session, experiment, run.method, available)
    if run.says_duration and run.count is not None:
        host = session.host_of(experiment)
        earlier, seconds = run.log.known.settings, session.wall_times.comparable(experiment)
        line = forecast(experiment, run.count, earlier, seconds, host.scheduler_memory_ms)
        session.control.reporter.message(line)
    return Site(
        host=session.host_of(experiment),
        experiment=experiment,
        resources=available.resources,
        seed=seed,
        control=session.control,
        others=tuple(_work_of_others(session.hosts, available.running)),
    )


def with_observed_processors(session: MeasuringSession, experiment: Experiment) -> Experiment:
    """Return the experiment with the number of processors that its components were seen to use, if that is known.

    Args:
        experiment: One for which the manifest fixes the number, or tuning its members', stays as it is.
    """
    if experiment.processors_from in {ProcessorSource.MANIFEST, ProcessorSource.MEMBERS}:
        return experiment
    facts = session.host_of(experiment).platform_facts()
    used = used_processors(session.hosts.system, experiment.host, files_of(session.hosts.manifest), facts)
    return experiment.with_processors(
        processor_number(experiment.members, None, experiment.host.logical_processors, used)
    )


def _describe_number(experiment: Experiment, number: int) -> str:
    before = experiment.setup.processors
    return f"{experiment.name} uses {counted(number, 'processor')}; measuring with {number} VP instead of {before}."


def _begin(session: MeasuringSession, experiment: Experiment, method: Method, *, says_duration: bool) -> ExperimentRun:
    """Look at the log and the host, and choose settings for as many processors as the experiment has."""
    available = available_on_host(session, experiment)
    log = read_experiment_log(session, experiment)
    if log.changed:
        _refuse_other_hardware(session, experiment, log)
        changes = "; ".join(map(str, log.changed))
        session.control.reporter.message(
            f"Changed since {log.path.as_posix()} was measured: {changes}. Its results stay there and do not count."
        )
    again = session.remeasurements.get(log.path)
    recorded = [each for each in log.known.runs if again is None or each.seed == again.seed]
    shows_processors = experiment.processors_from is ProcessorSource.HOST
    count = settings_to_run(method, recorded, available.highest_reserve, shows_processors=shows_processors)
    _refuse_without_threshold(session.hosts, experiment, method)
    # Where other partitions are in the way, `_refuse_host` names them before the first run. Do not end earlier for lack
    # of room, which says less.
    most = 100 if available.running and not session.on_busy_host else available.highest_reserve
    return ExperimentRun(
        session=session,
        experiment=experiment,
        method=method,
        strategy=strategy_of(method, goal_of(experiment), most),
        log=log,
        available=available,
        count=count,
        says_duration=says_duration,
    )


def _refuse_other_hardware(session: MeasuringSession, experiment: Experiment, log: ExperimentLog) -> None:
    """Refuse to measure on other hardware what was measured on some, unless all is to be measured again.

    Raises:
        UseCaseError: The data log holds for another machine (negative).
    """
    changed = tuple(change for change in log.changed if change.is_of_hardware)
    if not changed or log.path in session.remeasurements:
        return
    host, path = experiment.host, log.path.as_posix()
    place = session.hosts.manifest.places.key("hosts", host.name)
    changes = tuple(map(str, changed))
    finding = STALE.at(
        place,
        "{log} was measured on other hardware than {host} has now: {_changes}.",
        stale_advice(changed, experiment.setup.members),
        address=f"host/{host.name}",
        log=path,
        host=host.name,
        changed=changes,
        _changes="; ".join(changes),
    )
    raise UseCaseError(Outcome.NEGATIVE, [finding], session.hosts.manifest.sources)


def available_on_host(session: MeasuringSession, experiment: Experiment) -> Availability:
    """Look at the host; partitions of the application are stopped, unless it is to be measured with them."""
    observed = session.host_of(experiment).observe()
    state = observed if session.on_busy_host else stopped_to_measure(observed, experiment.application)
    resources = host_resources(experiment.host, state, experiment.application)
    return Availability(
        resources=resources,
        running=other_running_partitions(state),
        highest_reserve=highest_reserve(resources, experiment.setup),
    )


def _refuse_without_threshold(hosts: Hosts, experiment: Experiment, method: Method) -> None:
    """Refuse to look for a reservation of a member that has no threshold.

    Raises:
        UseCaseError: There is such a member (negative).
    """
    if not isinstance(method, Search):
        return
    for member in experiment.members:
        if not member.apt:
            place = hosts.manifest.places.key("components", member.name)
            advice = prose(
                "Give it one, or measure chosen settings: ",
                command("measure", member.name, from_="10%", to="100%"),
                ".",
            )
            raise UseCaseError(
                Outcome.NEGATIVE,
                [
                    MISSING.at(
                        place,
                        "{component} has no `apt`.",
                        advice,
                        address=f"component/{member.name}",
                        component=member.name,
                    )
                ],
                hosts.manifest.sources,
            )


def stop_what_is_in_the_way(
    session: MeasuringSession, experiment: Experiment, method: Method, available: Availability | None = None
) -> None:
    """Refuse what cannot be measured, then stop what is in the way; nothing is run.

    `run_experiment` calls it only where the data log does not hold every setting already.

    Args:
        available: What was seen of the host; None: it is looked at now.

    Raises:
        UseCaseError: A member or a load cannot run on the host, or the host is as `_refuse_host` says; partitions of
            the application run, and may not be stopped (refused).
    """
    host = session.host_of(experiment)
    members = {member.name: member for member in experiment.members}
    refuse_what_cannot_run(session, host, components=members, loads={experiment.setup.interference: experiment.load})
    _refuse_host(session, experiment, method, available or available_on_host(session, experiment))
    if not session.on_busy_host:
        stop_own_partitions(session, host)


def _refuse_host(session: MeasuringSession, experiment: Experiment, method: Method, available: Availability) -> None:
    """Refuse a host that is busy, has reservations that the paper does not know, or has no room.

    Raises:
        UseCaseError: The host is not free to measure, or it has reservations that the paper does not know (refused);
            there is no room (negative).
    """
    host = experiment.host.name
    if available.running and not session.on_busy_host:
        running = tuple(partition.shown_name for partition in available.running)
        template = "On {host} these run, and would change what is measured: {_names}."
        advice = "Stop them on the host. Or give --on-busy-host: the log says so."
        finding = OCCUPIED.of_host(host, template, advice, partitions=running, _names=", ".join(running))
        raise UseCaseError(Outcome.REFUSED, [finding])
    if is_of_paper(method) and not available.resources.unreserved:
        template = "On {host} a part of the processors is kept for the host or reserved by other machines."
        advice = "Use the default strategy, or free the host: `keep_for_host: { processor: 0 % }`."
        raise UseCaseError(Outcome.REFUSED, [OCCUPIED.of_host(host, template, advice)])
    asked_reserve = max(method.reserves, default=0) if isinstance(method, Sweep) else 0
    if available.highest_reserve == 0 or asked_reserve > available.highest_reserve:
        advice = "Stop other machines, lower keep_for_host, or give the component less memory."
        if available.highest_reserve:
            advice = f"End there: `--to {available.highest_reserve}%`. Or stop other machines, or lower keep_for_host."
        finding = OCCUPIED.of_host(
            host,
            "{host} can give P1, the partition of {_experiment}, at most {highest_reserve_percent} % of each of "
            "its {processors} processors, and P2, that of the load, some memory, too.",
            advice,
            highest_reserve_percent=available.highest_reserve,
            asked_reserve_percent=asked_reserve,
            processors=experiment.setup.processors,
            _experiment=experiment.name,
        )
        raise UseCaseError(Outcome.NEGATIVE, [finding])


def _work_of_others(hosts: Hosts, running: Sequence[Partition]) -> Iterator[PartitionWork]:
    """Yield the work of the application's partitions that go on running, their components under names of their own.

    What other partitions run is not known: a simulated host has them idle.
    """
    application = hosts.system.application.name
    names = {
        partition.mark.name for partition in running if partition.mark and partition.mark.application == application
    }
    for group in groups_of(hosts.system):
        if group.name in names:
            members = tuple(
                replace(member, name=f"{member.name} in {group.name}")
                for member in group.members
                if member.simulation is not None
            )
            yield PartitionWork(partition=group.name, components=members)


def _busy_warning(experiment: Experiment, running: Sequence[Partition]) -> Diagnostic:
    names = tuple(partition.shown_name for partition in running)
    return DIFFERENT.of_host(
        experiment.host.name,
        "{_experiment} was measured while these ran on {host}: {_names}. Its log says so.",
        "Measure it again on a quiet host with --again: then this no longer counts.",
        partitions=names,
        _experiment=experiment.name,
        _names=", ".join(names),
    )


def by_partition(experiments: Sequence[Experiment]) -> tuple[tuple[Experiment, ...], ...]:
    """Put the experiments of the same components on the same host together, one a load, in the order given.

    Args:
        experiments: Those of the same components and host follow one another.

    Returns:
        Groups that differ in nothing but the load.
    """
    groups = groupby(experiments, key=lambda each: (each.host.name, each.setup.members))
    return tuple(tuple(group) for _, group in groups)


def measure_with_each_load(
    session: MeasuringSession, experiments: Sequence[Experiment], method: Method
) -> tuple[ExperimentResult, ...]:
    """Find the least reservation that meets the thresholds under every load.

    Args:
        experiments: The same components on the same host, one a load.

    Returns:
        A result for each load that was measured.
    """
    results: tuple[ExperimentResult, ...] = ()
    while (asked := next_experiment(experiments, results, method)) is not None:
        results = with_result(experiments, results, run_experiment(session, *asked))
    return results


def next_experiment(
    experiments: Sequence[Experiment], results: Sequence[ExperimentResult], method: Method
) -> tuple[Experiment, Method] | None:
    """Choose the next load, and its method.

    The first load has a search. Each further one is asked whether the answer so far is enough with it, and searched
    above only where it is not; so the last answer is the greatest. A sweep is run with each.

    Args:
        experiments: The same components on the same host, one a load.

    Returns:
        None: all are measured, or there is no answer that another load could confirm.
    """
    if len(results) == len(experiments) or (
        results and isinstance(results[-1].conclusion, NotAchievable | NotResolved | SettingFailed | Stopped)
    ):
        return None
    floor = (results[-1].reserve if results else None) or 0
    experiment = _after(results, experiments[len(results)])
    return experiment, replace(method, floor=floor) if isinstance(method, Search) else method


def with_result(
    experiments: Sequence[Experiment], results: tuple[ExperimentResult, ...], result: ExperimentResult
) -> tuple[ExperimentResult, ...]:
    """Add the result of the next load.

    Returns:
        None at all if the components used more processors with this load: then all are measured with so many.
    """
    if results and result.processors != results[-1].processors:
        return ()
    so_far = results[-1].reserve if results else None
    return (*results, replace(result, so_far=so_far, of_loads=len(experiments)))


def _after(results: Sequence[ExperimentResult], experiment: Experiment) -> Experiment:
    """Charge the budget with the time of settings under the earlier loads, which share it."""
    spent_ms: defaultdict[ReservePercent, float] = defaultdict(float)
    for setting in (setting for result in results for setting in result.settings):
        spent_ms[setting.reserve] += setting.host_ms
    return replace(experiment, budget=replace(experiment.budget, spent_ms=spent_ms))


def leave_idle(results: Sequence[ExperimentResult]) -> bool:
    """Tell whether every load of the results was seen to leave processors idle that it could take.

    Args:
        results: Of the same components, one a load.

    Returns:
        False where one of them sleeps by design: such loads are not judged by idle time.
    """
    return all(is_steady(each.experiment.load) and bool(idle_settings(each)) for each in results)


def idle_settings(result: ExperimentResult) -> list[Setting]:
    """Return the settings at the answer of a result in which its load left processors idle."""
    host = result.experiment.host
    shared = shared_processors(host, host.logical_processors)
    at_answer = [setting for setting in result.settings if setting.reserve == result.reserve]
    return [setting for setting in at_answer if leaves_idle(setting.evidence, shared)]


def decisive(results: Sequence[ExperimentResult]) -> ExperimentResult:
    """Find the result that decides the answer.

    Args:
        results: Of the same components, in the order in which loads were measured; at least one.

    Returns:
        The first with the answer of the last; where the last has none, the last. Of sweeps that by which a plan
            reserves most.
    """
    last = results[-1]
    if isinstance(last.conclusion, Swept):
        return results[hardest([each.planned for each in results])]
    return last if last.reserve is None else next(each for each in results if each.reserve == last.reserve)
