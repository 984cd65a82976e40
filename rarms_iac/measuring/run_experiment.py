"""One experiment on a held host: what is in the way is refused or stopped, then setting after setting is run.

Begin at `run_experiment`; `measure_with_each_load` asks it for one load after the other. Which experiments there are,
and in which order, is for `measure` and for tuning to say.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
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
from rarms_iac.measuring.partitions import (
    MeasuringResources,
    highest_reserve,
    host_resources,
    other_running_partitions,
    parts_that_fit,
)
from rarms_iac.measuring.search.crossings import begun_before
from rarms_iac.measuring.search.trials import conclude, conditions_at
from rarms_iac.measuring.session import MeasuringSession, refuse_what_cannot_run
from rarms_iac.measuring.setting_run import Site, other_processors, run_setting
from rarms_iac.measuring.stopping import stop_own_partitions, stopped_to_measure
from rarms_iac.measuring.strategies import (
    FirstPass,
    Method,
    Search,
    SettingCount,
    Strategy,
    Sweep,
    goal_of,
    is_of_paper,
    strategy_of,
)
from rarms_iac.measuring.units import describe_missing_part
from rarms_iac.model.capacity import shared_processors
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import DIFFERENT, MISSING, Diagnostic
from rarms_iac.model.experiment import Experiment, ProcessorNumber, ProcessorSource, processor_number
from rarms_iac.model.loads import is_steady
from rarms_iac.model.outcomes import (
    Conclusion,
    Condition,
    Measure,
    NotAchievable,
    NotResolved,
    SettingFailed,
    Stopped,
    Sufficient,
    Swept,
)
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
    """The resources of a host for an experiment, and the obstacles there."""

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
        says_duration = _says_duration(method)
        while True:
            run = _begin(session, experiment, method, says_duration=says_duration)
            answer = measure_settings(run)
            if run.available.running and (isinstance(answer, ProcessorNumber) or answer.new):
                reporter.findings([_busy_warning(experiment, run.available.running)])
            if isinstance(answer, ExperimentResult):
                break
            says_duration = False
            if experiment.processors_from is ProcessorSource.HOST:
                if not isinstance(method, FirstPass):  # it says so for all together
                    reporter.message(_describe_number(experiment, answer.number))
            else:
                finding = findings.more_processors(experiment, answer.number, session.hosts.manifest.places)
                reporter.findings([finding], session.hosts.manifest.sources)
                says_duration = _says_duration(method)  # what was said counted for one curve
            experiment = experiment.with_processors(answer)
        if experiment.processors_from is ProcessorSource.HOST and most_used(answer.settings) is not None:
            experiment = replace(experiment, processors_from=ProcessorSource.USED)  # all of the host's are
        return replace(answer, experiment=experiment)


def _says_duration(method: Method) -> bool:
    """Tell whether an experiment says how long it takes. Tuning reports its own questions; what confirms is short."""
    return isinstance(method, Sweep) or (isinstance(method, Search) and is_of_paper(method))


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
        another one: what was measured so far is not a curve of it.

    Raises:
        UseCaseError: As of `stop_what_is_in_the_way`.
        HostError: The host did not do what was asked; what is recorded stays.
        OSError: The log cannot be written.
    """
    session, experiment, new = run.session, run.experiment, 0
    known = run.log.seen if isinstance(run.method, FirstPass) else run.log.known
    reporter, times = session.control.reporter.settings, session.wall_times
    remeasurement = None if isinstance(run.method, FirstPass) else session.remeasurements.get(run.log.path)
    again = None if remeasurement is None else remeasurement.seed
    seed = again or session.seed or max((each.seed for each in known.runs), default=0) or USUAL_SEED

    def ended(conclusion: Conclusion) -> ExperimentResult:
        return ExperimentResult(
            experiment=experiment,
            conclusion=conclusion,
            settings=known.settings,
            new=new,
            planned=_planned(run, conclusion, known.settings),
            conditions=_conditions(experiment, conclusion, known.settings),
            is_provisional=_is_provisional(run, conclusion, known.settings),
            log=run.log.path.as_posix(),
        )

    reporter.experiment_started(experiment, known.settings)
    with ExitStack() as ends:
        ends.callback(reporter.experiment_ended)
        site: Site | None = None
        while True:
            seen = known.seen_with(again)
            decision = run.strategy.decide(seen)
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
            setting = run_setting(site, decision, known, begun_before(decision.reserve, seen))
            if not isinstance(setting, Setting):
                return ended(setting)
            times.add(experiment, times.clock() - began)
            run.log.add(setting, tuple(each.shown_name for each in run.available.running))
            known, new = known.with_run(setting), new + 1
            remaining = times.remaining(experiment, run.count, new, running=0)
            reporter.setting_ended(experiment, known.at(setting.reserve), remaining)
            if (number := other_processors(experiment, setting.used_processors)) is not None:
                return ProcessorNumber(number=number, source=ProcessorSource.USED)


