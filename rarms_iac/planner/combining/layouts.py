"""Layouts in the order in which they are better, as what is known of their compounds allows at best."""

import heapq
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from typing import NamedTuple

from rarms_iac.model.system import Minimise
from rarms_iac.planner.combining.candidates import Candidates, Mask
from rarms_iac.planner.combining.values import Coi

Fits = Callable[[Sequence[Coi]], bool]
"""Whether hosts can keep these promises at once; less reserve never fits worse."""

NEVER = (1 << 60, 0)

Value = tuple[int, int, int]
"""What layouts are compared on, in order; the smaller, the better."""


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


class Shared(NamedTuple):
    """CoIs who share, with the best that a layout of just these could be; NOTE: there are thousands, and all sorted."""

    value: Value
    mask: Mask
    rest: int  # what the others reserve, each in its own partition


class _Sharing(NamedTuple):
    """A set of CoIs that share; NOTE: there are thousands of them, and they are sorted."""

    key: int  # as of `Choice`
    mask: Mask
    alone: int  # what they reserve apart


@dataclass(slots=True, kw_only=True)
class Layouts:
    """The layouts that the candidates allow, at their lower ends."""

    candidates: Candidates
    objective: Objective
    _costs: dict[Mask, int] = field(init=False)
    _by_top: dict[int, list[Mask]] = field(init=False)
    _least: dict[Mask, tuple[int, int]] = field(init=False)
    _within: dict[Mask, list[Mask]] = field(init=False)
    _alone: list[int] = field(init=False)
    _weights: list[int] = field(init=False)

    def __post_init__(self) -> None:
        known = self.candidates
        self._costs = {mask: one.coi.cost for mask, one in known.by_mask.items() if one.is_gain}
        self._by_top = {}
        for mask in self._costs:
            self._by_top.setdefault(mask.bit_length(), []).append(mask)
        self._least = {0: (0, 0)}
        self._within = {}
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

    def value(self, one: Choice) -> Value:
        """Of a layout."""
        return self._value(one.key, one.total, one.partitions)

    def _value(self, key: int, reserved: int, partitions: int) -> Value:
        if self.objective.minimise is Minimise.COMBINING:
            return key, reserved, partitions
        return reserved, key, partitions

    def best(self) -> Choice | None:
        """The best that fits; None: nothing fits, however little the compounds need."""
        best: Choice | None = None
        for one in self.ranked():
            if best is not None and one.value[0] > self.value(best)[0]:
                break
            choice = next(self._of(one), None)
            if choice is not None and (best is None or self.value(choice) < self.value(best)):
                best = choice
        return best

    def ranked(self) -> Iterator[Shared]:
        """Sets of CoIs that may share and have room for it, by the first of what layouts are compared on."""
        found = self._with_room()
        yield from found if self.objective.minimise is Minimise.COMBINING else sorted(found)

    def _with_room(self) -> Iterator[Shared]:
        everything, capacity = sum(self._alone), self.objective.capacity
        for one in self._sharing():
            rest = everything - one.alone
            if rest <= capacity and rest + (least := self.least(one.mask))[0] <= capacity:
                yield Shared(self._value(one.key, rest + least[0], self.partitions(one.mask, least[1])), one.mask, rest)

    def value_of(self, shared: Mask, reserved: int, compounds: int) -> Value:
        """Of a layout in which these share so many compounds."""
        return self._value(self.key(shared), reserved, self.partitions(shared, compounds))

    def partitions(self, shared: Mask, compounds: int) -> int:
        """How many there are when these share so many."""
        return len(self._alone) - shared.bit_count() + compounds

    def _sharing(self) -> list[_Sharing]:
        """Sets of CoIs that may be those who share; the best first."""
        used = 0
        for mask in self._costs:
            used |= mask
        found = [_Sharing(0, 0, 0)]
        for at in range(used.bit_length()):
            if used >> at & 1:
                weight, alone, bit = self._weights[at], self._alone[at], 1 << at
                found += [_Sharing(one.key + weight, one.mask | bit, one.alone + alone) for one in found]
        return sorted(found)

    def _of(self, shared: Shared) -> Iterator[Choice]:
        """Layouts in which just these share, that fit, by what they reserve."""
        key = self.key(shared.mask)
        for cost, blocks in self._partitions(shared.mask):
            if shared.rest + cost > self.objective.capacity:
                return
            if self.objective.fits(self.cois_of(blocks)):
                partitions = self.partitions(shared.mask, len(blocks))
                yield Choice(blocks=tuple(sorted(blocks)), total=shared.rest + cost, partitions=partitions, key=key)

    def key(self, shared: Mask) -> int:
        """The criticalities of these, as of `Choice`."""
        return sum(weight for at, weight in enumerate(self._weights) if shared >> at & 1)

    def cois_of(self, blocks: Sequence[Mask]) -> tuple[Coi, ...]:
        """What the partitions of a layout hold, compounds at their lower ends."""
        taken = 0
        for mask in blocks:
            taken |= mask
        alone = [one for at, one in enumerate(self.candidates.cois) if not taken >> at & 1]
        return (*alone, *(self.candidates.by_mask[mask].coi for mask in blocks))

    def least(self, mask: Mask) -> tuple[int, int]:
        """The least that these reserve when each of them shares, and how many partitions that takes."""
        found = self._least.get(mask)
        if found is None:
            found = NEVER
            for block in self.blocks(mask):
                left = self.least(mask ^ block)
                found = min(found, (left[0] + self._costs[block], left[1] + 1))
            self._least[mask] = found
        return found

    def blocks(self, mask: Mask) -> list[Mask]:
        """Compounds within the set that hold its most critical member."""
        found = self._within.get(mask)
        if found is None:
            found = self._within[mask] = self._found_within(mask)
        return found

    def _found_within(self, mask: Mask) -> list[Mask]:
        top = mask.bit_length()
        listed = self._by_top.get(top, [])
        others = mask ^ (1 << (top - 1))
        if len(listed) <= 1 << others.bit_count():
            return [one for one in listed if one & mask == one]
        found, part = [], others
        while part:
            if (block := part | 1 << (top - 1)) in self._costs:
                found.append(block)
            part = (part - 1) & others
        return found

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
            for block in self.blocks(left):
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
