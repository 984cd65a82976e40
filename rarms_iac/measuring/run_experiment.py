"""One experiment on a held host: what is in the way is refused or stopped, then setting after setting is run.

Begin at `run_experiment`. `each_load` asks it for one load after the other; `availability` looks at the host.
"""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace

from rarms_iac.app.data_logs import files_of, stale_advice, used_processors
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.measurement_files import hold_data_log
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.measuring.availability import (
    Availability,
    available_on_host,
    stop_what_is_in_the_way,
    with_load_parts,
    work_of_others,
)
from rarms_iac.measuring.duration import (
    Announced,
    describe_settings,
    nothing_announced,
    settings_to_run,
    time_of_settings,
    with_part_of_budget,
)
from rarms_iac.measuring.experiment_log import ExperimentLog, data_log_path, read_experiment_log
from rarms_iac.measuring.measure_request import USUAL_SEED, ExperimentResult
from rarms_iac.measuring.search.crossings import begun_before
from rarms_iac.measuring.search.trials import conclude, conditions_at
from rarms_iac.measuring.session import MeasuringSession
from rarms_iac.measuring.setting_run import Site, other_processors, run_setting
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
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.experiment import Experiment, ProcessorNumber, ProcessorSource, processor_number
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.outcomes import Conclusion, ExperimentDecision, Measure, Stopped, Sufficient
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.setting import Setting, most_used
from rarms_iac.model.state import Partition
from rarms_iac.planner.planning_findings import STALE
from rarms_iac.statistics.curves import curves_of, least_reserve
from rarms_iac.texts.findings import DIFFERENT, MISSING
from rarms_iac.texts.messages import counted


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
            is_first = experiment.processors_from is ProcessorSource.HOST
            if not (is_first and isinstance(method, FirstPass)):  # it says so for all together
                reporter.message(_describe_number(experiment, answer.number))
            says_duration = not is_first and _says_duration(method)  # what was said counted for one curve
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

    reporter.experiment_started(experiment, known.settings)
    with ExitStack() as ends:
        ends.callback(reporter.experiment_ended)
        site: Site | None = None
        announced = nothing_announced()
        while True:
            seen = known.seen_with(again)
            decision = run.strategy.decide(seen)
            if again is not None and not isinstance(decision, Measure):
                again = None  # all is measured again: now it decides by all that counts
                continue
            step = _next_step(run, decision, known.settings, new)
            if not isinstance(step, Measure):
                return _result(run, step, known.settings)
            if site is None:
                site = _prepared(run, seed)
                announced = _announce(run)
                ends.enter_context(site.partitions())
            began, remaining = times.clock(), times.remaining(experiment, run.count, new, running=1)
            reporter.setting_started(experiment, step.reserve, remaining)
            setting = run_setting(site, step, known, begun_before(step.reserve, seen))
            if not isinstance(setting, Setting):
                return _result(run, setting, known.settings)
            seconds = times.clock() - began
            times.add(experiment, seconds)
            run.log.add(setting, tuple(each.shown_name for each in run.available.running))
            known, new = known.with_run(setting), new + 1
            session.recorded.add((run.log.path, setting.reserve))
            remaining = times.remaining(experiment, run.count, new, running=0)
            reporter.setting_ended(experiment, known.at(setting.reserve), remaining)
            spent_ms = setting.host_ms if experiment.host.provider is ProviderKind.SIMULATED else 1000 * seconds
            announced.add(spent_ms)
            session.announced.add(spent_ms)
            if (number := other_processors(experiment, setting.used_processors)) is not None:
                return ProcessorNumber(number=number, source=ProcessorSource.USED)


def _next_step(
    run: ExperimentRun, decision: ExperimentDecision, settings: tuple[Setting, ...], new: int
) -> ExperimentDecision:
    """Return the decision of the strategy, or the end if there were enough settings or the user asked for an end."""
    if not isinstance(decision, Measure):
        return decision
    if run.count is not None and new >= run.count.most:
        return conclude(settings, goal_of(run.experiment), run.count.most)
    return Stopped() if run.session.control.stop.should_stop() else decision


