"""Measuring: experiments with their data logs, on hosts that are held meanwhile; with `--again` once more.

Begin at `measure_components`. A single experiment is `run_experiment`'s.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from fractions import Fraction
from itertools import groupby
from pathlib import Path
from typing import Literal

from rarms_iac.app.control import UNATTENDED, Control
from rarms_iac.app.declared_hosts import partitions_without_log, totals_at_hand
from rarms_iac.app.hosts import Hosts, host_errors
from rarms_iac.app.measurement_files import hold_data_log
from rarms_iac.app.report_measurements import component_verdicts, missing_on
from rarms_iac.app.report_model import ComponentVerdict
from rarms_iac.app.scripts import PlanScript
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.measuring.availability import (
    describe_missing_parts,
    has_one_p2,
    in_load_parts,
    resources_by_host,
    stop_what_is_in_the_way,
    with_load_parts,
)
from rarms_iac.measuring.duration import Announced
from rarms_iac.measuring.each_load import by_partition, decisive, idle_settings, leave_idle, measure_with_each_load
from rarms_iac.measuring.experiment_log import ExperimentLog, data_log_path, read_experiment_log
from rarms_iac.measuring.findings import findings_of, unused_processors
from rarms_iac.measuring.level_prompt import Further, LevelPrompt, SessionEnded, ask_levels
from rarms_iac.measuring.measure_request import (
    ExperimentResult,
    MeasureRequest,
    describe_request,
    experiments_of_request,
    has_passes,
    method_of,
    refuses_weak_loads,
    settings_of,
)
from rarms_iac.measuring.on_robot import ExperimentListener, ask_robot
from rarms_iac.measuring.other_work import weak_answer, work_of_settings
from rarms_iac.measuring.partitions import host_resources
from rarms_iac.measuring.passes import (
    begin_with_decisive,
    first_pass,
    in_order_of,
    is_of,
    later_passes,
    with_first_pass,
)
from rarms_iac.measuring.session import MeasuringSession, hold_measuring_hosts, record_reservations, start_warnings_of
from rarms_iac.measuring.setting_run import shapes_for, work_in_test_partitions
from rarms_iac.measuring.stopping import starting_again
from rarms_iac.measuring.strategies import Method, Search
from rarms_iac.measuring.units import Units, describe_work, is_simulated, longest_later_ms, longest_ms
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.layout import LookedUp
from rarms_iac.model.outcomes import SettingFailed
from rarms_iac.model.output import Internal
from rarms_iac.model.totals import HostTotals, totals_of
from rarms_iac.providers.measuring import ScriptedMeasuringHost
from rarms_iac.storage.datalog.files import append_remeasurement, end_remeasurement
from rarms_iac.storage.datalog.log import Remeasurement


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasureOutcome:
    """The results of all experiments that were begun, and the experiments that an early end left out."""

    kind: Literal["measure"] = "measure"
    experiments: tuple[ExperimentResult, ...]
    findings: tuple[Diagnostic, ...]
    not_begun: tuple[Experiment, ...] = ()
    totals: Mapping[str, HostTotals] = field(default_factory=dict)  # by host that was measured on, as a plan has them
    fixed_lp: Mapping[str, Fraction] = field(default_factory=dict)  # by host: LPs of it that the manifest itself fixes
    unknown: Mapping[str, tuple[ComponentVerdict, ...]] = field(default_factory=dict)  # by host: what is not in them
    ended: Internal[bool] = False  # the user asked for an end at a question

    @property
    def partitions(self) -> tuple[tuple[ExperimentResult, ...], ...]:
        """The results of the same components on the same host, one a load, in the order of the experiments."""
        groups = groupby(self.experiments, key=lambda each: (each.host, each.components))
        return tuple(tuple(group) for _, group in groups)

    @property
    def stopped(self) -> bool:
        """Whether an end was asked for."""
        return any(result.stopped for result in self.experiments)


EVERYTHING = MeasureRequest()
"""Each component with a threshold, on one host of each platform."""


def measure_components(
    hosts: Hosts,
    request: MeasureRequest = EVERYTHING,
    control: Control = UNATTENDED,
    prompt: LevelPrompt | None = None,
) -> MeasureOutcome:
    """Find the least reservations at which components meet their thresholds, by running them.

    Each setting is recorded in its data log when it is complete. A run that was stopped or killed goes on when the
    same is asked again; no recorded setting is run twice. What follows for the components is written into the
    configuration logs.

    Args:
        hosts: Where it may be measured; they are held meanwhile.
        control: The caller's part. Partitions of the application that were stopped start again afterwards; after a
            kill, with the next `measure`, `start` or `apply`.
        prompt: Asks for a level of performance after each experiment; None: there are no questions.

    Returns:
        A result for each experiment that was begun. One that fails does not end the others.

    Raises:
        RequestError: A name is not in the manifest.
        UseCaseError: No host can be measured on (failed); a host is busy, held or has other reservations (refused);
            there is no threshold, no room or nothing to run, or a log is damaged (negative).
    """
    if any(hosts.robot(name) for name in hosts.chosen):
        if prompt is not None:
            raise RequestError(
                "--interactive does not work on a robot.",
                prose(
                    "Omit --interactive. Afterwards choose a level: ", command("select", "COMPONENT", at="LEVEL"), "."
                ),
            )
        return _measure_on_each(hosts, request, control)
    session = MeasuringSession(
        hosts=hosts,
        control=control,
        seed=request.seed,
        on_busy_host=request.on_busy_host,
        lock_timeout_ms=request.lock_timeout_ms,
    )
    outcome, complete = _measure_all(session, request, prompt)
    record_reservations(hosts)
    if not outcome.stopped:
        end_remeasurements(session, complete)  # last of all: until then the same request goes on
    return outcome


def _measure_on_each(hosts: Hosts, request: MeasureRequest, control: Control) -> MeasureOutcome:
    """Measure host after host, those that are robots by their own rarms."""
    parts = list(_parts(experiments_of_request(hosts, request), request))
    outcomes: list[MeasureOutcome] = []
    for part, experiments in parts:
        name = experiments[0].host.name
        if hosts.robot(name) is not None:
            outcomes.append(_measure_there(hosts.only(name), part, control, experiments))
        else:
            outcomes.append(measure_components(hosts.only(name), part, control))
        if outcomes[-1].stopped:
            break
    unmeasured = (group[0] for _, experiments in parts[len(outcomes) :] for group in by_partition(experiments))
    return _together(outcomes, unmeasured)


def _parts(
    experiments: Sequence[Experiment], request: MeasureRequest
) -> Iterator[tuple[MeasureRequest, Sequence[Experiment]]]:
    """Yield requests of one host each, with their experiments: of several hosts, one a partition, or single ones."""
    by_host: dict[str, list[Experiment]] = {}
    for experiment in experiments:
        by_host.setdefault(experiment.host.name, []).append(experiment)
    if len(by_host) == 1:
        yield request, experiments
        return
    for of_host in by_host.values():
        if single := [each for each in of_host if len(each.setup.members) == 1]:
            names = tuple(dict.fromkeys(each.setup.members[0] for each in single))
            yield replace(request, components=names, together=False), single
        for group in by_partition([each for each in of_host if len(each.setup.members) > 1]):
            yield replace(request, components=group[0].setup.members, together=True), group


def _measure_there(
    hosts: Hosts, request: MeasureRequest, control: Control, experiments: Sequence[Experiment]
) -> MeasureOutcome:
    """Have the one chosen host, a robot, measure."""
    (name,) = hosts.chosen
    listener = ExperimentListener(hosts=hosts, host=name, control=control)
    members = dict.fromkeys(member for experiment in experiments for member in experiment.setup.members)
    loads = dict.fromkeys(experiment.setup.interference for experiment in experiments)
    answer = ask_robot(listener, "measure", request, MeasureOutcome, components=members, loads=loads)
    return replace(answer, experiments=tuple(listener.results))


def _together(outcomes: Sequence[MeasureOutcome], not_begun: Iterable[Experiment]) -> MeasureOutcome:
    """Return the outcomes of several hosts as one."""
    return MeasureOutcome(
        experiments=tuple(each for outcome in outcomes for each in outcome.experiments),
        findings=tuple(each for outcome in outcomes for each in outcome.findings),
        not_begun=(*(each for outcome in outcomes for each in outcome.not_begun), *not_begun),
        totals={name: each for outcome in outcomes for name, each in outcome.totals.items()},
        fixed_lp={name: each for outcome in outcomes for name, each in outcome.fixed_lp.items()},
        unknown={name: each for outcome in outcomes for name, each in outcome.unknown.items()},
    )


@dataclass(slots=True, kw_only=True)
class _Found:
    """What the passes found so far."""

    looks: tuple[tuple[ExperimentResult, ...], ...] = ()  # of the first pass, by partition
    results: list[ExperimentResult] = field(default_factory=list)  # of the later ones
    begun: int = 0  # partitions that these are of
    findings: list[Diagnostic] = field(default_factory=list)
    complete: dict[Path, Remeasurement] = field(default_factory=dict)  # by data log, nothing is left to do for them
    ended: bool = False  # the user asked for an end at a question

    @property
    def stopped(self) -> bool:
        """Whether an end was asked for in the first pass."""
        return any(each.stopped for look in self.looks for each in look)


def _measure_all(
    session: MeasuringSession, request: MeasureRequest, prompt: LevelPrompt | None
) -> tuple[MeasureOutcome, Mapping[Path, Remeasurement]]:
    """Return the outcome, and by data log the remeasurements that nothing is left to do for."""
    hosts = session.hosts
    experiments = experiments_of_request(hosts, request)
    groups = by_partition(experiments)
    started = [(experiment.host, name) for experiment in experiments for name in experiment.setup.members]
    found = _Found(findings=[*start_warnings_of(hosts.manifest, started)])
    names = [experiment.host.name for experiment in experiments]
    if has_passes(request) and prompt is None:
        say = session.control.reporter.message
        longest = Announced(work="The measurement", most_ms=longest_ms(groups, quick=request.quick), say=say)
        session = replace(session, announced=longest)
    with hold_measuring_hosts(session, names) as held, starting_again(held) as still_stopped:
        asked, method = describe_request(request), method_of(request)
        remeasurements = remeasurements_for(held, experiments, asked, method) if request.again else {}
        if request.again and isinstance(method, Search):
            groups = begin_with_decisive(groups, totals_at_hand(hosts.manifest)[1])
        for words in () if has_one_p2(method) else describe_missing_parts(held, experiments):
            session.control.reporter.message(words)
        if has_passes(request) and prompt is None:
            session.control.reporter.message(describe_work(groups, quick=request.quick))
            found.looks = first_pass(held, groups, more_follows=not request.quick)
        if not (request.quick or found.stopped):
            groups = later_passes(groups, found.looks) if found.looks else groups
            _measure_precisely(replace(held, remeasurements=remeasurements), groups, request, prompt, found)
    not_begun = groups[found.begun :]
    looks = [look for look in found.looks if any(is_of(look, loads) for loads in not_begun)]
    for look in looks:
        if not any(each.stopped for each in look):
            found.findings += _answer_findings(hosts, look)
    outcome = MeasureOutcome(
        experiments=in_order_of([*found.results, *(each for look in looks for each in look)], experiments),
        findings=(*found.findings, *still_stopped),
        not_begun=tuple(loads[0] for loads in not_begun if not any(is_of(look, loads) for look in looks)),
        ended=found.ended,
    )
    answers = map(decisive, outcome.partitions)
    known = [(each.experiment, each.reserve, each.settings) for each in answers if each.reserve is not None]
    outcome = replace(outcome, findings=(*outcome.findings, *unused_processors(known, hosts.manifest.places)))
    return _with_totals(outcome, hosts, names), found.complete


def _measure_precisely(
    held: MeasuringSession,
    groups: Sequence[Sequence[Experiment]],
    request: MeasureRequest,
    prompt: LevelPrompt | None,
    found: _Found,
) -> None:
    """Measure partition after partition by the request's method; add what is found."""
    known = has_passes(request) and prompt is None and not any(map(is_simulated, groups))
    units = Units(
        reporter=held.control.reporter.settings,
        of=sum(map(len, groups)),
        longest_ms=max(map(longest_later_ms, groups)) if known else None,
    )
    for loads in groups:
        look = next((look for look in found.looks if is_of(look, loads)), ())
        began = (decisive(look).reserve if look else None) or 0
        of_loads = measure_with_each_load(held, loads, method_of(request), began, units.add)
        if stopped := any(each.stopped for each in of_loads):
            of_loads = with_first_pass(of_loads, look)
        if not stopped and not isinstance(of_loads[-1].conclusion, SettingFailed):
            paths = [data_log_path(held.hosts, experiment) for experiment in loads]
            found.complete |= {path: held.remeasurements[path] for path in paths if path in held.remeasurements}
        if prompt is not None and not stopped:
            further = Further(session=replace(held, remeasurements={}), loads=loads, request=request)
            of_loads, found.ended = _ask(further, of_loads, prompt)
        answer = decisive(of_loads)
        is_final = answer.reserve is not None and not answer.is_provisional
        is_weak = is_final and refuses_weak_loads(request) and leave_idle(of_loads)
        of_loads = tuple(replace(each, is_weak=is_weak) for each in of_loads)
        found.findings += _answer_findings(held.hosts, of_loads)
        found.results += of_loads
        found.begun += 1
        if stopped or found.ended:
            return


