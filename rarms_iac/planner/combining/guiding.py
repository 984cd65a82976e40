"""Which of the questions that matter tells most, and how likely no other layout is better: what prediction is for."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from math import ceil

from rarms_iac.planner.combining.candidates import Candidate, Candidates, Mask
from rarms_iac.planner.combining.layouts import NEVER, PARTITIONS, Layouts, Least, Value
from rarms_iac.planner.prediction.belief import SELDOM, Belief, Expectation, Hypothesis, Outlook, belief_of
from rarms_iac.planner.prediction.members import Predictor

_BITS = 0xFFFFFFFFFFFFFFFF
_GOLDEN = 0.6180339887498949


@dataclass(slots=True, kw_only=True)
class World:
    """One way in which all may be; what a compound needs there is drawn when it is first asked for."""

    number: int
    layouts: Layouts  # at the lower ends
    outlook: Callable[[Mask], Outlook]
    way: Hypothesis
    needs: dict[Mask, int] = field(default_factory=dict)  # CR, of those that were drawn
    _costs: dict[Mask, Least] = field(default_factory=dict)
    _least: dict[Mask, Least] = field(default_factory=lambda: {0: 0})
    _more_than: dict[Mask, Least] = field(default_factory=dict)  # where it was given up

    def need(self, mask: Mask) -> int:
        """The CR that the compound needs here."""
        found = self.needs.get(mask)
        if found is None:
            found = self.needs[mask] = self.way.need(self.outlook(mask), _drawn(self.number, mask))
        return found

    def _cost(self, block: Mask) -> Least:
        found = self._costs.get(block)
        if found is None:
            candidate, need = self.layouts.candidates.by_mask[block], self.need(block)
            found = (need * candidate.coi.processors << PARTITIONS) + 1 if need <= candidate.highest else NEVER
            self._costs[block] = found
        return found

    def least(self, mask: Mask, most: Least) -> Least:
        """As of `Layouts`, here, where it is at most so much; otherwise something more than that."""
        found = self._least.get(mask)
        if found is not None:
            return found
        if most < max(self._more_than.get(mask, -1) + 1, self.layouts.least(mask)):
            return most + 1
        found = most + 1
        for block in self.layouts.blocks(mask):
            left = mask ^ block
            at_least = self.layouts.least(left)
            if self.layouts.cost(block) + at_least < found and (cost := self._cost(block)) + at_least < found:
                found = min(found, cost + self.least(left, found - cost - 1))
        if found <= most:
            self._least[mask] = found
        else:
            self._more_than[mask] = most
        return found

    def better(self, sets: Iterable[tuple[Mask, Least]]) -> tuple[Mask, ...] | None:
        """The compounds of a layout in which one of these sets shares and needs at most so much; None: there is none.

        NOTE: hosts are not looked at. So it may fit none, and another layout seems better rather than none.
        """
        for mask, most in sets:
            if self.least(mask, most) <= most:
                return tuple(self._blocks_of(mask))
        return None

    def _blocks_of(self, shared: Mask) -> Iterator[Mask]:
        while shared:
            least = self._least[shared]
            block = next(part for part in self.layouts.blocks(shared) if self._makes(part, shared ^ part, least))
            yield block
            shared ^= block

    def _makes(self, block: Mask, left: Mask, least: Least) -> bool:
        """Whether the least of a set is this compound with the least of what is left."""
        if self.layouts.cost(block) + self.layouts.least(left) > least:
            return False
        rest = least - self._cost(block)
        return rest >= 0 and self.least(left, rest) == rest


def _drawn(world: int, mask: Mask) -> float:
    """From 0 to 1, always the same: splitmix64 (G. Steele, D. Lea and C. Flood, OOPSLA 2014)."""
    state = (world * 0x9E3779B97F4A7C15 + mask * 0xD1B54A32D192ED03 + 0x632BE59BD9B4E019) & _BITS
    state = ((state ^ (state >> 30)) * 0xBF58476D1CE4E5B9) & _BITS
    state = ((state ^ (state >> 27)) * 0x94D049BB133111EB) & _BITS
    return ((state ^ (state >> 31)) >> 11) / (1 << 53)


def worlds(layouts: Layouts, outlook: Callable[[Mask], Outlook], belief: Belief, number: int) -> Iterator[World]:
    """So many, each hypothesis in as many of them as it weighs; always the same ones."""
    for at in range(number):
        way = belief.drawn((at * _GOLDEN + 0.5 / number) % 1.0)
        yield World(number=at, layouts=layouts, outlook=outlook, way=way)


BEYOND = 0.2
"""What a bound that rises beyond what this layout can bear is worth: it may rule out others."""

LIKE = 30
"""What is expected of needs below those of a part counts as if it had been seen of so many compounds."""

MARGIN = 1.5
"""So many times fewer of them than the probability allows: the hypotheses themselves are not quite right."""

BETTER = 5
"""Worlds with a better layout among those that are looked at, where the probability asked for is just reached."""


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Doubt:
    """Worlds in which another layout is better, and its compounds there."""

    found: tuple[tuple[World, tuple[Mask, ...]], ...]
    looked_at: int
    enough: bool  # so few that the probability asked for is reached


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


def doubt_of(guide: Guide, layouts: Layouts, than: Value, probability: float) -> Doubt:
    """In how many of the worlds that may be a layout is better than that one, which was seen to hold.

    Hosts are not looked at, so some of these may fit nowhere: the doubt is rather too large.
    """
    ranked = takewhile(lambda shared: shared.value[0] <= than[0], layouts.ranked())
    sets = [
        (shared.mask, layouts.less_than(than, shared.mask, shared.rest)) for shared in ranked if shared.value < than
    ]
    number = ceil(MARGIN * (BETTER + 1) / (1.0 - probability))  # rule of succession (P. Laplace, 1774)
    found = []
    for looked_at, world in enumerate(worlds(layouts, guide.outlook, guide.belief, number), start=1):
        blocks = world.better(sets)
        if blocks is not None:
            found.append((world, blocks))
        if len(found) > BETTER:
            return Doubt(found=tuple(found), looked_at=looked_at, enough=False)
    return Doubt(found=tuple(found), looked_at=number, enough=True)


def settles_most(doubt: Doubt, known: Candidates) -> tuple[Candidate, int] | None:
    """The compound that is in most of the better layouts, with a CR that takes about half of the doubt away.

    None: there is nothing to be asked of them; what is better uses compounds whose needs are known.
    """
    often = Counter(mask for _, blocks in doubt.found for mask in blocks if not known.by_mask[mask].is_known)
    if not often:
        return None
    mask = max(often, key=lambda each: (often[each], each))
    candidate = known.by_mask[mask]
    needs = sorted(world.need(mask) for world, blocks in doubt.found if mask in blocks)
    part = 1.0 - len(doubt.found) / doubt.looked_at / 2
    return candidate, max(candidate.low, min(needs[min(len(needs) - 1, int(part * len(needs)))], highest(candidate)))
