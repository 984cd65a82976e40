"""The best layout, at the least that its compounds may need by what is known of them."""

import heapq
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count

from rarms_iac.model.system import Minimise
from rarms_iac.planner.combining.candidates import Candidates, Mask
from rarms_iac.planner.combining.oracle import Coi, total

Fits = Callable[[Sequence[Coi]], bool]
"""Whether hosts can keep these promises at once; less reserve never fits worse."""

Value = tuple[int, int, int]
"""What layouts are compared on, in order; the smaller, the better."""

Least = tuple[int, int]
"""What CoIs that all share reserve at least, in per cent of one logical processor, and in how many partitions."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Objective:
    """The rule for the better of two layouts that fit."""

    capacity: int  # of all hosts, in per cent of one logical processor: what exceeds it need not be tried
    fits: Fits
    minimise: Minimise
    criticalities: Mapping[str, int]  # by component

    def weights(self, cois: Sequence[Coi]) -> list[int]:
        """Give each CoI a number for what it costs that it shares a partition.

        Returns:
            A number for each CoI, in their order, which may be large. Sums of these numbers compare as the sorted lists
                of the members' criticalities do, the most critical first.
        """
        levels = sorted(set(self.criticalities.values()))
        base = len(self.criticalities) + 1
        return [sum(base ** levels.index(self.criticalities[name]) for name in coi.members) for coi in cois]

    def value(self, weight: int, reserved: int, partitions: int) -> Value:
        """Put what a layout is compared on into the order in which it counts.

        Args:
            weight: the sum of the `weights` of the CoIs that share.
            reserved: by the whole layout, in per cent of one logical processor.

        Returns:
            The three of them.
        """
        if self.minimise is Minimise.COMBINING:
            return weight, reserved, partitions
        return reserved, weight, partitions


@dataclass(frozen=True, slots=True, kw_only=True)
class LayoutChoice:
    """A layout by its compounds; every other CoI keeps its partition."""

    blocks: tuple[Mask, ...]
    total: int  # what it reserves at least, in per cent of one logical processor
    value: Value


def best_layout(candidates: Candidates, objective: Objective) -> LayoutChoice | None:
    """Find the best layout that fits.

    The sets of CoIs that may share are looked at by the value that a layout has at least in which just these do.

    Args:
        candidates: with what the answers so far say.
        objective: what makes a layout the better one, and whether it fits.

    Returns:
        The layout, at the lower ends of what its compounds may need; None: nothing fits, however little they need.
    """
    cois = candidates.cois
    costs = {mask: candidate.coi.cost for mask, candidate in candidates.by_mask.items() if candidate.is_gain}
    leasts, weights = _leasts(costs), objective.weights(cois)

    def reserved(mask: Mask, cost: int) -> int:
        return cost + total(coi for at, coi in enumerate(cois) if not mask >> at & 1)

    def value(mask: Mask, cost: int, compounds: int) -> Value:
        weight = sum(weight for at, weight in enumerate(weights) if mask >> at & 1)
        return objective.value(weight, reserved(mask, cost), len(cois) - mask.bit_count() + compounds)

    sharing = sorted(
        (value(mask, *least), mask) for mask, least in leasts.items() if reserved(mask, least[0]) <= objective.capacity
    )
    best: LayoutChoice | None = None
    for least_value, mask in sharing:
        if best is not None and least_value >= best.value:
            break
        for cost, blocks in _partitions(mask, costs, leasts):
            if reserved(mask, cost) > objective.capacity:
                break
            if objective.fits(cois_of(candidates, blocks)):
                found = LayoutChoice(
                    blocks=tuple(sorted(blocks)), total=reserved(mask, cost), value=value(mask, cost, len(blocks))
                )
                best = found if best is None or found.value < best.value else best
                break
    return best


def cois_of(candidates: Candidates, blocks: Sequence[Mask]) -> tuple[Coi, ...]:
    """List what the partitions of a layout hold, each compound with the least CR that it may need.

    Args:
        candidates: with the compounds of the layout.
        blocks: the compounds; no CoI is in two of them.

    Returns:
        First the CoIs that stay alone, the least critical first, then the compounds in the given order.
    """
    alone = [coi for at, coi in enumerate(candidates.cois) if not any(mask >> at & 1 for mask in blocks)]
    return (*alone, *(candidates.by_mask[mask].coi for mask in blocks))


def _leasts(costs: Mapping[Mask, int]) -> dict[Mask, Least]:
    """Return the least reservation of each set that compounds can be made of."""
    shareable = 0
    for block in costs:
        shareable |= block
    leasts: dict[Mask, Least] = {0: (0, 0)}
    for mask in range(1, shareable + 1):
        if mask & shareable == mask:
            ways = [
                (costs[block] + leasts[mask ^ block][0], 1 + leasts[mask ^ block][1])
                for block in _blocks(mask, costs)
                if mask ^ block in leasts
            ]
            if ways:
                leasts[mask] = min(ways)
    return leasts


def _blocks(mask: Mask, costs: Mapping[Mask, int]) -> Iterator[Mask]:
    """Yield the compounds within the set that hold its most critical member."""
    top = 1 << mask.bit_length() - 1
    part = others = mask ^ top
    while part:
        if part | top in costs:
            yield part | top
        part = part - 1 & others


def _partitions(
    mask: Mask, costs: Mapping[Mask, int], leasts: Mapping[Mask, Least]
) -> Iterator[tuple[int, tuple[Mask, ...]]]:
    """Yield all divisions of the set into compounds, the cheapest first (A*: the undivided rest costs its least)."""
    number = count()
    waiting: list[tuple[Least, int, Least, Mask, tuple[Mask, ...]]] = [(leasts[mask], next(number), (0, 0), mask, ())]
    while waiting:
        _, _, (cost, partitions), remaining, blocks = heapq.heappop(waiting)
        if not remaining:
            yield cost, blocks
            continue
        for block in _blocks(remaining, costs):
            if (least := leasts.get(remaining ^ block)) is not None:
                now = cost + costs[block], partitions + 1
                bound = now[0] + least[0], now[1] + least[1]
                heapq.heappush(waiting, (bound, next(number), now, remaining ^ block, (*blocks, block)))