def _result(run: ExperimentRun, conclusion: Conclusion, settings: tuple[Setting, ...]) -> ExperimentResult:
    """Return the end of an experiment; that of a first pass is provisional if verdicts do not show a reservation."""
    experiment, is_first_pass = run.experiment, isinstance(run.method, FirstPass)
    least = least_shown(experiment, settings)
    answer = conclusion.reserve if isinstance(conclusion, Sufficient) else None
    return ExperimentResult(
        experiment=experiment,
        conclusion=conclusion,
        settings=settings,
        run_now=frozenset(each.reserve for each in settings if (run.log.path, each.reserve) in run.session.recorded),
        planned=answer if is_first_pass and answer is not None else least,
        conditions=() if answer is None else conditions_at(settings, goal_of(experiment), answer),
        is_provisional=is_first_pass and (answer is None or least is None),
        log=run.log.path.as_posix(),
    )


def least_shown(experiment: Experiment, settings: Sequence[Setting]) -> ReservePercent | None:
    """Return the least CR that these settings show to be enough, which a plan reserves; None: they show none."""
    return least_reserve(curves_of(settings, experiment.runs, experiment.apts))


def _prepared(run: ExperimentRun, seed: int) -> Site:
    """Return the site of the settings, after obstacles there are refused or stopped."""
    session, experiment, available = run.session, run.experiment, run.available
    stop_what_is_in_the_way(session, experiment, run.method, available)
    return Site(
        host=session.host_of(experiment),
        experiment=experiment,
        resources=available.resources,
        seed=seed,
        control=session.control,
        others=tuple(work_of_others(session.hosts, available.running)),
    )


def _announce(run: ExperimentRun) -> Announced:
    """Report how many settings there are and how long they take, where this is asked for; return the longest time."""
    if not run.says_duration or run.count is None:
        return nothing_announced()
    session, experiment = run.session, run.experiment
    earlier, seconds = run.log.known.settings, session.wall_times.comparable(experiment)
    window_ms = session.host_of(experiment).scheduler_memory_ms
    times, say = time_of_settings(experiment, run.count, earlier, seconds, window_ms), session.control.reporter.message
    say(describe_settings(experiment, run.count, times))
    return Announced(work=f"{experiment.name} with {experiment.setup.interference}", most_ms=times[1], say=say)


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
    vps = counted(number, "VP")
    return f"{experiment.name} uses {counted(number, 'processor')}; measuring with {vps} instead of {before}."


def _begin(session: MeasuringSession, experiment: Experiment, method: Method, *, says_duration: bool) -> ExperimentRun:
    """Look at the log and the host, and choose settings for as many processors as the experiment has."""
    available = available_on_host(session, experiment)
    experiment = with_load_parts(session, experiment, method, available.resources)
    log = read_experiment_log(session, experiment)
    if log.changed:
        _refuse_other_hardware(session, experiment, log)
        changes = "; ".join(map(str, log.changed))
        session.control.reporter.message(
            f"Changed since {log.path.as_posix()} was measured: {changes}. rarms measures again and "
            "keeps the earlier results for comparison."
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
        "The hardware of {host} has changed since {log} was measured: {_changes}.",
        stale_advice(changed, experiment.setup.members),
        address=f"host/{host.name}",
        log=path,
        host=host.name,
        changed=changes,
        _changes="; ".join(changes),
    )
    raise UseCaseError(Outcome.NEGATIVE, [finding], session.hosts.manifest.sources)


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
                "Add an `apt`, or measure chosen settings: ",
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


def _busy_warning(experiment: Experiment, running: Sequence[Partition]) -> Diagnostic:
    names = tuple(partition.shown_name for partition in running)
    return DIFFERENT.of_host(
        experiment.host.name,
        "These partitions ran on {host} during the measurement of {_experiment}: {_names}. The log records them.",
        "Measure again with --again while nothing else runs on the host.",
        partitions=names,
        _experiment=experiment.name,
        _names=", ".join(names),
    )
