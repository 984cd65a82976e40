"""Packings at once: bin by bin, each filled with what is worth most, or size by size, each where least is left."""

from collections.abc import Sequence
from dataclasses import replace
from operator import truediv

from rarms_iac.planner.packing.plain.demand import Demand, Pattern, left_of
from rarms_iac.planner.packing.plain.multiples import best_fill
from rarms_iac.planner.packing.plain.surrogate import by_share

_NODES = 300


def filled(demand: Demand, weights: Sequence[int] = ()) -> list[Pattern]:
    """The bins, one after the other: the largest that is left, and beside it what is worth most."""
    worth = [2 * weight + 1 for weight in weights] if any(weights) else [2 * one + 1 for one in by_share(demand)]
    found, counts = list[Pattern](), list(demand.counts)
    while any(counts):
        first = next(at for at, count in enumerate(counts) if count)
        counts[first] -= 1
        room = tuple(map(int.__sub__, demand.room, demand.sizes[first]))
        left = replace(demand, counts=tuple(counts), room=room)
        more = dict(best_fill(left, worth, 0, nodes=_NODES, sure=False).pattern)
        more[first] = more.get(first, 0) + 1
        found.append(tuple(sorted(more.items())))
        counts[first] += 1
        counts = left_of(counts, found[-1:])
    return found


def best_fit(demand: Demand) -> list[Pattern]:
    """The largest first, each into the bin that it leaves least open."""
    rooms = [max(1, one) for one in demand.room]
    bins = list[tuple[list[int], dict[int, int]]]()
    for at, (size, count) in enumerate(zip(demand.sizes, demand.counts, strict=True)):
        for _ in range(count):
            there = [one for one in bins if all(map(int.__le__, size, one[0]))]
            if not there:
                there = [(list(demand.room), {})]
                bins += there
            free, inside = min(there, key=lambda one: sum(map(truediv, one[0], rooms)))
            free[:] = map(int.__sub__, free, size)
            inside[at] = inside.get(at, 0) + 1
    return [tuple(sorted(inside.items())) for _, inside in bins]
