"""Tuning: components are combined into partitions, so that less is reserved."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol

from rarms_iac.app.control import UNATTENDED, Control
from rarms_iac.app.decision_logs import record_tuning
from rarms_iac.app.hosts import Hosts, observe_hosts
from rarms_iac.app.manifest_files import FileEdit, edit_partitions, emptied_partitions, text_of, write_edits
from rarms_iac.app.measurement_files import now
from rarms_iac.app.requests import busy_host_option, flag, lock_timeout_option, option, samples_option
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.measuring.findings import MORE_MEMORY
from rarms_iac.measuring.on_robot import TUNING, ExperimentListener, ask_robot, readable_answer
from rarms_iac.measuring.session import MeasuringSession, hold_measuring_hosts, record_reservations, start_warnings_of
from rarms_iac.measuring.stopping import starting_again, stopped_to_measure
from rarms_iac.measuring.tuning import Experiments, TuningConclusion, search_combinations
from rarms_iac.measuring.tuning_subject import TuningSubject, problem_around, subject_of_tuning, tuning_host
from rarms_iac.model.commands import PLAN, RecommendedCommand, Wording, command, prose
from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.layout import Infeasible, Layout, Relaxation, RelaxationKind
from rarms_iac.model.version import __version__
from rarms_iac.planner import planning_findings
from rarms_iac.planner.combining.oracle import Always, Coi, Consent, PlannerReporter, SilentReporter, total
from rarms_iac.planner.combining.paper import SUCCESSFUL, UNABLE, Inquiry
from rarms_iac.planner.groups import most_critical_first
from rarms_iac.planner.layout import describe_ways_out, plan_layout, relaxed_levels
from rarms_iac.planner.packing.values import least_cost
from rarms_iac.planner.problem import solve
from rarms_iac.storage.codec import NotDecodable
from rarms_iac.storage.datalog.decisions import TunedPartition, TuningRun, TuningStrategy
from rarms_iac.texts.messages import in_a_row, list_names
from rarms_iac.texts.quantities import show_lp_percent


@dataclass(frozen=True, slots=True, kw_only=True)
class TuneRequest:
    """The request of `rarms tune`.

    Raises:
        RequestError: it repeats, and not the paper's procedure.
    """

    strategy: TuningStrategy = option(
        "--strategy",
        help=(
            "default: search the best layout, with a proof; paper: combine the two least critical "
            "components, as in the paper. [default: default]"
        ),
        default="default",
    )
    repeat: bool = flag("--repeat", help="With --strategy paper: continue with the compound until all fits.")
    dry_run: bool = flag("--dry-run", help="Measure, but do not change the manifest.")
    samples: int | None = samples_option()
    on_busy_host: bool = busy_host_option()
    lock_timeout_ms: int = lock_timeout_option()

    def __post_init__(self) -> None:
        if self.repeat and self.strategy != "paper":
            raise RequestError(
                "--repeat needs --strategy paper. The default strategy already tries compounds of any size."
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class TuningResult:
    """The result of `rarms tune`, with the written files."""

    kind: Literal["tune"] = "tune"
    platform: str
    hosts: tuple[str, ...]  # that have the run's capacity: the chosen ones, and those with partitions in common
    run: TuningRun
    findings: tuple[Diagnostic, ...]
    removed: tuple[str, ...] = ()  # entries of the manifest's partitions whose components are elsewhere now
    files: tuple[str, ...] = ()  # of the manifest, that were changed


class TuningPrompt(Consent, PlannerReporter, Protocol):
    """Hears what the search asks and is answered, and says which combinations are measured and what is written.

    Every method that asks may raise `SessionEnded`.
    """

    def confirms(self, found: TuningResult) -> bool:
        """Show what was found, and tell whether it is written into the manifest.

        Args:
            found: the partitions; nothing is written yet.

        Returns:
            Whether the manifest is changed.
        """


class UnattendedTuning(Always, SilentReporter):
    """A `TuningPrompt` that allows all and shows nothing."""

    def confirms(self, found: TuningResult) -> bool:  # noqa: ARG002 - the protocol's
        """Have it written."""
        return True


UNATTENDED_TUNING: TuningPrompt = UnattendedTuning()


def tune_components(
    hosts: Hosts,
    request: TuneRequest = TuneRequest(),
    control: Control = UNATTENDED,
    prompt: TuningPrompt = UNATTENDED_TUNING,
) -> TuningResult:
    """Find components that can share a partition and reserve less together, and write that into the manifest.

    Compounds are measured on the first of the hosts that can be measured on, setting by setting, as
    `measure_components` does; a run that was stopped goes on when the same is asked again.

    Args:
        hosts: Of one platform; their processors are what is shared out.

    Returns:
        The partitions, most critical first, totals in per cent of one logical processor, and the files that were
            changed.

    Raises:
        UseCaseError: No host can be measured on (failed); one is busy or held (refused); a reservation is not
            measured, or the hosts are of several platforms (negative).
    """
    there = next((name for name in hosts.chosen if hosts.can_run_on(name)), None)
    if there is not None and hosts.robot(there) is not None:
        return _tune_there(hosts, there, request, control, prompt)
    return tune_here(hosts, request, control, prompt)


@dataclass(frozen=True, slots=True, kw_only=True)
class TunedThere:
    """The answer of a robot that tuned."""

    result: TuningResult
    texts: Mapping[str, str]  # what it made of files of the manifest, by their names on this side


def _tune_there(hosts: Hosts, host: str, request: TuneRequest, control: Control, prompt: TuningPrompt) -> TuningResult:
    """Have a robot tune, and write into the manifest here what it wrote there."""
    before = {file: text_of(file) for file in hosts.manifest.sources}
    reporters = {TUNING: (TuningPrompt, prompt)}
    listener = ExperimentListener(hosts=hosts, host=host, control=control, reporters=reporters)
    system = hosts.system
    tuned = ask_robot(listener, "tune", request, TunedThere, components=system.components, loads=system.interference)
    with readable_answer(host):
        if not set(tuned.texts) <= set(before):
            raise NotDecodable("texts", "a file is not of the manifest")
    write_edits([FileEdit(file=file, before=before[file], after=text) for file, text in tuned.texts.items()])
    return tuned.result


def tune_here(
    hosts: Hosts, request: TuneRequest, control: Control = UNATTENDED, prompt: TuningPrompt = UNATTENDED_TUNING
) -> TuningResult:
    """Tune as `tune_components` does, on a host that this rarms measures on itself.

    Returns:
        As `tune_components`.

    Raises:
        UseCaseError: As of `tune_components`.
    """
    session = MeasuringSession(
        hosts=hosts,
        control=control,
        command="tune",
        on_busy_host=request.on_busy_host,
        lock_timeout_ms=request.lock_timeout_ms,
    )
    end = _search_held(session, request, prompt)
    edits: Sequence[FileEdit] = ()
    is_wanted = bool(end.compounds) and not request.dry_run
    if is_wanted and prompt.confirms(_result(hosts, end, request, edits)):
        edits = edit_partitions(hosts.manifest, end.compounds)
    # NOTE: the manifest is written when the run is recorded, and what follows from it is always recorded: killed in
    # between, the same command finds the manifest as tuned, has nothing to do, and could not tell the run any more.
    record_tuning(hosts, end.subject.host.platform, tuning_run(end, request.strategy, written=bool(edits)))
    write_edits(edits)
    if not request.dry_run:
        record_reservations(hosts)
    return _result(hosts, end, request, edits)


def _result(hosts: Hosts, end: TuningConclusion, request: TuneRequest, edits: Sequence[FileEdit]) -> TuningResult:
    places, host = hosts.manifest.places, end.subject.host
    started = [(host, name) for coi in end.subject.cois for name in coi.members]
    findings = (
        *start_warnings_of(hosts.manifest, started),
        *tuning_findings(end, request.strategy, places),
        *(_still_too_much(hosts, end) if edits else ()),
    )
    return TuningResult(
        platform=end.subject.host.platform,
        hosts=tuple(sorted(end.subject.problem.system.hosts)),
        run=tuning_run(end, request.strategy, written=bool(edits)),
        findings=findings,
        removed=tuple(emptied_partitions(hosts.system, end.compounds)) if edits else (),
        files=tuple(edit.file for edit in edits),
    )


def _search_held(session: MeasuringSession, request: TuneRequest, prompt: TuningPrompt) -> TuningConclusion:
    """Ask until there is an answer, with the host held that is measured on."""
    hosts = session.hosts
    host = tuning_host(hosts)
    with hold_measuring_hosts(session, [host.name]) as held, starting_again(held) as still_stopped:
        states = observe_hosts(hosts)
        if not request.on_busy_host:
            states = {name: stopped_to_measure(state, session.application) for name, state in states.items()}
        subject = subject_of_tuning(hosts, host, states)
        number = len(subject.cois)
        oracle = Experiments(
            subject=subject,
            session=held,
            strategy=request.strategy,
            samples=request.samples,
            most_pairs=number * (number - 1) // 2 if request.repeat else number - 1,
        )
        inquiry = Inquiry(oracle=oracle, reporter=prompt, consent=prompt, may_share=subject.may_share)
        end = search_combinations(subject, inquiry, request.strategy, repeat=request.repeat)
    return replace(end, findings=(*oracle.work_findings(hosts.manifest.places), *still_stopped))


def tuning_findings(end: TuningConclusion, strategy: TuningStrategy, places: Places) -> Iterator[Diagnostic]:
    """Report what a user should know of how tuning ended.

    Yields:
        A finding if there is no answer or nothing fits, one for each contradiction, and one for each compound that
            reserves more than its parts.
    """
    yield from end.findings
    if end.unanswered:
        correct = (
            MORE_MEMORY
            if end.lacks_memory
            else (
                "Correct the component's `run`, allow more `run.failures`, or set `apart`. Then run the same "
                "command again."
            )
        )
        yield planning_findings.NO_ANSWER.at(None, "{reason}", correct, reason=end.unanswered)
    elif end.ending == "unable":
        reserved, capacity = map(show_lp_percent, (end.before, end.subject.capacity))
        asked = "tried" if strategy == "paper" else "allowed"
        need = f"The partitions need {reserved}{_fixed_part(end.subject)}; the capacity is {capacity}"
        message = f"{need}. No {asked} combination fits."
        ways, advice = _ways_out(end.subject, strategy, places)
        if strategy == "paper" and len(end.subject.candidates().by_mask) > 1:
            default = _tune_again(end.subject)
            advice = prose(advice, "\nOr try other combinations with the default strategy: ", default, ".")
        if limits := _limits_on_combining(end.subject):
            advice = prose(advice, f"\nOr remove {limits} and tune again.")
        if not end.subject.cois:
            message = "The manifest fixes all reserves. They do not fit, and no components can be combined."
            advice = prose(advice, "\nOr use a measured reserve: `cpu: { reserve: measured }`.")
        yield planning_findings.UNABLE.at(
            places.key("hosts", end.subject.host.name),
            "{_message}",
            advice,
            address=f"host/{end.subject.host.name}",
            reserved_lp=end.before / 100,
            capacity_lp=end.subject.capacity / 100,
            _message=message,
            **relaxed_levels(ways),
        )
    yield from _doubtful_compounds(end)


def _ways_out(subject: TuningSubject, strategy: TuningStrategy, places: Places) -> tuple[Sequence[Relaxation], Wording]:
    """Find what else would make everything fit, levels of APTs among it: no pair where tuning has just tried all."""
    problem = subject.problem
    answer = plan_layout(problem.system, problem.reservations, problem.states, places).answer
    found = answer.relaxations if isinstance(answer, Infeasible) else ()
    ways = [way for way in found if strategy == "paper" or way.kind is not RelaxationKind.COMBINING]
    return ways, describe_ways_out(ways)


def _fixed_part(subject: TuningSubject) -> str:
    """Write as `, 0.3 LP of it by camera and door, which are not tuned`; empty if all are tuned."""
    tuned = {coi.name for coi in subject.cois}
    names = [item.name for item in subject.problem.items if item.name not in tuned and least_cost(item)]
    if not names:
        return ""
    return f", {show_lp_percent(subject.fixed)} of it for {list_names(sorted(names))}, not tuned"


def _tune_again(subject: TuningSubject, **options: str | bool) -> RecommendedCommand:
    """Return the command that tunes the same hosts; on one host, where others are not tuned."""
    is_whole = set(subject.hosts.chosen) == set(subject.system.hosts)
    return command("tune", host=False if is_whole else subject.host.name, **options)


def _limits_on_combining(subject: TuningSubject) -> str:
    """Name the manifest's fields that keep components from a partition with others: `an `apart` or `dedicated`."""
    members = [subject.system.components[name] for coi in subject.cois for name in coi.members]
    fields = {
        "`apart`": any(member.apart for member in members),
        "`dedicated`": any(member.dedicated for member in members),
        "`protect`": any(request.protect for request in subject.system.partitions.values()),
    }
    named = [name for name, is_set in fields.items() if is_set]
    return in_a_row(named, "or") if named else ""