def _is_provisional(run: ExperimentRun, conclusion: Conclusion, settings: Sequence[Setting]) -> bool:
    """Tell whether an end is one of estimates alone."""
    if not isinstance(run.method, FirstPass):
        return False
    return not isinstance(conclusion, Sufficient) or least_shown(run.experiment, settings) is None


def _planned(run: ExperimentRun, conclusion: Conclusion, settings: Sequence[Setting]) -> ReservePercent | None:
    if isinstance(run.method, FirstPass) and isinstance(conclusion, Sufficient):
        return conclusion.reserve
    return least_shown(run.experiment, settings)


def _conditions(experiment: Experiment, conclusion: Conclusion, settings: Sequence[Setting]) -> tuple[Condition, ...]:
    """Return the conditions on which the thresholds are met at the answer; none without an answer."""
    if not isinstance(conclusion, Sufficient):
        return ()
    return conditions_at(settings, goal_of(experiment), conclusion.reserve)


def least_shown(experiment: Experiment, settings: Sequence[Setting]) -> ReservePercent | None:
    """Return the least CR that these settings show to be enough, which a plan reserves; None: they show none."""
    return least_reserve(curves_of(settings, experiment.runs, experiment.apts))


def _prepared(run: ExperimentRun, seed: int) -> Site:
    """Return the site of the settings, after obstacles there are refused or stopped and the duration is reported."""
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


def with_load_parts(
    session: MeasuringSession, experiment: Experiment, method: Method, resources: MeasuringResources
) -> Experiment:
    """Return the experiment with as many parts of P2 as its load has by this method, and as the host has memory for.

    A sweep and the paper's strategy have the paper's P2, in one part, unless settings with two are recorded: a plan
    goes by these, and theirs are to join them.

    Raises:
        UseCaseError: The data log is damaged (negative).
    """
    several = in_load_parts(experiment, resources)
    if several.load_parts > 1 and has_one_p2(method) and read_experiment_log(session, several).valid is None:
        return experiment
    return several


def has_one_p2(method: Method) -> bool:
    """Tell whether a method has the P2 of the paper: a sweep, and the paper's strategy."""
    return isinstance(method, Sweep) or is_of_paper(method)


def in_load_parts(experiment: Experiment, resources: MeasuringResources) -> Experiment:
    """Return the experiment with as many parts of P2 as a search has, and as the host has memory for."""
    parts = parts_that_fit(resources, experiment.usual_load_parts, experiment.setup.memory)
    return replace(experiment, load_parts=parts)


def resources_by_host(session: MeasuringSession, experiments: Sequence[Experiment]) -> dict[str, MeasuringResources]:
    """Look at each host of these experiments once."""
    by_host = {each.host.name: each for each in experiments}
    return {name: available_on_host(session, each).resources for name, each in by_host.items()}


def describe_missing_parts(session: MeasuringSession, experiments: Sequence[Experiment]) -> Iterator[str]:
    """Yield a sentence for each host without memory for the second partition of some loads."""
    in_two = [each for each in experiments if each.usual_load_parts > 1]
    for host, resources in resources_by_host(session, in_two).items():
        in_parts = [in_load_parts(each, resources) for each in in_two if each.host.name == host]
        if loads := [each.setup.interference for each in in_parts if each.load_parts == 1]:
            yield describe_missing_part(host, loads)


def _describe_number(experiment: Experiment, number: int) -> str:
    before = experiment.setup.processors
    return f"{experiment.name} uses {counted(number, 'processor')}; measuring with {number} VP instead of {before}."