def _with_totals(outcome: MeasureOutcome, hosts: Hosts, names: Sequence[str]) -> MeasureOutcome:
    """Return the outcome with what these hosts have promised by all data logs, and what is not known of them."""
    planned, reservations = totals_at_hand(hosts.manifest)
    verdicts = component_verdicts(hosts.system, reservations)

    def provisional_lp(result: ExperimentResult) -> Fraction | None:
        known = reservations.look_up(result.experiment.members, result.experiment.host)
        return known.reservation if isinstance(known, LookedUp) and known.provisional else None

    return replace(
        outcome,
        experiments=tuple(replace(each, provisional_lp=provisional_lp(each)) for each in outcome.experiments),
        totals={name: planned.hosts[name] for name in names},
        fixed_lp={
            name: totals_of(each.claim for each in partitions_without_log(hosts.system, planned, [name])).reserved_lp
            for name in names
        },
        unknown={name: missing_on(hosts.system, planned, verdicts, name) for name in names},
    )


def _ask(
    further: Further, of_loads: Sequence[ExperimentResult], prompt: LevelPrompt
) -> tuple[tuple[ExperimentResult, ...], bool]:
    """Ask the user for levels; return the results with the last answer, and whether the user ended the command."""
    first, ended = decisive(of_loads), False
    try:
        answered = ask_levels(further, first, prompt)
    except SessionEnded:
        answered, ended = first, True
    return (*(each for each in of_loads if each.log != answered.log), answered), ended


