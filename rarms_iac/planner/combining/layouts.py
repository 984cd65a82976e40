"""Layouts in the order in which they are better, as what is known of their compounds allows at best."""

import heapq
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count

from rarms_iac.model.system import Minimise
from rarms_iac.planner.combining.candidates import Candidates, Mask
from rarms_iac.planner.combining.values import Coi

Fits = Callable[[Sequence[Coi]], bool]
"""Whether hosts can keep these promises at once; less reserve never fits worse."""

NEVER = (1 << 60, 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Objective:
    """What makes a layout the better one, beside that it fits (DESIGN section 3)."""

    capacity: int  # of all hosts, in per cent of one logical processor: what exceeds it need not be tried
    fits: Fits
    minimise: Minimise
    criticalities: Mapping[str, int]  # by component


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """A layout by its compounds; every other CoI keeps its partition."""

    blocks: tuple[Mask, ...]
    total: int  # at least what it reserves, in per cent of one logical processor
    partitions: int
    key: int  # the criticalities of those who share: the smaller, the better


@dataclass(slots=True, kw_only=True)
class Layouts:
    """The layouts that the candidates allow, at their lower ends."""

    candidates: Candidates
    objective: Objective
    _costs: dict[Mask, int] = field(init=False)
    _by_top: dict[int, list[Mask]] = field(init=False)
    _least: dict[Mask, tuple[int, int]] = field(init=False)
    _alone: list[int] = field(init=False)
    _weights: list[int] = field(init=False)

    def __post_init__(self) -> None:
        known = self.candidates
        self._costs = {mask: one.coi.cost for mask, one in known.by_mask.items() if one.is_gain}
        self._by_top = {}
        for mask in self._costs:
            self._by_top.setdefault(mask.bit_length(), []).append(mask)
        self._least = {0: (0, 0)}
        self._alone = [one.cost for one in known.cois]
        self._weights = _weights(known.cois, self.objective.criticalities)

    def seen(self) -> "Layouts":
        """The same of what was seen to hold: only compounds that met all APTs somewhere, at the least such CR."""
        passed = {
            mask: replace(one, coi=replace(one.coi, reserve=one.passed))
            for mask, one in self.candidates.by_mask.items()
            if one.passed is not None
        }
        return Layouts(candidates=replace(self.candidates, by_mask=passed), objective=self.objective)

    def best(self) -> Choice | None:
        """The best that fits; None: nothing fits, however little the compounds need."""
        everything = sum(self._alone)
        shared = self._shared()
        if self.objective.minimise is Minimise.COMBINING:
            return self._fewest(shared, everything)
        return self._cheapest(shared, everything)

    def _shared(self) -> list[tuple[int, Mask]]:
        """Sets of CoIs that may be those who share, with the criticalities that this costs; the best first."""
        used = 0
        for mask in self._costs:
            used |= mask
        bits = [at for at in range(used.bit_length()) if used >> at & 1]
        sets = [0]
        for at in bits:
            sets += [one | 1 << at for one in sets]
        return sorted((self._key(one), one) for one in sets)

    def _key(self, mask: Mask) -> int:
        return sum(weight for at, weight in enumerate(self._weights) if mask >> at & 1)

    def _fewest(self, shared: Sequence[tuple[int, Mask]], everything: int) -> Choice | None:
        """Combining first: the least key; among those of the same the least total."""
        best: Choice | None = None
        reached = 0
        for key, mask in shared:
            if best is not None and key > reached:
                break
            choice = next(self._of(mask, everything), None)
            if choice is None:
                continue
            if best is None or (choice.total, choice.partitions) < (best.total, best.partitions):
                best, reached = choice, key
        return best

    def _cheapest(self, shared: Sequence[tuple[int, Mask]], everything: int) -> Choice | None:
        """Reservation first: the least total; among those of the same the least key."""
        ranked = []
        for key, mask in shared:
            least = self.least(mask)[0]
            if least < NEVER[0]:
                ranked.append((everything - self._alone_in(mask) + least, key, mask))
        best: tuple[int, int, int, Choice] | None = None
        for least, key, mask in sorted(ranked):
            if best is not None and (least, key) > best[:2]:
                break
            choice = next(self._of(mask, everything), None)
            if choice is None:
                continue
            value = (choice.total, key, choice.partitions)
            if best is None or value < best[:3]:
                best = (*value, choice)
        return None if best is None else best[3]

    def _of(self, mask: Mask, everything: int) -> Iterator[Choice]:
        """Layouts in which just these share, that fit, by what they reserve."""
        rest = everything - self._alone_in(mask)
        if rest + self.least(mask)[0] > self.objective.capacity:
            return
        for cost, blocks in self._partitions(mask):
            if rest + cost > self.objective.capacity:
                return
            if self.objective.fits(self.cois_of(blocks)):
                partitions = len(self._alone) - mask.bit_count() + len(blocks)
                yield Choice(
                    blocks=tuple(sorted(blocks)), total=rest + cost, partitions=partitions, key=self._key(mask)
                )

    def cois_of(self, blocks: Sequence[Mask]) -> tuple[Coi, ...]:
        """What the partitions of a layout hold, compounds at their lower ends."""
        taken = 0
        for mask in blocks:
            taken |= mask
        alone = [one for at, one in enumerate(self.candidates.cois) if not taken >> at & 1]
        return (*alone, *(self.candidates.by_mask[mask].coi for mask in blocks))

    def _alone_in(self, mask: Mask) -> int:
        return sum(cost for at, cost in enumerate(self._alone) if mask >> at & 1)

    def least(self, mask: Mask) -> tuple[int, int]:
        """The least that these reserve when each of them shares, and how many partitions that takes."""
        found = self._least.get(mask)
        if found is None:
            found = NEVER
            for block in self._blocks(mask):
                left = self.least(mask ^ block)
                found = min(found, (left[0] + self._costs[block], left[1] + 1))
            self._least[mask] = found
        return found

    def _blocks(self, mask: Mask) -> Iterator[Mask]:
        """Compounds within the set that hold its most critical member."""
        top = mask.bit_length()
        listed = self._by_top.get(top, [])
        others = mask ^ (1 << (top - 1))
        if len(listed) <= 1 << others.bit_count():
            yield from (one for one in listed if one & mask == one)
            return
        part = others
        while part:
            block = part | 1 << (top - 1)
            if block in self._costs:
                yield block
            part = (part - 1) & others

    def _partitions(self, mask: Mask) -> Iterator[tuple[int, tuple[Mask, ...]]]:
        """All ways to make compounds of them, the cheapest first: what is left is known to cost at least so much."""
        number = count()
        heap = [(*self.least(mask), next(number), 0, mask, ())]
        waiting: list[tuple[int, int, int, int, Mask, tuple[Mask, ...]]] = [one for one in heap if one[0] < NEVER[0]]
        while waiting:
            _, _, _, cost, left, blocks = heapq.heappop(waiting)
            if not left:
                yield cost, blocks
                continue
            for block in self._blocks(left):
                now = cost + self._costs[block]
                least = self.least(left ^ block)
                if least[0] < NEVER[0]:
                    bound = (now + least[0], len(blocks) + 1 + least[1])
                    heapq.heappush(waiting, (*bound, next(number), now, left ^ block, (*blocks, block)))


def _weights(cois: Sequence[Coi], criticalities: Mapping[str, int]) -> list[int]:
    """What it costs that a CoI shares: sums compare as sorted lists of criticalities do, most critical first."""
    levels = sorted(set(criticalities.values()))
    base = len(criticalities) + 1
    return [sum(base ** levels.index(criticalities[name]) for name in one.members) for one in cois]
