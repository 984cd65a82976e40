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
    """What is expected of every compound, after the answers so far."""

    known: Candidates
    predictor: Predictor
    belief: Belief
    less: float  # the probability that a compound needs less than its neediest part reserves, where it may
    _outlooks: dict[Mask, Outlook] = field(default_factory=dict, compare=False, repr=False)

    def outlook(self, mask: Mask) -> Outlook:
        """What is known of this compound, and predicted."""
        if mask not in self._outlooks:
            self._outlooks[mask] = outlook_of(self.known.by_mask[mask], self.predictor, self.less)
        return self._outlooks[mask]

    def expected(self, mask: Mask) -> Expectation:
        """What this compound may need."""
        return self.belief.of(self.outlook(mask))

    def predicted(self, mask: Mask) -> int | None:
        """The CR that it needs as likely as not; None: nothing predicts it."""
        if all(prediction is None for prediction in self.outlook(mask).said):
            return None
        return self.expected(mask).quantile(0.5)


def guide_of(known: Candidates, predictor: Predictor) -> Guide:
    """What these answers and predictions make one expect."""
    less = needs_less(known)
    seen = [outlook_of(candidate, predictor, less) for candidate in known.by_mask.values() if candidate.was_asked]
    return Guide(known=known, predictor=predictor, belief=belief_of(len(predictor.ways), seen), less=less)


def needs_less(known: Candidates) -> float:
    """How likely a compound that may need less than its neediest part reserves does, after those that were asked."""
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
    """What is known of a compound, and predicted; `less`: as of `Guide`."""
    return Outlook(
        neediest=candidate.neediest / candidate.coi.processors,
        together=candidate.together / candidate.coi.processors,
        said=predictor.of(candidate.coi.members, candidate.coi.processors),
        low=candidate.low,
        slack=candidate.slack,
        less=less if candidate.slack else 0.0,
        passed=candidate.passed,
        failed=candidate.failed,
    )


def highest(candidate: Candidate) -> int:
    """The highest CR that is worth a question: one point more is known to be enough, or no gain."""
    return candidate.highest if candidate.passed is None else candidate.passed - 1


def raises_most(guide: Guide, unknown: Sequence[Candidate], room: int, *, holds: bool) -> tuple[Candidate, int]:
    """Of these compounds of a layout the one, with a CR, that will probably raise most what the layout needs at least.

    `room`: what it can bear before it is out, in per cent of one logical processor; `holds`: whether a layout was seen
    to hold.
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
    left = [(start, highest(candidate), 1.0)]  # with the probability that it needs more than what lies below the range
    while left:
        first, last, more = left.pop()
        if more * rises(last) < best[0]:
            continue
        middle = (first + last) // 2
        needs_more = 1.0 - expected.below(middle)
        worth = needs_more * rises(middle)
        if worth > best[0] or (worth == best[0] and middle < best[1]):
            best = worth, middle
        left += [(middle + 1, last, needs_more)] if middle < last else []
        left += [(first, middle - 1, more)] if first < middle else []
    return best
