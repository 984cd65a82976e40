"""What may stay where it is, host by host: an exact knapsack says how many at most, and so how many must move."""

from collections.abc import Sequence
from dataclasses import dataclass

from rarms_iac.planner.packing.plain.demand import bins_of, demand_of
from rarms_iac.planner.packing.plain.multiples import best_fill
from rarms_iac.planner.placing.first_fit import Bin, Item, cost, free_in


@dataclass(frozen=True, slots=True, kw_only=True)
class Staying:
    """Partitions that can stay together, as many of each host as there can be, and how many must move whatever is done.

    `moves` holds for placements in which every partition is where it costs least; `moves_at_all` for all.
    """

    names: tuple[str, ...]
    moves: int
    moves_at_all: int


def staying(items: Sequence[Item], bins: Sequence[Bin]) -> Staying:
    """By reservation and memory; virtual processors may let fewer stay, so that the bounds hold all the same."""
    names: list[str] = []
    moves = moves_at_all = 0
    running = [one for one in items if one.now]
    for host in bins:
        there = [one for one in running if one.now == host.name and host.name in one.claims]
        cheap = [one for one in there if _cheapest(one)]
        kept, most = _most(cheap, host)
        names += kept
        moves -= most
        moves_at_all -= most if len(cheap) == len(there) else _most(there, host)[1]
    return Staying(names=tuple(names), moves=len(running) + moves, moves_at_all=len(running) + moves_at_all)


def _cheapest(item: Item) -> bool:
    return cost(item.claims[item.now]) == min(map(cost, item.claims.values()))


def _most(items: Sequence[Item], host: Bin) -> tuple[list[str], int]:
    """Of the partitions on the host as many as it keeps, and a number that it never keeps more than."""
    free = free_in(host)
    room = (free.percent, free.memory)
    sizes = [(cost(one.claims[host.name]), one.claims[host.name].memory) for one in items]
    if min(room) < 0 or not items:
        return [], 0
    if all(sum(size[d] for size in sizes) <= room[d] for d in range(2)):
        return [one.name for one in items], len(items)
    demand = demand_of(sizes, room)
    found = best_fill(demand, [1] * len(demand.sizes), 0)
    rest = tuple((at, count) for at, count in enumerate(demand.counts))
    kept = dict(found.pattern)
    left = tuple((at, count - kept.get(at, 0)) for at, count in rest)
    where = bins_of(sizes, [found.pattern, left], demand)
    most = len(items) if found.most is None else min(found.most, len(items))
    return [one.name for one, bin_ in zip(items, where, strict=True) if bin_ == 0], most
