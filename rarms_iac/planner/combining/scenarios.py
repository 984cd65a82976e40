"""Layouts in worlds that may be: every compound needs what was drawn for it, within what is known."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

from rarms_iac.planner.combining.candidates import Mask
from rarms_iac.planner.combining.layouts import NEVER, PARTITIONS, Layouts, Least
from rarms_iac.planner.prediction.belief import Belief, Hypothesis, Outlook

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
            one, need = self.layouts.candidates.by_mask[block], self.need(block)
            found = (need * one.coi.processors << PARTITIONS) + 1 if need <= one.highest else NEVER
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
            block = next(one for one in self.layouts.blocks(shared) if self._makes(one, shared ^ one, least))
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
