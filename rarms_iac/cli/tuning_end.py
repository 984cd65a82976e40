"""How tuning ended, for the manifest, the reader and the exit code."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Literal

from rarms_iac.app.hosts import Hosts, observe_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.tune import TuningEnding, TuningResult
from rarms_iac.cli.candidates import recorded_answers
from rarms_iac.cli.datalogs import measured_reservations, measurements_of
from rarms_iac.cli.tuning import Room, Subject, TuningStopped
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.layout import Layout
from rarms_iac.model.quantities import show_processors
from rarms_iac.model.system import System
from rarms_iac.planner import findings
from rarms_iac.planner.combining.candidates import Break
from rarms_iac.planner.combining.oracle import WHOLE, Asked, Coi, Members, PlannerReporter, Unanswered, total
from rarms_iac.planner.combining.paper import (
    SUCCESSFUL,
    UNABLE,
    Asking,
    ordered,
    tune_performance_to_use_less_resource,
)
from rarms_iac.planner.combining.questions import Best, search, tuning_of
from rarms_iac.planner.groups import most_critical_first
from rarms_iac.planner.layout import plan_layout
from rarms_iac.planner.problem import host_view
from rarms_iac.storage.datalog.tuning import TunedPartition


@dataclass(frozen=True, slots=True, kw_only=True)
class End:
    """What came of it."""

    subject: Subject
    ending: TuningEnding
    cois: tuple[Coi, ...]  # as they are now, most critical first
    trail: tuple[Asked, ...] = ()
    proved: bool = False
    probability: float | None = None  # that no other layout is better; None: it is proved, or nothing is claimed
    breaks: tuple[Break, ...] = ()
    unanswered: str = ""  # why a compound could not be measured

    @property
    def compounds(self) -> tuple[Coi, ...]:
        """Those that are new."""
        return tuple(coi for coi in self.cois if coi not in self.subject.cois)

    @staticmethod
    def of(subject: Subject, asking: Asking, strategy: str, *, repeat: bool, probability: float | None = None) -> "End":
        """Tune by this strategy."""
        trail: list[Asked] = []
        heard = replace(asking, reporter=_Noting(asking.reporter, trail))
        before = End(subject=subject, ending="stopped", cois=ordered(subject.cois))
        try:
            if strategy == "paper":
                return _by_the_paper(before, heard, repeat=repeat)
            return _by_the_graph(before, heard, probability)
        except TuningStopped:
            return replace(before, trail=tuple(trail))
        except Unanswered as problem:
            return replace(before, ending="unable", trail=tuple(trail), unanswered=str(problem))


class _Noting:
    """A reporter that keeps the answers, also when somebody asks for an end, and tells another."""

    def __init__(self, told: PlannerReporter, trail: list[Asked]) -> None:
        self._told = told
        self._trail = trail

    def setting_asked(self, members: Members, reserve: int, why: str) -> None:
        """Told on."""
        self._told.setting_asked(members, reserve, why)

    def setting_answered(self, answer: Asked) -> None:
        """Kept, and told on."""
        self._trail.append(answer)
        self._told.setting_answered(answer)

    def declined(self, members: Members) -> None:
        """Told on."""
        self._told.declined(members)

    def combined(self, compound: Coi, before: int) -> None:
        """Told on."""
        self._told.combined(compound, before)


def _by_the_paper(before: End, asking: Asking, *, repeat: bool) -> End:
    subject = before.subject
    done = tune_performance_to_use_less_resource(subject.cois, subject.capacity, asking, repeat=repeat)
    ending: TuningEnding = "nothing_to_do"
    if done.needed:
        ending = "successful" if done.combinations else "unable"
    return replace(before, ending=ending, cois=done.cois, trail=done.trail)


def _by_the_graph(before: End, asking: Asking, probability: float | None) -> End:
    subject = before.subject
    most = min((subject.highest(coi.members) for coi in subject.cois), default=WHOLE)
    room = Room(subject=subject)
    tuning = replace(
        tuning_of(subject.cois, subject.objective(room), asking.may_share, most=most),
        predictor=subject.predictor,
        probability=probability,
    )
    measured = measurements_of(subject.system, subject.hosts.folder, subject.hosts.manifest.source)
    recorded = recorded_answers(measured, subject.bench, tuning.candidates, {subject.bench.name: subject.state})
    found, trail = search(tuning, asking, recorded=recorded)
    if not isinstance(found, Best):
        proved = found.proved and not room.unsure
        return replace(before, ending="unable", trail=trail, proved=proved, breaks=found.breaks)
    ending: TuningEnding = "successful" if set(found.cois) != set(subject.cois) else "nothing_to_do"
    for coi in found.cois:
        if coi not in subject.cois:
            asking.reporter.combined(coi, total(_parts(subject, coi)))
    return replace(
        before,
        ending=ending,
        cois=found.cois,
        trail=trail,
        proved=found.proved and not room.unsure,
        probability=None if room.unsure else found.probability,
        breaks=found.breaks,
    )


def _parts(subject: Subject, coi: Coi) -> Sequence[Coi]:
    return [each for each in subject.cois if set(each.members) <= set(coi.members)]


def findings_of(end: End, hosts: Hosts) -> Iterator[Diagnostic]:
    """What is to be said of the end itself."""
    places = hosts.manifest.places
    if end.unanswered:
        advice = "Mend the component's `run`, allow more `run.failures`, or keep it `apart`; then the command goes on."
        yield findings.NO_ANSWER.at(None, end.unanswered, advice)
    elif end.ending == "unable":
        reserved, capacity = (_shown(one) for one in (total(end.subject.cois), end.subject.capacity))
        yield findings.UNABLE.at(
            places.key("hosts", end.subject.bench.name),
            f"{reserved} are reserved, {capacity} are there, and no combination that was allowed fits.",
            "Relax an APT (`rarms select`), lift an `apart`, `dedicated` or `protect`, or add a logical processor.",
            address=f"host/{end.subject.bench.name}",
        )
    for broken in end.breaks:
        yield findings.CONTRADICTION.at(
            None,
            f"{broken.says}. So nothing is proved: what was found holds, and another layout may be better.",
            f"Measure the parts again (`rarms measure {' '.join(broken.members)} --again`), or tune with more samples: "
            "`--samples 2000`, after removing the compound's data log.",
            address=f"component/{broken.members[0]}",
        )
    for compound in end.compounds:
        apart = total(_parts(end.subject, compound))
        if compound.cost > apart:
            yield findings.ABOVE_THE_SUM.at(
                None,
                f"{', '.join(compound.members)} reserve {_shown(compound.cost)} together, and {_shown(apart)} apart.",
                "The paper's procedure counts this as successful; the default strategy drops such compounds.",
                address=f"partition/{compound.name}",
            )


def still_too_much(hosts: Hosts, end: End) -> Iterator[Diagnostic]:
    """Whether what the manifest says now can be planned.

    Raises:
        UseCaseError: the manifest cannot be read any more (4).
    """
    manifest = load_manifest(hosts.manifest.source)
    system = manifest.system
    states = observe_hosts(hosts)
    reservations = measured_reservations(measurements_of(system, hosts.folder, hosts.manifest.source), states)
    views = {name: host_view(state, system.application.name) for name, state in states.items()}
    if isinstance(plan_layout(system, reservations, views, manifest.places).answer, Layout):
        return
    now, capacity = _shown(total(end.cois)), _shown(end.subject.capacity)
    yield findings.STILL_TOO_MUCH.at(
        None,
        f"{now} are reserved now, and {capacity} are there; `rarms plan` tells more.",
        "Go on: `rarms tune --strategy paper --repeat`, or `rarms tune`.",
        address=f"host/{end.subject.bench.name}",
    )


def tuned_of(end: End, strategy: Literal["default", "paper"], system: System, written: str) -> TuningResult:
    """The same for the reader."""
    message = {"successful": SUCCESSFUL, "unable": UNABLE, "nothing_to_do": "", "stopped": ""}[end.ending]
    return TuningResult(
        platform=end.subject.bench.platform,
        strategy=strategy,
        ending=end.ending,
        message=message,
        capacity=end.subject.capacity,
        before=total(end.subject.cois),
        after=total(end.cois),
        proved=end.proved,
        probability=end.probability,
        contradictions=tuple(one.says for one in end.breaks),
        partitions=tuple(
            TunedPartition(
                name=coi.name,
                components=tuple(
                    each.name for each in most_critical_first(system.components[name] for name in coi.members)
                ),
                processors=coi.processors,
                reserve=coi.reserve,
                parts=total(_parts(end.subject, coi)),
            )
            for coi in end.cois
        ),
        trail=end.trail,
        written=written,
    )


def _shown(percent: int) -> str:
    return show_processors(Fraction(percent, 100))
