"""Layouts in the order in which they are better, as what is known of their compounds allows at best."""

import heapq
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from itertools import count
from typing import NamedTuple

from rarms_iac.model.system import Minimise
from rarms_iac.planner.combining.candidates import Candidates, Mask
from rarms_iac.planner.combining.oracle import Coi

Fits = Callable[[Sequence[Coi]], bool]
"""Whether hosts can keep these promises at once; less reserve never fits worse."""

Value = tuple[int, int, int]
"""The key that layouts are compared by, in order; the smaller, the better."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Objective:
    """The objective: which of two layouts that fit is the better one."""

    capacity: int  # of all hosts, in per cent of one logical processor: what exceeds it need not be tried
    fits: Fits
    minimise: Minimise
    criticalities: Mapping[str, int]  # by component


@dataclass(frozen=True, slots=True, kw_only=True)
class LayoutChoice:
    """A layout by its compounds; every other CoI keeps its partition."""

    blocks: tuple[Mask, ...]
    total: int  # at least what it reserves, in per cent of one logical processor
    partitions: int
    key: int  # the criticalities of those who share: the smaller, the better


def weights_of(cois: Sequence[Coi], criticalities: Mapping[str, int]) -> list[int]:
    """Give each CoI a number for what it costs that it shares a partition.

    Sums of these numbers compare as the sorted lists of the members' criticalities do, the most critical first.

    Args:
        cois: the CoIs.
        criticalities: by component; it has every member of the CoIs.

    Returns:
        A number for each CoI, in their order; Python integers, which may be large.
    """
    levels = sorted(set(criticalities.values()))
    base = len(criticalities) + 1
    return [sum(base ** levels.index(criticalities[name]) for name in coi.members) for coi in cois]


PARTITIONS = 8
"""Bits of a `Least` that count partitions: more than there are."""

NEVER = 1 << 60

FEW = 80
"""Compounds of which all unions are made; of more, every set of their members may be one."""

Least = int
"""What some reserve together, and in how many partitions: compares as the two in this order, and adds up as both do."""


class Shared(NamedTuple):
    """CoIs who share, with the best that a layout of just these could be; NOTE: there are thousands, and all sorted."""

    value: Value
    mask: Mask
    rest: int  # what the others reserve, each in its own partition


class _Sharing(NamedTuple):
    """A set of CoIs that share; NOTE: there are thousands of them, and they are sorted."""

    key: int  # as in `LayoutChoice`
    mask: Mask
    alone: int  # what they reserve apart


@dataclass(slots=True, kw_only=True)
class Layouts:
    """The layouts that the candidates allow, at their lower ends."""

    candidates: Candidates
    objective: Objective
    _costs: dict[Mask, Least] = field(init=False)
    _by_top: dict[int, list[Mask]] = field(init=False)
    _listed: frozenset[Mask] = field(init=False)  # compounds that were a gain before what is known by now
    _least: dict[Mask, Least] = field(init=False)
    _within: dict[Mask, list[Mask]] = field(init=False)
    _sets: list[_Sharing] = field(init=False)
    _heap: list[Shared] | None = field(init=False)
    _alone: list[int] = field(init=False)
    _weights: list[int] = field(init=False)

    def __post_init__(self) -> None:
        known = self.candidates
        self._costs = _costs(known)
        self._listed = frozenset(self._costs)
        self._by_top = {}
        for mask in self._costs:
            self._by_top.setdefault(mask.bit_length(), []).append(mask)
        self._least = {0: 0}
        self._within = {}
        self._alone = [coi.cost for coi in known.cois]
        self._weights = weights_of(known.cois, self.objective.criticalities)
        self._sets = self._sharing()
        self._heap = None

    def after(self, candidates: Candidates) -> "Layouts":
        """Return the layouts of the same CoIs after more answers; what these do not change is not worked out again.

        Args:
            candidates: the same CoIs and compounds, of which more is known.

        Returns:
            New layouts; these stay as they are.
        """
        costs = _costs(candidates)
        if not costs.keys() <= self._costs.keys():
            return Layouts(candidates=candidates, objective=self.objective)
        later = copy(self)
        later._learn(candidates, costs)  # noqa: SLF001 - its own
        return later

    def _learn(self, candidates: Candidates, costs: dict[Mask, Least]) -> None:
        changed: list[Mask] = []
        for mask in sorted((cost for cost in self._costs if costs.get(cost) != self._costs[cost]), key=int.bit_count):
            if not any(part & mask == part for part in changed):
                changed.append(mask)
        least = self._least.copy()
        for part in changed:
            least = {mask: found for mask, found in least.items() if mask & part != part}
        self.candidates, self._costs, self._least = candidates, costs, least
        self._heap = None if self._heap is None else self._heap.copy()

    def seen(self) -> "Layouts":
        """Return the layouts that are known to hold.

        They have only compounds that met all APTs at some CR, each at the least such CR.
        """
        passed = {
            mask: replace(candidate, coi=replace(candidate.coi, reserve=candidate.passed))
            for mask, candidate in self.candidates.by_mask.items()
            if candidate.passed is not None
        }
        return Layouts(candidates=replace(self.candidates, by_mask=passed), objective=self.objective)

    def value(self, choice: LayoutChoice) -> Value:
        """Return what the layout is compared on; the smaller, the better.

        Args:
            choice: a layout of these CoIs.

        Returns:
            By the objective's order: criticalities of those that share and total reservation (or the other way
                round), then partitions.
        """
        return self._value(choice.key, choice.total, choice.partitions)

    def _value(self, key: int, reserved: int, partitions: int) -> Value:
        if self.objective.minimise is Minimise.COMBINING:
            return key, reserved, partitions
        return reserved, key, partitions

    def best(self) -> LayoutChoice | None:
        """Return the best layout that fits.

        Returns:
            The layout, at the lower ends of what its compounds may need; None: nothing fits, however little they
                need.
        """
        best: LayoutChoice | None = None
        for shared in self.ranked():
            if best is not None and shared.value[0] > self.value(best)[0]:
                break
            choice = next(self._of(shared), None)
            if choice is not None and (best is None or self.value(choice) < self.value(best)):
                best = choice
        return best

    def ranked(self) -> Iterator[Shared]:
        """Go through the sets of CoIs that may share and have room for it, the best first.

        Yields:
            Each set once, by the value that the best layout of it has at least.
        """
        if self.objective.minimise is Minimise.COMBINING:
            yield from self._with_room()
        else:
            yield from self._by_reservation()

    def _by_reservation(self) -> Iterator[Shared]:
        """Yield what `_with_room` does, the least reservation first.

        The heap keeps older values. They are lower bounds, so each is brought up to date only when it comes first.
        """
        if self._heap is None:
            self._heap = sorted(self._with_room())
        heap, found = self._heap, []
        try:
            while heap:
                now = self._looked_at(heap[0])
                if now is None:
                    heapq.heappop(heap)
                elif now.value != heap[0].value:
                    heapq.heapreplace(heap, now)
                else:
                    found.append(heapq.heappop(heap))
                    yield now
        finally:
            for sharing in found:
                heapq.heappush(heap, sharing)

    def _looked_at(self, shared: Shared) -> Shared | None:
        """Bring a set of CoIs up to date; None: there is no room for it any more."""
        least = self.least(shared.mask)
        if least > self._room(shared.rest):
            return None
        return Shared(self.value_of(shared.mask, shared.rest, least, self.key(shared.mask)), shared.mask, shared.rest)

    def _with_room(self) -> Iterator[Shared]:
        everything, capacity = sum(self._alone), self.objective.capacity
        for sharing in self._sets:
            rest = everything - sharing.alone
            if rest <= capacity and (least := self.least(sharing.mask)) >> PARTITIONS <= capacity - rest:
                yield Shared(self.value_of(sharing.mask, rest, least, sharing.key), sharing.mask, rest)

    def value_of(self, shared: Mask, rest: int, least: Least, key: int) -> Value:
        """Return what a layout is compared on in which these CoIs share partitions.

        Args:
            shared: the CoIs that share.
            rest: what the others reserve, in per cent of one logical processor.
            least: what those that share reserve at least, and in how many partitions.
            key: the criticalities of those that share, as in `LayoutChoice`.

        Returns:
            As of `value`.
        """
        return self._value(key, rest + (least >> PARTITIONS), self.partitions(shared, least & (1 << PARTITIONS) - 1))

    def partitions(self, shared: Mask, compounds: int) -> int:
        """Count all partitions: those of the CoIs that share, and one for each other CoI.

        Args:
            shared: the CoIs that share.
            compounds: in how many partitions these are.

        Returns:
            A count of partitions, on all hosts together.
        """
        return len(self._alone) - shared.bit_count() + compounds

    def _room(self, rest: int) -> Least:
        return (self.objective.capacity - rest + 1 << PARTITIONS) - 1

    def _sharing(self) -> list[_Sharing]:
        """Sets of CoIs that may be those who share; the best first."""
        if len(self._costs) <= FEW:
            found = {0}
            for block in self._costs:
                found |= {mask | block for mask in found if not mask & block}
            return sorted(_Sharing(self.key(mask), mask, self._apart(mask)) for mask in found)
        used = 0
        for mask in self._costs:
            used |= mask
        everything = [_Sharing(0, 0, 0)]
        for at in range(used.bit_length()):
            if used >> at & 1:
                weight, alone, bit = self._weights[at], self._alone[at], 1 << at
                everything += [_Sharing(mask.key + weight, mask.mask | bit, mask.alone + alone) for mask in everything]
        return sorted(everything)

    def _apart(self, mask: Mask) -> int:
        return sum(cost for at, cost in enumerate(self._alone) if mask >> at & 1)

    def _of(self, shared: Shared) -> Iterator[LayoutChoice]:
        """Layouts in which just these share, that fit, by what they reserve."""
        key = self.key(shared.mask)
        for cost, blocks in self._partitions(shared.mask):
            if shared.rest + cost > self.objective.capacity:
                return
            if self.objective.fits(self.cois_of(blocks)):
                partitions = self.partitions(shared.mask, len(blocks))
                yield LayoutChoice(
                    blocks=tuple(sorted(blocks)), total=shared.rest + cost, partitions=partitions, key=key
                )

    def key(self, shared: Mask) -> int:
        """Return the criticalities of the CoIs that share, as in `LayoutChoice`.

        Args:
            shared: the CoIs that share.

        Returns:
            A sum of `weights_of`: the smaller, the better.
        """
        return sum(weight for at, weight in enumerate(self._weights) if shared >> at & 1)

    def cois_of(self, blocks: Sequence[Mask]) -> tuple[Coi, ...]:
        """List what the partitions of a layout hold, each compound with the least CR that it may need.

        Args:
            blocks: the compounds of a layout; no CoI is in two of them.

        Returns:
            First the CoIs that stay alone, the least critical first, then the compounds in the given order.
        """
        taken = 0
        for mask in blocks:
            taken |= mask
        alone = [coi for at, coi in enumerate(self.candidates.cois) if not taken >> at & 1]
        return (*alone, *(self.candidates.by_mask[mask].coi for mask in blocks))

    def least(self, mask: Mask) -> Least:
        """Return the least that these reserve when each of them shares.

        Args:
            mask: some of the CoIs.

        Returns:
            Reservation and partitions, worked out once for each set; `NEVER` or more: some of them can share with
                nobody.
        """
        found = self._least.get(mask)
        if found is None:
            found, costs = NEVER, self._costs
            for block in self.blocks(mask):
                if (cost := costs.get(block, NEVER)) < found and (least := cost + self.least(mask ^ block)) < found:
                    found = least
            self._least[mask] = found
        return found

    def cost(self, block: Mask) -> Least:
        """Return what the compound reserves in its one partition, and that it is one partition.

        Args:
            block: the members of one compound.

        Returns:
            Reservation and one partition; `NEVER`: it is no candidate, or no gain.
        """
        return self._costs.get(block, NEVER)

    def blocks(self, mask: Mask) -> list[Mask]:
        """List the compounds within the set that hold its most critical member, and some that are no gain any more.

        Args:
            mask: at least one CoI.

        Returns:
            Their masks; whoever uses them asks `cost`. Worked out once for each set.
        """
        found = self._within.get(mask)
        if found is None:
            found = self._within[mask] = self._found_within(mask)
        return found

    def _found_within(self, mask: Mask) -> list[Mask]:
        top = mask.bit_length()
        listed = self._by_top.get(top, [])
        others = mask ^ (1 << (top - 1))
        if len(listed) <= 1 << others.bit_count():
            return [block for block in listed if block & mask == block]
        found, part = [], others
        while part:
            if (block := part | 1 << (top - 1)) in self._listed:
                found.append(block)
            part = (part - 1) & others
        return found

    def _partitions(self, mask: Mask) -> Iterator[tuple[int, tuple[Mask, ...]]]:
        """All ways to make compounds of them, the cheapest first: what is left is known to cost at least so much."""
        number = count()
        waiting: list[tuple[Least, int, Least, Mask, tuple[Mask, ...]]] = []
        if (least := self.least(mask)) < NEVER:
            waiting.append((least, next(number), 0, mask, ()))
        while waiting:
            _, _, cost, remaining, blocks = heapq.heappop(waiting)
            if not remaining:
                yield cost >> PARTITIONS, blocks
                continue
            for block in self.blocks(remaining):
                now = cost + self.cost(block)
                if (least := now + self.least(remaining ^ block)) < NEVER:
                    heapq.heappush(waiting, (least, next(number), now, remaining ^ block, (*blocks, block)))


def _costs(known: Candidates) -> dict[Mask, Least]:
    return {
        mask: (candidate.coi.cost << PARTITIONS) + 1 for mask, candidate in known.by_mask.items() if candidate.is_gain
    }