def _answer_findings(hosts: Hosts, of_loads: Sequence[ExperimentResult]) -> Iterator[Diagnostic]:
    """Make the findings on the result of some components with each load."""
    answer = decisive(of_loads)
    if answer.is_weak:
        idle = {
            each.interference: next((setting.evidence for setting in idle_settings(each)), None) for each in of_loads
        }
        yield weak_answer(hosts, answer.components, idle, answer.experiment.host)
    places = hosts.manifest.places
    yield from findings_of(answer.experiment, answer.conclusion, answer.settings, places)
    yield from work_of_settings(answer.experiment, *settings_of(of_loads), places)


def measuring_scripts(hosts: Hosts, request: MeasureRequest = EVERYTHING) -> tuple[PlanScript, ...]:
    """Return the scripts that `measure_components` would run on Hyper-V hosts; they are looked at, and nothing is run.

    One script measures an experiment: it makes P1 and P2, receives each setting, and removes them. A second one removes
    what a killed one left.

    Returns:
        `<host>.<experiment>.<load>.measure.ps1` and, once a host, `<host>.remove.measure.ps1`; inspected.

    Raises:
        RequestError: A name is not in the manifest, or no script would run, since rarms measures there itself.
        UseCaseError: No host can be measured on, or one cannot be observed (failed).
    """
    scripts: dict[str, PlanScript] = {}
    method = method_of(request)
    with host_errors():
        for experiment in experiments_of_request(hosts, request):
            name = experiment.host.name
            host = hosts.open_to_measure(name)
            if not isinstance(host, ScriptedMeasuringHost):
                message = f"rarms measures {experiment.name} on {name} without scripts. Only Hyper-V hosts use scripts."
                raise RequestError(message)
            resources = host_resources(experiment.host, host.observe(), experiment.application)
            in_parts = experiment if has_one_p2(method) else in_load_parts(experiment, resources)
            shapes, work = shapes_for(in_parts, resources), work_in_test_partitions(in_parts, resources)
            for title, text in (
                (
                    f"{experiment.name}.{experiment.setup.interference}",
                    host.measuring_script(experiment.application, shapes, work),
                ),
                ("remove", host.measuring_script(experiment.application, (), ())),
            ):
                file = f"{name}.{title}.measure.ps1"
                scripts[file] = PlanScript(name=file, host=name, guest="", undo=False, text=text)
    return tuple(scripts.values())


