"""Plain sizes by how many there are of each: equal sizes are one row of a linear program, however many they are."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from math import gcd
from operator import truediv

from rarms_iac.planner.packing.program import Sizes

Pattern = tuple[tuple[int, int], ...]
"""What a bin holds: numbers of sizes, in order, each with how many of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Demand:
    """Sizes that differ, the largest first, with how many there are of each; every bin has the same room."""

    sizes: tuple[Sizes, ...]
    counts: tuple[int, ...]
    room: Sizes

    def fits(self, pattern: Pattern) -> bool:
        """Whether a bin has room for it."""
        return all(
            sum(self.sizes[number][d] * count for number, count in pattern) <= room for d, room in enumerate(self.room)
        )

    def most_in_a_bin(self, at: int) -> int:
        """How many of a size one bin holds at most."""
        rooms = zip(self.room, self.sizes[at], strict=True)
        return min([self.counts[at], *(room // takes for room, takes in rooms if takes)])


def demand_of(items: Sequence[Sizes], room: Sizes) -> Demand:
    """The items by size, each dimension in the largest unit that all sizes are multiples of."""
    units = [gcd(*(size[d] for size in items)) or 1 for d in range(len(room))]
    there = tuple(one // unit for one, unit in zip(room, units, strict=True))
    counts: dict[Sizes, int] = {}
    for size in items:
        own = _in(size, units)
        counts[own] = counts.get(own, 0) + 1
    ordered = sorted(counts, key=lambda size: (-sum(map(truediv, size, (max(1, one) for one in there))), size))
    return Demand(sizes=tuple(ordered), counts=tuple(counts[size] for size in ordered), room=there)


def _in(size: Sizes, units: Sequence[int]) -> Sizes:
    return tuple(one // unit for one, unit in zip(size, units, strict=True))


def bins_of(items: Sequence[Sizes], patterns: Sequence[Pattern], demand: Demand) -> tuple[int, ...]:
    """By item: the number of its bin, where the patterns hold exactly what is demanded of the items."""
    numbers = {size: at for at, size in enumerate(demand.sizes)}
    units = [gcd(*(size[d] for size in items)) or 1 for d in range(len(demand.room))]
    waiting: list[list[int]] = [[] for _ in demand.sizes]
    for item in reversed(range(len(items))):
        waiting[numbers[_in(items[item], units)]].append(item)
    where = [0] * len(items)
    for bin_, pattern in enumerate(patterns):
        for number, count in pattern:
            for _ in range(count):
                where[waiting[number].pop()] = bin_
    return tuple(where)


def left_of(counts: Sequence[int], patterns: Sequence[Pattern]) -> list[int]:
    """What is left when the patterns are taken."""
    left = list(counts)
    for pattern in patterns:
        for number, count in pattern:
            left[number] -= count
    return left


def running(numbers: Sequence[int]) -> list[int]:
    """What the numbers before each add up to, and all of them at the end."""
    return [0, *accumulate(numbers)]


def in_doubles(count: int) -> list[int]:
    """Numbers of which any number up to the count is a sum: 1, 2, 4 and so on, and what is left."""
    found, most = [], 1
    while count > 0:
        found.append(min(most, count))
        count -= found[-1]
        most *= 2
    return found
