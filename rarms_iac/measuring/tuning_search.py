"""The search of `rarms tune`: a strategy asks for settings until it has an answer, or is stopped."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from rarms_iac.app.graph import recorded_answers
from rarms_iac.measuring.tuning_subject import LacksMemory, LayoutFit, TuningStopped, TuningSubject
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.planner.combining.candidates import Contradiction
from rarms_iac.planner.combining.oracle import WHOLE, Answer, Coi, Members, PlannerReporter, Unanswered, total
from rarms_iac.planner.combining.paper import Inquiry, ordered, tune_performance_to_use_less_resource
from rarms_iac.planner.combining.questions import Best, Doubt, search, tuning_of
from rarms_iac.storage.datalog.decisions import TuningEnding, TuningStrategy


@dataclass(frozen=True, slots=True, kw_only=True)
class TuningConclusion:
    """How the search ended, and the CoIs that it leaves."""

    subject: TuningSubject
    ending: TuningEnding
    cois: tuple[Coi, ...]  # most critical first
    trail: tuple[Answer, ...] = ()
    proved: bool = False
    contradictions: tuple[Contradiction, ...] = ()
    doubts: tuple[Doubt, ...] = ()
    unanswered: str = ""  # why a compound could not be measured
    lacks_memory: bool = False  # that is the reason
    findings: tuple[Diagnostic, ...] = ()  # of its settings, and of `starting_again`

    @property
    def before(self) -> int:
        """What all partitions reserved before, in per cent of one logical processor."""
        return total(self.subject.cois) + self.subject.fixed

    @property
    def after(self) -> int:
        """What all partitions reserve as the search leaves them, in per cent of one logical processor."""
        return total(self.cois) + self.subject.fixed

    @property
    def compounds(self) -> tuple[Coi, ...]:
        """The compounds that tuning made."""
        return tuple(coi for coi in self.cois if coi not in self.subject.cois)

    def parts_of(self, coi: Coi) -> Sequence[Coi]:
        """Return the CoIs that were tuned and are in this compound; a CoI as it was is its own part.

        Args:
            coi: one of `cois`.

        Returns:
            In the order of the subject.
        """
        return [part for part in self.subject.cois if set(part.members) <= set(coi.members)]


def search_combinations(
    subject: TuningSubject, inquiry: Inquiry, strategy: TuningStrategy, *, repeat: bool
) -> TuningConclusion:
    """Ask for settings by this strategy, until there is an answer or an end is asked for.

    Args:
        inquiry: Who answers, who hears of the answers, and who may decline a combination.
        strategy: `paper`, or else the candidate graph.
        repeat: Whether the paper's procedure goes on after its first combination.

    Returns:
        How it ended. That the oracle has no answer (`Unanswered`) is an ending, too.

    Raises:
        UseCaseError: A data log cannot be read; or, of an oracle that measures, a setting could not be run.
        HostError: Of such an oracle: the host did not do what was asked.
    """
    trail: list[Answer] = []
    recorded = replace(inquiry, reporter=_TrailReporter(inquiry.reporter, trail))
    start = TuningConclusion(subject=subject, ending="stopped", cois=ordered(subject.cois))
    try:
        end = _by_the_paper(start, recorded, repeat=repeat) if strategy == "paper" else _by_the_graph(start, recorded)
    except TuningStopped:  # before Unanswered, of which it is a kind
        end = start
    except Unanswered as problem:
        lacks_memory = isinstance(problem, LacksMemory)
        end = replace(start, ending="unable", unanswered=str(problem), lacks_memory=lacks_memory)
    return replace(end, trail=tuple(trail))


class _TrailReporter:
    """A reporter that collects the answers, also when an end is asked for, and passes all on to another."""

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


def _by_the_paper(start: TuningConclusion, inquiry: Inquiry, *, repeat: bool) -> TuningConclusion:
    subject = start.subject
    layout_fit = LayoutFit(subject=subject)
    done = tune_performance_to_use_less_resource(subject.cois, layout_fit.fits, inquiry, repeat=repeat)
    ending: TuningEnding = "nothing_to_do"
    if done.needed:
        ending = "successful" if done.combinations else "unable"
    return replace(start, ending=ending, cois=done.cois)


def _by_the_graph(start: TuningConclusion, inquiry: Inquiry) -> TuningConclusion:
    subject = start.subject
    most = min((subject.highest(coi.members) for coi in subject.cois), default=WHOLE)
    layout_fit = LayoutFit(subject=subject)
    tuning = replace(
        tuning_of(subject.cois, subject.objective(layout_fit), inquiry.may_share, most=most),
        predict=subject.predict,
    )
    recorded = recorded_answers(
        subject.hosts.manifest, subject.host, tuning.candidates, {subject.host.name: subject.state}
    )
    best, _ = search(tuning, inquiry, recorded=recorded)
    proved = best.proved and not layout_fit.unsure
    if not isinstance(best, Best):
        return replace(start, ending="unable", proved=proved, contradictions=best.contradictions, doubts=best.doubts)
    end = replace(start, cois=best.cois, proved=proved, contradictions=best.contradictions, doubts=best.doubts)
    for compound in end.compounds:
        inquiry.reporter.combined(compound, total(end.parts_of(compound)))
    return replace(end, ending="successful" if end.compounds else "nothing_to_do")
