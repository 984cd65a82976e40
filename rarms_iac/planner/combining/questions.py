"""The default strategy of combining: which setting to measure next, or the best layout.

Each question is whether a compound meets its APTs at a CR; the next one is a pure function of the answers
(`next_decision`). `search` asks until there is a result.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from rarms_iac.model.system import Minimise
from rarms_iac.planner.combining.candidates import (
    EXACT_UP_TO,
    Candidate,
    Candidates,
    Contradiction,
    candidates_of,
    informed,
)
from rarms_iac.planner.combining.layouts import LayoutChoice, Objective, best_layout, cois_of
from rarms_iac.planner.combining.oracle import WHOLE, Coi, Members, total
from rarms_iac.planner.combining.paper import Inquiry, Sharing, ordered
from rarms_iac.planner.prediction import Predict, unpredicted
from rarms_iac.storage.datalog.decisions import TrailSetting, UnprovedNeed

BELOW = 2
"""Points below a prediction at which the first question is asked: the prediction is rounded up, and a miss there rules
out the most.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class NextSetting:
    """The next setting to measure: its answer could change the result."""

    members: Members
    reserve: int
    predicted: int | None  # the CR that will probably be enough; None: no prediction


@dataclass(frozen=True, slots=True, kw_only=True)
class Best:
    """The best layout, its compounds at their measured least reservations."""

    cois: tuple[Coi, ...]  # most critical first
    total: int  # in per cent of one logical processor
    contradictions: tuple[Contradiction, ...]  # answers that contradict the assumption: with any, nothing is proved
    complete: bool  # whether every layout was considered
    doubts: tuple[UnprovedNeed, ...] = ()  # compounds of a layout that may yet be better: with any, nothing is proved

    @property
    def proved(self) -> bool:
        """Whether no other layout is better, under the assumption `ASSUMED` (candidates.py)."""
        return self.complete and not self.contradictions and not self.doubts


@dataclass(frozen=True, slots=True, kw_only=True)
class NothingFits:
    """No layout fits, at any need of the compounds that were not measured."""

    contradictions: tuple[Contradiction, ...]
    complete: bool
    doubts: tuple[UnprovedNeed, ...] = ()  # compounds of a layout that may yet fit: with any, nothing is proved

    @property
    def proved(self) -> bool:
        """Whether no layout fits, under the assumption `ASSUMED`, with every layout considered."""
        return self.complete and not self.contradictions and not self.doubts


Decision = NextSetting | Best | NothingFits


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuning:
    """The problem: the compounds that may be, and the objective that layouts are compared by."""

    candidates: Candidates  # before anything was asked
    objective: Objective
    complete: bool  # whether these candidates are all that the objective could choose
    every_size: bool  # whether compounds may have any number of parts
    predict: Predict = unpredicted


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


def next_decision(tuning: Tuning, answers: Sequence[TrailSetting]) -> Decision:
    """Say what to ask after these answers, or give the result.

    Take the layout that would be best if every compound needed as little as is still possible. If all its compounds are
    measured, nothing can be better: it is the answer. Otherwise ask for that one of its unmeasured compounds of which
    least is known.

    Args:
        answers: all so far, in any order.

    Returns:
        `NextSetting` with the next setting to measure, `Best` with the best layout, or `NothingFits`.
    """
    known = informed(tuning.candidates, answers)
    best = best_layout(known, tuning.objective)
    if best is None:
        doubts = _doubts(tuning, known, answers, None)
        return NothingFits(contradictions=known.contradictions, complete=tuning.complete, doubts=doubts)
    unknown = [candidate for mask in best.blocks if not (candidate := known.by_mask[mask]).is_known]
    if not unknown:
        return _best(tuning, known, best, answers)
    best_measured = best_layout(known.measured, tuning.objective)
    if best_measured is not None and best_measured.value == best.value:
        return _best(tuning, known.measured, best_measured, answers)
    return _next_question(
        max(unknown, key=lambda each: (each.coi.taken_processors * (each.highest_open - each.low), each.coi.members)),
        tuning.predict,
    )


def most_questions(candidates: Candidates) -> int:
    """Return how many settings the search may still ask for at most.

    Each compound that may save something is halved; one question more is asked below its prediction.

    Args:
        candidates: with what the answers so far say.
    """
    undecided = (each for each in candidates.by_mask.values() if each.is_gain and not each.is_known)
    return sum((each.highest_open - each.low + 1).bit_length() + (each.passed is None) for each in undecided)


def _next_question(candidate: Candidate, predict: Predict) -> NextSetting:
    """Ask half-way between the bounds; until a CR was enough, just below the prediction where that is higher."""
    reserve = (candidate.low + candidate.highest_open) // 2
    predicted = expected(candidate, predict)
    if predicted is not None and candidate.passed is None:
        reserve = max(reserve, min(predicted - BELOW, candidate.highest_open))
    return NextSetting(members=candidate.coi.members, reserve=reserve, predicted=predicted)


