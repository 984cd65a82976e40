"""Tuning: components are combined into partitions, so that less is reserved."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Literal

from rarms_iac import __version__
from rarms_iac.app.control import NEVER_STOP, SILENT, Reporter, StopSignal
from rarms_iac.app.data_logs import measured_reservations, measurements_of
from rarms_iac.app.experiments import MeasureRequest
from rarms_iac.app.graph import recorded_answers
from rarms_iac.app.hosts import Hosts, observe_hosts
from rarms_iac.app.manifest_edits import PartitionEdits, write_partitions
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.measure import hold_benches, record_reservations
from rarms_iac.app.measurement_files import now
from rarms_iac.app.tuning_log import record_tuning
from rarms_iac.app.tuning_subject import (
    Experiments,
    LayoutFit,
    TuningStopped,
    TuningSubject,
    bench_of,
    subject_of_tuning,
)
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.layout import Layout
from rarms_iac.model.quantities import show_processors
from rarms_iac.model.system import System
from rarms_iac.planner import findings
from rarms_iac.planner.combining.candidates import Contradiction
from rarms_iac.planner.combining.oracle import (
    WHOLE,
    Always,
    Answer,
    Coi,
    Consent,
    Members,
    PlannerReporter,
    SilentReporter,
    Unanswered,
    total,
)
from rarms_iac.planner.combining.paper import (
    SUCCESSFUL,
    UNABLE,
    Inquiry,
    ordered,
    tune_performance_to_use_less_resource,
)
from rarms_iac.planner.combining.questions import Best, search, tuning_of
from rarms_iac.planner.groups import most_critical_first
from rarms_iac.planner.layout import plan_layout
from rarms_iac.planner.problem import host_view
from rarms_iac.storage.datalog.tuning import TrailSetting, TunedPartition, TuningRun, claim_of

TuningEnding = Literal["nothing_to_do", "successful", "unable", "stopped"]


@dataclass(frozen=True, slots=True, kw_only=True)
class TuningResult:
    """How `rarms tune` ended; amounts in per cent of one logical processor."""

    platform: str
    hosts: tuple[str, ...]  # of the platform, that share `capacity`
    strategy: Literal["default", "paper"]
    ending: TuningEnding
    message: str
    capacity: int
    before: int
    after: int
    proved: bool
    contradictions: tuple[str, ...]
    partitions: tuple[TunedPartition, ...]
    trail: tuple[Answer, ...]
    written: str = ""

    @property
    def claim(self) -> str:
        """What is known of other layouts, in words."""
        return claim_of(proved=self.proved)


@dataclass(frozen=True, slots=True, kw_only=True)
class TuneRequest:
    """How components are to be combined."""

    strategy: Literal["default", "paper"] = "default"
    repeat: bool = False  # the paper's procedure goes on with the compound until the total fits
    dry_run: bool = False  # measure, but leave the manifest as it is
    samples: int | None = None  # a setting; None: as `run.until` says
    on_busy_host: bool = False
    lock_timeout_ms: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class TuneOutcome:
    """What came of tuning, and what was written."""

    result: TuningResult
    findings: tuple[Diagnostic, ...]
    removed: tuple[str, ...] = ()  # entries of the manifest's partitions whose components are elsewhere now
    files: tuple[str, ...] = ()  # of the manifest, that were changed


@dataclass(frozen=True, slots=True, kw_only=True)
class TuningEnd:
    """How the search ended."""

    subject: TuningSubject
    ending: TuningEnding
    cois: tuple[Coi, ...]  # as they are now, most critical first
    trail: tuple[Answer, ...] = ()
    proved: bool = False
    contradictions: tuple[Contradiction, ...] = ()
    unanswered: str = ""  # why a compound could not be measured

    @property
    def compounds(self) -> tuple[Coi, ...]:
        """The compounds that tuning made."""
        return tuple(coi for coi in self.cois if coi not in self.subject.cois)

    @staticmethod
    def of(subject: TuningSubject, inquiry: Inquiry, strategy: str, *, repeat: bool) -> "TuningEnd":
        """Tune by this strategy, until there is an answer or somebody asks for an end.

        Args:
            subject: what is tuned.
            inquiry: who answers, who is told, and who may decline a combination.
            strategy: `paper`, or else the candidate graph.
            repeat: whether the paper's procedure goes on after its first combination.

        Returns:
            How it ended. An oracle without an answer is an ending too, and raises nothing.
        """
        trail: list[Answer] = []
        heard = replace(inquiry, reporter=_TrailReporter(inquiry.reporter, trail))
        before = TuningEnd(subject=subject, ending="stopped", cois=ordered(subject.cois))
        try:
            if strategy == "paper":
                return _by_the_paper(before, heard, repeat=repeat)
            return _by_the_graph(before, heard)
        except TuningStopped:  # before Unanswered, of which it is a kind
            return replace(before, trail=tuple(trail))
        except Unanswered as problem:
            return replace(before, ending="unable", trail=tuple(trail), unanswered=str(problem))


def tune_components(
    hosts: Hosts,
    request: TuneRequest = TuneRequest(),
    *,
    reporter: Reporter = SILENT,
    stop: StopSignal = NEVER_STOP,
    planner_reporter: PlannerReporter | None = None,
    consent: Consent | None = None,
) -> TuneOutcome:
    """Find components that can share a partition and reserve less together, and write that into the manifest.

    Compounds are measured on the first of the hosts that can be measured on, setting by setting, as
    `measure_components` does; a run that was stopped goes on when the same is asked again.

    Args:
        hosts: Of one platform; their processors are what is shared out.
        request: How.
        reporter: Hears of every setting that is run.
        stop: Asked between settings and while samples come.
        planner_reporter: Hears what the search asks, and what it was answered; None: nobody does.
        consent: Asked before a combination is measured; None: all are allowed.

    Raises:
        UseCaseError: No host can be measured on (failed); one is busy or held (refused); a reservation is not
            measured, or the hosts are of several platforms (negative).
    """
    end = _tune_held(hosts, request, reporter, stop, planner_reporter or SilentReporter(), consent or Always())
    edits = PartitionEdits(files=(), removed=())
    if end.compounds and not request.dry_run:
        edits = write_partitions(hosts.manifest, end.compounds)
        record_reservations(hosts)
    findings = (*findings_of_end(end, hosts), *(_still_too_much(hosts, end) if edits.files else ()))
    result = _result_of(end, request.strategy, hosts.system, ", ".join(edits.files))
    if end.ending != "stopped":
        record_tuning(hosts, result.platform, run_of_result(result))
    return TuneOutcome(result=result, findings=findings, removed=edits.removed, files=edits.files)


def _tune_held(
    hosts: Hosts,
    request: TuneRequest,
    reporter: Reporter,
    stop: StopSignal,
    planner_reporter: PlannerReporter,
    consent: Consent,
) -> TuningEnd:
    """Ask until there is an answer, with the host held that is measured on."""
    bench = bench_of(hosts)
    measuring = MeasureRequest(
        together=True,
        strategy=request.strategy,
        samples=request.samples,
        on_busy_host=request.on_busy_host,
        lock_timeout_ms=request.lock_timeout_ms,
    )
    with hold_benches(hosts, [bench.name], request.lock_timeout_ms, reporter) as benches:
        subject = subject_of_tuning(hosts, bench, observe_hosts(hosts))
        oracle = Experiments(
            subject=subject, bench=benches[bench.name], request=measuring, reporter=reporter, stop=stop
        )
        inquiry = Inquiry(oracle=oracle, reporter=planner_reporter, consent=consent, may_share=subject.may_share)
        return TuningEnd.of(subject, inquiry, request.strategy, repeat=request.repeat)


class _TrailReporter:
    """A reporter that collects the answers, also when somebody asks for an end, and passes all on to another."""

    def __init__(self, reporter: PlannerReporter, trail: list[Answer]) -> None:
        self._reporter = reporter
        self._trail = trail

    def setting_answered(self, answer: Answer) -> None:
        """Collect it, and pass it on."""
        self._trail.append(answer)
        self._reporter.setting_answered(answer)

    def declined(self, members: Members) -> None:
        """Pass the message on."""
        self._reporter.declined(members)

    def combined(self, compound: Coi, before: int) -> None:
        """Pass the message on."""
        self._reporter.combined(compound, before)


def _by_the_paper(before: TuningEnd, inquiry: Inquiry, *, repeat: bool) -> TuningEnd:
    subject = before.subject
    done = tune_performance_to_use_less_resource(subject.cois, subject.capacity, inquiry, repeat=repeat)
    ending: TuningEnding = "nothing_to_do"
    if done.needed:
        ending = "successful" if done.combinations else "unable"
    return replace(before, ending=ending, cois=done.cois, trail=done.trail)


def _by_the_graph(before: TuningEnd, inquiry: Inquiry) -> TuningEnd:
    subject = before.subject
    most = min((subject.highest(coi.members) for coi in subject.cois), default=WHOLE)
    layout_fit = LayoutFit(subject=subject)
    tuning = replace(
        tuning_of(subject.cois, subject.objective(layout_fit), inquiry.may_share, most=most),
        predictor=subject.predictor,
    )
    measurements = measurements_of(subject.hosts.manifest)
    recorded = recorded_answers(measurements, subject.bench, tuning.candidates, {subject.bench.name: subject.state})
    best, trail = search(tuning, inquiry, recorded=recorded)
    if not isinstance(best, Best):
        proved = best.proved and not layout_fit.unsure
        return replace(before, ending="unable", trail=trail, proved=proved, contradictions=best.contradictions)
    ending: TuningEnding = "successful" if set(best.cois) != set(subject.cois) else "nothing_to_do"
    for coi in best.cois:
        if coi not in subject.cois:
            inquiry.reporter.combined(coi, total(_parts(subject, coi)))
    return replace(
        before,
        ending=ending,
        cois=best.cois,
        trail=trail,
        proved=best.proved and not layout_fit.unsure,
        contradictions=best.contradictions,
    )


def _parts(subject: TuningSubject, coi: Coi) -> Sequence[Coi]:
    return [each for each in subject.cois if set(each.members) <= set(coi.members)]


def findings_of_end(end: TuningEnd, hosts: Hosts) -> Iterator[Diagnostic]:
    """Report what a user should know of how tuning ended.

    Args:
        end: how it ended.
        hosts: the manifest, for the places of findings.

    Yields:
        A finding where there is no answer or nothing fits, one for each contradiction, and one for each compound that
            reserves more than its parts.
    """
    places = hosts.manifest.places
    if end.unanswered:
        advice = "Mend the component's `run`, allow more `run.failures`, or keep it `apart`; then the command goes on."
        yield findings.NO_ANSWER.at(None, end.unanswered, advice)
    elif end.ending == "unable":
        reserved, capacity = map(_show, (total(end.subject.cois), end.subject.capacity))
        message = f"{reserved} are reserved, {capacity} are there, and no combination that was allowed fits."
        advice = "Relax an APT (`rarms select`), lift an `apart`, `dedicated` or `protect`, or add a logical processor."
        if not end.subject.cois:
            message = "The manifest fixes all reserves, they do not fit, and nothing can be combined."
            advice = "Lower a reserve (`rarms plan` names ways out), or have it measured: `cpu: { reserve: measured }`."
        yield findings.UNABLE.at(
            places.key("hosts", end.subject.bench.name), message, advice, address=f"host/{end.subject.bench.name}"
        )
    for contradiction in end.contradictions:
        yield findings.CONTRADICTION.at(
            None,
            f"{contradiction.message}. So nothing is proved: what was found holds, and another layout may be better.",
            f"Measure the parts again (`rarms measure {' '.join(contradiction.members)} --again`), or tune with more "
            "samples: `--samples 2000`, after removing the compound's data log.",
            address=f"component/{contradiction.members[0]}",
        )
    for compound in end.compounds:
        apart = total(_parts(end.subject, compound))
        if compound.cost > apart:
            yield findings.ABOVE_THE_SUM.at(
                None,
                f"{', '.join(compound.members)} reserve {_show(compound.cost)} together, and {_show(apart)} apart.",
                "The paper's procedure counts this as successful; the default strategy drops such compounds.",
                address=f"partition/{compound.name}",
            )


def _still_too_much(hosts: Hosts, end: TuningEnd) -> Iterator[Diagnostic]:
    """Whether what the manifest says now can be planned."""
    manifest = load_manifest(hosts.manifest.source)
    system = manifest.system
    states = observe_hosts(hosts)
    reservations = measured_reservations(measurements_of(manifest), states)
    views = {name: host_view(state, system.application.name) for name, state in states.items()}
    if isinstance(plan_layout(system, reservations, views, manifest.places).answer, Layout):
        return
    now, capacity = _show(total(end.cois)), _show(end.subject.capacity)
    yield findings.STILL_TOO_MUCH.at(
        None,
        f"{now} are reserved now, and {capacity} are there; `rarms plan` tells more.",
        "Go on: `rarms tune --strategy paper --repeat`, or `rarms tune`.",
        address=f"host/{end.subject.bench.name}",
    )


def _result_of(end: TuningEnd, strategy: Literal["default", "paper"], system: System, written: str) -> TuningResult:
    message = {"successful": SUCCESSFUL, "unable": UNABLE, "nothing_to_do": "", "stopped": ""}[end.ending]
    return TuningResult(
        platform=end.subject.bench.platform,
        hosts=tuple(sorted(end.subject.hosts.chosen)),
        strategy=strategy,
        ending=end.ending,
        message=message,
        capacity=end.subject.capacity,
        before=total(end.subject.cois),
        after=total(end.cois),
        proved=end.proved,
        contradictions=tuple(contradiction.message for contradiction in end.contradictions),
        partitions=tuple(
            TunedPartition(
                name=coi.name,
                components=tuple(
                    component.name for component in most_critical_first(system.components[name] for name in coi.members)
                ),
                processors=coi.processors,
                reserve=coi.reserve,
                parts=total(_parts(end.subject, coi)) if coi in end.compounds else None,
            )
            for coi in end.cois
        ),
        trail=end.trail,
        written=written,
    )


def _show(percent: int) -> str:
    return show_processors(Fraction(percent, 100))


def run_of_result(result: TuningResult) -> TuningRun:
    """Turn a result into the run that the log of tuning records.

    Args:
        result: of a tuning that was not stopped; a stopped one goes on later, and is recorded when it ends.

    Returns:
        The run, dated now.
    """
    assert result.ending != "stopped", "it goes on, and is written when it ends"
    return TuningRun(
        when=now(),
        rarms_version=__version__,
        strategy=result.strategy,
        ending=result.ending,
        message=result.message,
        capacity=result.capacity,
        before=result.before,
        after=result.after,
        proved=result.proved,
        contradictions=result.contradictions,
        partitions=result.partitions,
        trail=tuple(
            TrailSetting(
                components=answer.members, reserve=answer.reserve, worse=answer.worse, predicted=answer.predicted
            )
            for answer in result.trail
        ),
        written=bool(result.written),
    )
