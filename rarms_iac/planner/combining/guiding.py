"""Which of the questions that matter tells most: what prediction is for (docs/decisions/0018)."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import ceil

from rarms_iac.planner.combining.candidates import Candidate, Candidates, Mask
from rarms_iac.planner.prediction.belief import SELDOM, Belief, Expectation, Outlook, belief_of
from rarms_iac.planner.prediction.members import Predictor

BEYOND = 0.2
"""What a bound that rises beyond what this layout can bear is worth: it may rule out others."""

LIKE = 30
"""What is expected of needs below those of a part counts as if it had been seen of so many compounds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Guide:
    """Knowledge and predictions of every compound, after the answers so far."""

    known: Candidates
    predictor: Predictor
    belief: Belief
    less: float  # the probability that a compound needs less than its neediest part reserves, where it may
    _outlooks: dict[Mask, Outlook] = field(default_factory=dict, compare=False, repr=False)

    def outlook(self, mask: Mask) -> Outlook:
        """Return what is known and predicted of this compound.

        Args:
            mask: of a compound of the candidates.

        Returns:
            The same value for the same compound; it is worked out once.
        """
        if mask not in self._outlooks:
            self._outlooks[mask] = outlook_of(self.known.by_mask[mask], self.predictor, self.less)
        return self._outlooks[mask]

    def expected(self, mask: Mask) -> Expectation:
        """Return how likely this compound needs how much.

        Args:
            mask: of a compound of the candidates.

        Returns:
            The probabilities by CR, within what answers left possible.
        """
        return self.belief.of(self.outlook(mask))

    def predicted(self, mask: Mask) -> int | None:
        """Return the CR that a compound needs as likely as not.

        Args:
            mask: of a compound of the candidates.

        Returns:
            Whole per cent of each of its processors; None: no way to predict knows it.
        """
        if all(prediction is None for prediction in self.outlook(mask).predictions):
            return None
        return self.expected(mask).quantile(0.5)


def guide_of(known: Candidates, predictor: Predictor) -> Guide:
    """Work out what to expect of every compound after these answers.

    Args:
        known: the candidates after all answers.
        predictor: what the ways to predict say of a compound.

    Returns:
        A guide; it predicts a compound when it is asked about it, once.
    """
    less = needs_less(known)
    seen = [outlook_of(candidate, predictor, less) for candidate in known.by_mask.values() if candidate.was_asked]
    return Guide(known=known, predictor=predictor, belief=belief_of(len(predictor.ways), seen), less=less)


def needs_less(known: Candidates) -> float:
    """Estimate how often a compound needs less than its neediest part, from the compounds asked about so far.

    The estimate starts at `SELDOM`, with the weight of `LIKE` compounds, and each compound that was seen moves it.

    Args:
        known: the candidates after all answers.

    Returns:
        The probability, 0..1, for a compound whose `slack` allows it.
    """
    seen = [candidate for candidate in known.by_mask.values() if candidate.was_asked and candidate.slack]
    needs = [-(-candidate.neediest // candidate.coi.processors) for candidate in seen]
    did = sum(
        candidate.passed is not None and candidate.passed < least for candidate, least in zip(seen, needs, strict=True)
    )
    did_not = sum(
        candidate.failed is not None and candidate.failed >= least - 1
        for candidate, least in zip(seen, needs, strict=True)
    )
    return (SELDOM * LIKE + did) / (LIKE + did + did_not)


def outlook_of(candidate: Candidate, predictor: Predictor, less: float) -> Outlook:
    """Collect what is known and predicted of one compound.

    Args:
        candidate: the compound after all answers.
        predictor: what the ways to predict say of it.
        less: the probability that it needs less than its neediest part, as `needs_less` returns it.

    Returns:
        The outlook, with CRs in per cent of each of the compound's processors.
    """
    return Outlook(
        neediest=candidate.neediest / candidate.coi.processors,
        together=candidate.together / candidate.coi.processors,
        predictions=predictor.of(candidate.coi.members, candidate.coi.processors),
        low=candidate.low,
        slack=candidate.slack,
        less=less if candidate.slack else 0.0,
        passed=candidate.passed,
        failed=candidate.failed,
    )


def highest(candidate: Candidate) -> int:
    """Return the highest CR that is worth a question, in whole per cent.

    Args:
        candidate: the compound after all answers.

    Returns:
        Right below the lowest CR that passed; where none did, the highest CR at which the compound is still a gain.
    """
    return candidate.highest if candidate.passed is None else candidate.passed - 1


def raises_most(guide: Guide, unknown: Sequence[Candidate], room: int, *, holds: bool) -> tuple[Candidate, int]:
    """Choose the compound and CR whose measurement will probably raise the layout's least reservation most.

    Args:
        guide: what is expected of each compound.
        unknown: the compounds of a layout whose least CR is not yet measured; at least one, in any order.
        room: by how much the layout's reservation may grow before the layout is out, in per cent of one logical
            processor.
        holds: whether some layout was already measured to meet all APTs.

    Returns:
        The compound and the CR (whole per cent) to measure; the same arguments give the same choice.
    """
    best: tuple[float, Candidate, int] | None = None
    for candidate in sorted(unknown, key=lambda each: each.coi.members, reverse=True):
        worth, reserve = _worth_most(guide.expected(candidate.mask), candidate, room, holds=holds)
        if best is None or worth > best[0]:
            best = worth, candidate, reserve
    assert best is not None, "a compound that is not known has a question left"
    return best[1], best[2]


def _worth_most(expected: Expectation, candidate: Candidate, room: int, *, holds: bool) -> tuple[float, int]:
    """The CR with the most expected rise, the lower of equals; a range that cannot have it is not looked into."""
    start = candidate.low
    if not holds and start < (neediest := ceil(expected.outlook.neediest)) <= highest(candidate):
        start = neediest  # few need less than their neediest part: that one does not is no news
    bearable = max(1, room // candidate.coi.processors + 1 - (start - candidate.low))

    def rises(reserve: int) -> float:
        rise = reserve + 1 - start
        return candidate.coi.processors * (min(rise, bearable) + BEYOND * rise)

    best = -1.0, start
    ranges = [
        (start, highest(candidate), 1.0)
    ]  # with the probability that it needs more than what lies below the range
    while ranges:
        first, last, more = ranges.pop()
        if more * rises(last) < best[0]:
            continue
        middle = (first + last) // 2
        needs_more = 1.0 - expected.below(middle)
        worth = needs_more * rises(middle)
        if worth > best[0] or (worth == best[0] and middle < best[1]):
            best = worth, middle
        ranges += [(middle + 1, last, needs_more)] if middle < last else []
        ranges += [(first, middle - 1, more)] if first < middle else []
    return best