def _doubtful_compounds(end: TuningConclusion) -> Iterator[Diagnostic]:
    """Report compounds that contradict their parts, and those that reserve more than these."""
    for contradiction in end.contradictions:
        yield planning_findings.CONTRADICTION.at(
            None,
            "{_message}. The layout is valid, but another one may be better.",
            prose(
                "Measure the parts again: ",
                command("measure", *contradiction.members, again=True),
                ". Or remove the compound's data log, and tune with more samples: `--samples 2000`.",
            ),
            address=f"component/{contradiction.members[0]}",
            components=tuple(contradiction.members),
            _message=contradiction.message,
        )
    for compound in end.compounds:
        separate = total(end.parts_of(compound))
        if compound.cost > separate:
            together = show_lp_percent(compound.cost)
            yield planning_findings.CONTRADICTION.at(
                None,
                "{components:each} need {_together} together, but {_show_lp_percent} apart.",
                "The paper's procedure counts this as successful; the default strategy drops such compounds.",
                address=f"partition/{compound.name}",
                components=tuple(compound.members),
                together_lp=compound.cost / 100,
                alone_lp=separate / 100,
                _together=together,
                _show_lp_percent=show_lp_percent(separate),
            )


def _still_too_much(hosts: Hosts, end: TuningConclusion) -> Iterator[Diagnostic]:
    """Report a manifest that still has no layout."""
    if isinstance(solve(problem_around(hosts.reloaded(), observe_hosts(hosts))), Layout):
        return
    now, capacity = map(show_lp_percent, (end.after, end.subject.capacity))
    yield planning_findings.RESERVATIONS.at(
        None,
        "The partitions reserve {_now}; the capacity is {_capacity}.",
        prose(
            "Continue: ",
            _tune_again(end.subject, strategy="paper", repeat=True),
            ", or ",
            _tune_again(end.subject),
            ". Show the causes: ",
            PLAN,
            ".",
        ),
        address=f"host/{end.subject.host.name}",
        reserved_lp=end.after / 100,
        capacity_lp=end.subject.capacity / 100,
        _now=now,
        _capacity=capacity,
    )