def expected(candidate: Candidate, predict: Predict) -> int | None:
    """Return the CR that a compound will probably need.

    Args:
        candidate: the compound, with the bounds that the answers so far give.
        predict: the prediction by the members' own curves.

    Returns:
        Whole per cent of each of its processors, within what was measured; None: nothing predicts it.
    """
    predicted = predict(candidate.coi.members, candidate.coi.processors)
    if predicted is None:
        return None
    return max(candidate.low, predicted if candidate.passed is None else min(predicted, candidate.passed))


def _best(tuning: Tuning, candidates: Candidates, best: LayoutChoice, answers: Sequence[TrailSetting]) -> Best:
    return Best(
        cois=ordered(cois_of(candidates, best.blocks)),
        total=best.total,
        contradictions=candidates.contradictions,
        complete=tuning.complete or _needs_no_other_coi(tuning, best),
        doubts=_doubts(tuning, informed(tuning.candidates, answers), answers, best),
    )


def _doubts(
    tuning: Tuning, known: Candidates, answers: Sequence[TrailSetting], best: LayoutChoice | None
) -> tuple[UnprovedNeed, ...]:
    """Return the compounds by which another layout may be better, or fit at all, if unresolved settings are enough.

    A proof needs lower ends that were shown: each other compound is taken at what it needs by settings that were
    shown to miss, and what the best layout's own compounds need is as it was measured.
    """
    shown = informed(tuning.candidates, [answer for answer in answers if not answer.unresolved])
    own = best.blocks if best is not None else ()
    measured = known.measured.by_mask
    taken = {mask: measured[mask] if mask in own else candidate for mask, candidate in shown.by_mask.items()}
    other = best_layout(replace(shown, by_mask=taken), tuning.objective)
    if other is None or (best is not None and other.value >= best.value):
        return ()
    by_members = {candidate.coi.members: candidate for candidate in shown.by_mask.values()}
    parts = [taken[mask].coi.members for mask in other.blocks if mask not in own]
    unresolved: dict[Members, int] = {}
    for answer in answers:
        if answer.unresolved and any(set(answer.components) <= set(members) for members in parts):
            unresolved[answer.components] = max(answer.reserve, unresolved.get(answer.components, 0))
    return tuple(
        UnprovedNeed(components=members, shown=by_members[members].low, unresolved=reserve)
        for members, reserve in sorted(unresolved.items())
        if members in by_members
    )


def _needs_no_other_coi(tuning: Tuning, best: LayoutChoice) -> bool:
    """Tell whether the layout combines only the `EXACT_UP_TO` least critical CoIs, under `minimise: combining`.

    Any layout that touches more critical CoIs is then worse, so leaving those out loses nothing.
    """
    return (
        tuning.every_size
        and tuning.objective.minimise is Minimise.COMBINING
        and all(mask < 1 << EXACT_UP_TO for mask in best.blocks)
    )


def search(
    tuning: Tuning, inquiry: Inquiry, answers: Sequence[TrailSetting] = (), recorded: Sequence[TrailSetting] = ()
) -> tuple[Best | NothingFits, tuple[TrailSetting, ...]]:
    """Repeat NextSetting until the answer is there; answered questions are not asked again.

    A combination that a user declines is left out; since a layout with it may be better, nothing is proved then. A
    search that was stopped asks the same questions again, and no answer contradicts what is known.

    Args:
        inquiry: who answers, who gets reports, and who may decline a combination.
        answers: what was answered in an earlier run of this search, in order.
        recorded: what else was measured of compounds. It is used only when the search would otherwise end, and then
            counts as if it had been asked for.

    Returns:
        The result, and the trail: all answers in the order in which they counted, beginning with `answers`.

    Raises:
        Unanswered: the oracle has no answer; the trail up to there is in what it recorded.
    """
    trail = list(answers)
    consented: set[Members] = {answer.components for answer in trail}
    while True:
        decision = next_decision(tuning, trail)
        if not isinstance(decision, NextSetting):
            counted = {(answer.components, answer.reserve) for answer in trail}
            not_counted = [answer for answer in recorded if (answer.components, answer.reserve) not in counted]
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
                continue
            consented.add(decision.members)
        trail.append(inquiry.ask(decision.members, decision.reserve, decision.predicted))


def _consent(tuning: Tuning, inquiry: Inquiry, members: Members) -> bool:
    candidate = next(each for each in tuning.candidates.by_mask.values() if each.coi.members == members)
    parts = total(tuning.candidates.members(candidate.mask))
    settings = (candidate.highest - candidate.low + 1).bit_length()
    return inquiry.consent.allows(members, settings, parts - candidate.coi.cost)


def _without(tuning: Tuning, members: Members) -> Tuning:
    by_mask = {
        mask: candidate for mask, candidate in tuning.candidates.by_mask.items() if candidate.coi.members != members
    }
    candidates = replace(tuning.candidates, by_mask=by_mask)
    return replace(tuning, candidates=candidates, complete=False, every_size=False)