def remeasurements_for(
    session: MeasuringSession, experiments: Sequence[Experiment], asked: str, method: Method
) -> Mapping[Path, Remeasurement]:
    """Find or begin the remeasurement of each experiment.

    A command that was killed goes on: its other logs say whether they had their turn.

    Args:
        experiments: What is to be measured once more.
        asked: Distinguishes this command's remeasurements from those of others (`measure_request.describe_request`).

    Returns:
        By data log the remeasurement that is not ended, or a new one, which all logs say then.

    Raises:
        UseCaseError: A log is damaged (negative), or held by another run (refused); or as of
            `stop_what_is_in_the_way`. Nothing is written then.
    """
    resources = resources_by_host(session, experiments)
    experiments = [with_load_parts(session, each, method, resources[each.host.name]) for each in experiments]
    logs = [read_experiment_log(session, experiment) for experiment in experiments]
    unfinished = [last for log in logs if (last := _last(log, asked)) is not None and not last.ended]
    begun = max((remeasurement.begun for remeasurement in unfinished), default=None)
    known = {log.path: _of_that_command(log, asked, begun) for log in logs}
    for experiment, log in zip(experiments, logs, strict=True):
        if known[log.path] is None:
            stop_what_is_in_the_way(session, experiment, method)
    started = begun or datetime.now(UTC).isoformat(timespec="microseconds")
    return {log.path: known[log.path] or _begin(session, log, asked, started) for log in logs}