def _begin(session: MeasuringSession, experiment: Experiment, method: Method, *, says_duration: bool) -> ExperimentRun:
    """Look at the log and the host, and choose settings for as many processors as the experiment has."""
    available = available_on_host(session, experiment)
    experiment = with_load_parts(session, experiment, method, available.resources)
    log = read_experiment_log(session, experiment)
    if log.changed:
        _refuse_other_hardware(session, experiment, log)
        changes = "; ".join(map(str, log.changed))
        session.control.reporter.message(
            f"Changed since {log.path.as_posix()} was measured: {changes}. rarms keeps its results but does "
            "not use them."
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
    if not isinstance(method, Search | FirstPass):
        return
    for member in experiment.members:
        if not member.apt:
            place = hosts.manifest.places.key("components", member.name)
            advice = prose(
                "Add one, or measure chosen settings: ",
                command("measure", member.name, from_="10%", to="100%"),
                ".",
            )
            raise UseCaseError(
                Outcome.NEGATIVE,
                [
                    MISSING.at(
                        place,
                        "{component} does not have an `apt`.",
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
        template = "These run on {host} and would change the measurement: {_names}."
        advice = "Stop them on the host. To measure anyway, give --on-busy-host; the log records it."
        finding = OCCUPIED.of_host(host, template, advice, partitions=running, _names=", ".join(running))
        raise UseCaseError(Outcome.REFUSED, [finding])
    if is_of_paper(method) and not available.resources.unreserved:
        template = "A part of the processors of {host} is kept for the host or reserved by other machines."
        advice = "Use the default strategy, or free the host: `keep_for_host: { processor: 0 % }`."
        raise UseCaseError(Outcome.REFUSED, [OCCUPIED.of_host(host, template, advice)])
    asked_reserve = max(method.reserves, default=0) if isinstance(method, Sweep) else 0
    if available.highest_reserve == 0 or asked_reserve > available.highest_reserve:
        advice = "Stop other machines, lower keep_for_host, or give the component less memory."
        if available.highest_reserve:
            advice = (
                f"Measure up to there: `--to {available.highest_reserve}%`. Or stop other machines, or lower "
                "keep_for_host."
            )
        finding = OCCUPIED.of_host(
            host,
            (
                "{host} can give P1, the partition of {_experiment}, at most {highest_reserve_percent} % of "
                "each of its {processors} processors, because P2, the partition of the load, also needs memory."
            ),
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
        "{_experiment} was measured while these ran on {host}: {_names}. The log records it.",
        "Measure again on a quiet host with --again.",
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
    session: MeasuringSession,
    experiments: Sequence[Experiment],
    method: Method,
    begin: ReservePercent = 0,
    ended: Callable[[ExperimentResult], None] = lambda _result: None,
) -> tuple[ExperimentResult, ...]:
    """Find the least reservation that meets the thresholds under every load.

    Args:
        experiments: The same components on the same host, one a load.
        begin: The answer of the first pass, at which the search with the first load begins; 0: there is none.
        ended: Told the result with each load, once.

    Returns:
        A result for each load that was measured.
    """
    results: tuple[ExperimentResult, ...] = ()
    if isinstance(method, Search):
        method = replace(method, begin=begin)
    while (asked := next_experiment(experiments, results, method)) is not None:
        result = run_experiment(session, *asked)
        if len(results) < len(experiments):
            ended(result)
        results = with_result(experiments, results, result)
    return results


def next_experiment(
    experiments: Sequence[Experiment], results: Sequence[ExperimentResult], method: Method
) -> tuple[Experiment, Method] | None:
    """Choose the next load, and its method.

    The first load has a search. Each further one is asked whether the answer so far is enough with it, and searched
    above only where it is not; so the last answer is the greatest. A sweep is run with each. In the end the settings at
    the answer of a search go on until nothing has a condition that more samples would lift.

    Args:
        experiments: The same components on the same host, one a load.

    Returns:
        None: all are measured, or there is no answer that another load could confirm.
    """
    if results and isinstance(results[-1].conclusion, NotAchievable | NotResolved | SettingFailed):
        return None
    if any(each.stopped for each in results):
        return None
    floor = (results[-1].reserve if results else None) or 0
    if len(results) < len(experiments):
        experiment = _after(results, experiments[len(results)])
        return experiment, replace(method, floor=floor) if isinstance(method, Search | FirstPass) else method
    if not isinstance(method, Search) or is_of_paper(method):
        return None
    for number, result in enumerate(results):
        if result.reserve == floor and result.conditions and not result.is_confirmed:
            others = (*results[:number], *results[number + 1 :])
            return _after(others, experiments[number]), replace(method, floor=floor, confirms=True)
    return None


def with_result(
    experiments: Sequence[Experiment], results: tuple[ExperimentResult, ...], result: ExperimentResult
) -> tuple[ExperimentResult, ...]:
    """Add the result of the next load, or of one that was measured further to confirm the answer.

    Returns:
        None at all if the components used more processors with this load: then all are measured with so many. A result
        that does not confirm the answer is the last one; one that was stopped leaves the answer as it is.
    """
    if results and result.processors != results[-1].processors:
        return ()
    if len(results) < len(experiments):
        so_far = results[-1].reserve if results else None
        return (*results, replace(result, so_far=so_far, of_loads=len(experiments)))
    number = next(at for at, each in enumerate(results) if each.interference == result.interference)
    before = results[number]
    if result.stopped:
        return (*results[:number], replace(before, is_interrupted=True), *results[number + 1 :])
    further = replace(
        result, so_far=before.so_far, of_loads=before.of_loads, new=max(before.new, result.new), is_confirmed=True
    )
    if result.reserve != before.reserve:
        return (*results[:number], replace(further, is_confirmed=False))
    return (*results[:number], further, *results[number + 1 :])


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
