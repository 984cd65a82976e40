"""The next threshold question: does this compound meet its APTs at this reservation? A pure function of the answers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from rarms_iac.model.system import Minimise
from rarms_iac.planner.combining.candidates import (
    EXACT_UP_TO,
    Candidate,
    Candidates,
    Contradiction,
    Mask,
    candidates_of,
    informed,
)
from rarms_iac.planner.combining.guiding import Guide, guide_of, raises_most
from rarms_iac.planner.combining.layouts import LayoutChoice, Layouts, Objective
from rarms_iac.planner.combining.oracle import WHOLE, Answer, Coi, Members, total
from rarms_iac.planner.combining.paper import Inquiry, Sharing
from rarms_iac.planner.prediction.members import NOTHING, Predictor


@dataclass(frozen=True, slots=True, kw_only=True)
class Ask:
    """Not ended: this question could change the answer."""

    members: Members
    reserve: int
    predicted: int | None  # the CR with an even chance of being enough; None: no prediction. Only informs the reader


@dataclass(frozen=True, slots=True, kw_only=True)
class Best:
    """The best layout, its compounds at their measured least reservations."""

    cois: tuple[Coi, ...]  # most critical first
    total: int  # in per cent of one logical processor
    contradictions: tuple[Contradiction, ...]  # answers that contradict the assumption: with any, nothing is proved
    complete: bool  # whether every layout was considered

    @property
    def proved(self) -> bool:
        """No other layout is better, under the assumption of `planner.prediction.belief`."""
        return self.complete and not self.contradictions


@dataclass(frozen=True, slots=True, kw_only=True)
class NothingFits:
    """No layout fits, whatever the compounds that were not measured need."""

    contradictions: tuple[Contradiction, ...]
    complete: bool

    @property
    def proved(self) -> bool:
        """Whether no layout fits, under the assumption of `Best.proved`, with every layout considered."""
        return self.complete and not self.contradictions


Decision = Ask | Best | NothingFits


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuning:
    """The problem: the compounds that may be, and the objective that layouts are compared by."""

    candidates: Candidates  # before anything was asked
    objective: Objective
    complete: bool  # whether these candidates are all that the objective could choose
    every_size: bool  # whether compounds may have any number of parts
    predictor: Predictor = NOTHING


def tuning_of(
    cois: Sequence[Coi],
    objective: Objective,
    may_share: Sharing,
    *,
    most: int = WHOLE,
    largest: int | None = None,
) -> Tuning:
    """State the problem: every compound that could be a gain, without predictions.

    Args:
        cois: the CoIs as they are now, in any order.
        objective: what makes a layout the better one, and whether it fits.
        may_share: whether components, by sorted names, may be in one partition.
        most: the highest CR that P1 can be given, in per cent of each of its processors.
        largest: how many CoIs a compound may consist of; None: any number.

    Returns:
        The problem. It is `complete` where every compound that the objective could choose is a candidate.
    """
    candidates = candidates_of(cois, may_share, most=most, largest=largest)
    every_size = largest is None
    complete = every_size and len(cois) <= EXACT_UP_TO
    return Tuning(candidates=candidates, objective=objective, complete=complete, every_size=every_size)


@dataclass(slots=True, kw_only=True)
class QuestionSearch:
    """Finds the next question while answers come in.

    It keeps what earlier answers settled; the result is the same as working everything out anew.
    """

    tuning: Tuning
    _layouts: Layouts | None = None
    _seen: "_Holding | None" = None

    def next_decision(self, answers: Sequence[Answer]) -> Decision:
        """Say what to ask after these answers, or give the result.

        Take the layout that would be best if every compound needed as little as is still possible. If all its compounds
        are measured, nothing can be better: it is the answer. Otherwise ask for that one of its unmeasured compounds
        whose least need will probably rise most. Predictions choose the question, and prove nothing.

        Args:
            answers: all so far, in any order; at each call at least those of the call before.

        Returns:
            `Ask` with the next setting to measure, `Best` with the best layout, or `NothingFits`.
        """
        tuning = self.tuning
        known = informed(tuning.candidates, answers)
        layouts = self._looked_at(known)
        best = layouts.best()
        if best is None:
            return NothingFits(contradictions=known.contradictions, complete=tuning.complete)
        unknown = [candidate for mask in best.blocks if not (candidate := known.by_mask[mask]).is_known]
        if not unknown:
            return _best(tuning, layouts, best, known.contradictions)
        seen, holds = self._holding(layouts)
        if holds is not None and layouts.value(holds) == layouts.value(best):
            return _best(tuning, seen, holds, known.contradictions)
        guide = guide_of(known, tuning.predictor)
        room = _room(tuning, best, holds)
        candidate, reserve = raises_most(guide, unknown, room, holds=holds is not None)
        return _question(guide, candidate, reserve)

    def _looked_at(self, known: Candidates) -> Layouts:
        last = self._layouts
        layouts = Layouts(candidates=known, objective=self.tuning.objective) if last is None else last.after(known)
        self._layouts = layouts
        return layouts

    def _holding(self, layouts: Layouts) -> tuple[Layouts, LayoutChoice | None]:
        """The best of what was seen to hold; None: no compound was."""
        passed = {
            mask: candidate.passed
            for mask, candidate in layouts.candidates.by_mask.items()
            if candidate.passed is not None
        }
        if self._seen is None or self._seen.passed != passed:
            seen = layouts.seen()
            self._seen = _Holding(passed=passed, layouts=seen, best=seen.best() if passed else None)
        return self._seen.layouts, self._seen.best


@dataclass(frozen=True, slots=True, kw_only=True)
class _Holding:
    passed: Mapping[Mask, int]
    layouts: Layouts
    best: LayoutChoice | None


def _room(tuning: Tuning, best: LayoutChoice, holds: LayoutChoice | None) -> int:
    """How much more its compounds may need before this layout is out: too large, or no better than one that holds."""
    room = tuning.objective.capacity - best.total
    if holds is not None and (tuning.objective.minimise is Minimise.RESERVATION or holds.key == best.key):
        room = min(room, holds.total - best.total - 1)
    return max(0, room)


def _question(guide: Guide, candidate: Candidate, reserve: int) -> Ask:
    return Ask(
        members=candidate.coi.members,
        reserve=reserve,
        predicted=guide.predicted(candidate.mask),
    )


def _best(tuning: Tuning, layouts: Layouts, best: LayoutChoice, contradictions: tuple[Contradiction, ...]) -> Best:
    return Best(
        cois=tuple(sorted(layouts.cois_of(best.blocks), key=lambda coi: (-coi.criticality, coi.name))),
        total=best.total,
        contradictions=contradictions,
        complete=tuning.complete or _is_first(tuning, best),
    )


def _is_first(tuning: Tuning, best: LayoutChoice) -> bool:
    """Whether the layout combines only the `EXACT_UP_TO` least critical CoIs, under `minimise: combining`.

    Any layout that touches more critical CoIs is then worse, so leaving those out loses nothing.
    """
    least = (1 << EXACT_UP_TO) - 1
    shares = 0
    for mask in best.blocks:
        shares |= mask
    return tuning.every_size and tuning.objective.minimise is Minimise.COMBINING and shares & least == shares


def search(
    tuning: Tuning, inquiry: Inquiry, answers: Sequence[Answer] = (), recorded: Sequence[Answer] = ()
) -> tuple[Best | NothingFits, tuple[Answer, ...]]:
    """Ask until the answer is there; what was answered before is not asked again.

    A combination that somebody says no to is left out; since a layout with it may be better, nothing is proved then. A
    search that was stopped asks the same questions again, and no answer contradicts what is known.

    Args:
        tuning: the problem.
        inquiry: who answers, who is told, and who may decline a combination.
        answers: what was answered in an earlier run of this search, in order.
        recorded: what else was measured of compounds. It is used only when the search would otherwise end, and then
            counts as if it had been asked for.

    Returns:
        The result, and the trail: all answers in the order in which they counted, beginning with `answers`.

    Raises:
        Unanswered: the oracle has no answer; the trail up to there is in what it recorded.
    """
    trail = list(answers)
    consented: set[Members] = {answer.members for answer in trail}
    question_search = QuestionSearch(tuning=tuning)
    while True:
        decision = question_search.next_decision(trail)
        if not isinstance(decision, Ask):
            not_counted = _not_counted(recorded, trail)
            if not not_counted:
                return decision, tuple(trail)
            for answer in not_counted:
                inquiry.reporter.setting_answered(answer)
            trail += not_counted
            continue
        if decision.members not in consented:
            if not _consent(tuning, inquiry, decision.members):
                inquiry.reporter.declined(decision.members)
                tuning = _without(tuning, decision.members)
                question_search = QuestionSearch(tuning=tuning)
                continue
            consented.add(decision.members)
        trail.append(inquiry.ask(decision.members, decision.reserve, decision.predicted))


def _not_counted(recorded: Sequence[Answer], trail: Sequence[Answer]) -> list[Answer]:
    counted = {(answer.members, answer.reserve) for answer in trail}
    return [answer for answer in recorded if (answer.members, answer.reserve) not in counted]


def _consent(tuning: Tuning, inquiry: Inquiry, members: Members) -> bool:
    candidate = next(each for each in tuning.candidates.by_mask.values() if each.coi.members == members)
    parts = total(tuning.candidates.members(candidate.mask))
    settings = (candidate.highest - candidate.low + 1).bit_length()
    return inquiry.consent.allows(members, settings=settings, gain=parts - candidate.coi.cost)


def _without(tuning: Tuning, members: Members) -> Tuning:
    by_mask = {
        mask: candidate for mask, candidate in tuning.candidates.by_mask.items() if candidate.coi.members != members
    }
    candidates = replace(tuning.candidates, by_mask=by_mask)
    return replace(tuning, candidates=candidates, complete=False, every_size=False)