def tuning_run(end: TuningConclusion, strategy: TuningStrategy, *, written: bool) -> TuningRun:
    """Return the run as the tuning log records it, dated now.

    Args:
        written: whether the compounds were written into the manifest.

    Returns:
        Amounts in per cent of one logical processor.
    """
    message = {"successful": SUCCESSFUL, "unable": UNABLE, "nothing_to_do": "", "stopped": ""}[end.ending]
    return TuningRun(
        when=now(),
        rarms_version=__version__,
        strategy=strategy,
        ending=end.ending,
        message=message,
        capacity=end.subject.capacity,
        fixed=end.subject.fixed,
        before=end.before,
        after=end.after,
        proved=end.proved,
        contradictions=tuple(contradiction.message for contradiction in end.contradictions),
        doubts=end.doubts,
        partitions=tuple(_tuned_partition(end, coi) for coi in end.cois),
        trail=end.trail,
        written=written,
    )


def _tuned_partition(end: TuningConclusion, coi: Coi) -> TunedPartition:
    components = end.subject.system.components
    return TunedPartition(
        name=coi.name,
        components=tuple(component.name for component in most_critical_first(components[name] for name in coi.members)),
        processors=coi.taken_processors,
        reserve=coi.reserve,
        parts=total(end.parts_of(coi)) if coi in end.compounds else None,
    )
