"""All dimensions of sizes as one: what bins hold in that they hold in each, so that one sum bounds them."""

from collections.abc import Sequence
from dataclasses import dataclass

from rarms_iac.planner.packing.plain.demand import Demand
from rarms_iac.planner.packing.worth import by_worth

_UNIT = 4_096
_PARTS = 16
"""Weights of dimensions are told apart in so many steps."""

_STEPS = (4, 2, 1)

_MANY = 100
"""For more sizes than these only the widest step is made."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Surrogate:
    """By size what it takes of all dimensions together, and the room in that."""

    takes: Sequence[int]
    room: int


def surrogate(demand: Demand, profits: Sequence[int], gainful: Sequence[int]) -> Surrogate:
    """The sum of dimensions under which a bin could carry least profit: the tightest bound that one sum gives.

    Rounded down size by size, so that what fits in every dimension always fits here.
    """
    dimensions = len(demand.room)
    if dimensions == 1:
        return Surrogate(takes=[size[0] for size in demand.sizes], room=demand.room[0])
    weights = [_PARTS // dimensions or 1] * dimensions
    best = _weighed(demand, weights)
    least = carried(best, demand, profits, gainful)
    for step in _STEPS if len(gainful) <= _MANY else _STEPS[:1]:
        for d in range(dimensions):
            for sign in (step, -step):
                other = [max(0, one + (sign if at == d else 0)) for at, one in enumerate(weights)]
                tried = _weighed(demand, other)
                if any(other) and (less := carried(tried, demand, profits, gainful)) < least:
                    weights, best, least = other, tried, less
    return best


def _weighed(demand: Demand, weights: Sequence[int]) -> Surrogate:
    rooms = [max(1, there) for there in demand.room]
    takes = [
        sum([weight * _UNIT * one // room for weight, one, room in zip(weights, size, rooms, strict=True)])
        for size in demand.sizes
    ]
    return Surrogate(takes=takes, room=_UNIT * sum(weights))


def carried(one: Surrogate, demand: Demand, profits: Sequence[int], gainful: Sequence[int]) -> int:
    """What a bin carries at most, in whole profit: as if sizes might be in it in parts."""
    takes, left, most = one.takes, one.room, 0
    for at in by_worth(gainful, profits, takes):
        count = demand.most_in_a_bin(at)
        if takes[at] * count > left:
            return most + profits[at] * left // takes[at]
        left -= takes[at] * count
        most += profits[at] * count
    return most


def by_share(demand: Demand) -> list[int]:
    """By size what it takes of all dimensions, each counting as much."""
    return list(_weighed(demand, [1] * len(demand.room)).takes)