def end_remeasurements(session: MeasuringSession, complete: Mapping[Path, Remeasurement]) -> None:
    """Record in each data log that all of its remeasurement is measured.

    Args:
        session: Of the command that measured it; its hosts need not be held any more.

    Raises:
        UseCaseError: A log is held by another run (refused).
    """
    for path, remeasurement in complete.items():
        if not remeasurement.ended:
            with hold_data_log(session.hosts.folder, path, session.lock_timeout_ms):
                end_remeasurement(path, remeasurement)


def _last(log: ExperimentLog, asked: str) -> Remeasurement | None:
    remeasurements = () if log.valid is None else log.valid.remeasurements
    return next((each for each in reversed(remeasurements) if each.asked == asked), None)


def _of_that_command(log: ExperimentLog, asked: str, begun: str | None) -> Remeasurement | None:
    """Return the remeasurement of a command that began then; one that is not ended is gone on with in any case."""
    last = _last(log, asked)
    if begun is None or last is None or (last.ended and last.begun != begun):
        return None
    return last


def _begin(session: MeasuringSession, log: ExperimentLog, asked: str, begun: str) -> Remeasurement:
    begins = Remeasurement(seed=1 if log.valid is None else log.valid.highest_seed + 1, asked=asked, begun=begun)
    with hold_data_log(session.hosts.folder, log.path, session.lock_timeout_ms):
        append_remeasurement(log.path, log.header, begins)
    return begins
