"""Sizes into as few equal bins as possible, in one or more dimensions: for published instances, and beyond 30 items.

Up to 30 items the answer is exact. Beyond, it is the best of several heuristics and of dives on the relaxation by
patterns, with the gap to the best of several bounds: the sum of sizes, dual feasible functions, and that relaxation.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from rarms_iac.planner.packing.dual import functions
from rarms_iac.planner.packing.heuristics import quick_packing
from rarms_iac.planner.packing.plain.large import pack_many
from rarms_iac.planner.packing.program import Problem, Sizes, assignment_of, cheapest
from rarms_iac.planner.packing.solve import Packed, solve

EXACT_UP_TO = 30
_TRIES = 40


@dataclass(frozen=True, slots=True, kw_only=True)
class PackedSizes:
    """A packing into equal bins."""

    bins: tuple[int, ...]  # by item: the number of its bin
    used: int
    bound: int  # no packing uses fewer; equal to `used` where that is the least

    @property
    def gap(self) -> int:
        """How many bins fewer there might be."""
        return self.used - self.bound


def pack_sizes(
    sizes: Sequence[int | Sequence[int]], capacity: int | Sequence[int], *, own: bool = False
) -> PackedSizes:
    """Pack the sizes into as few bins as possible; the same input always has the same answer.

    Args:
        sizes: whole numbers that are not negative, one an item, or one an item and dimension.
        capacity: of every bin, a number or one a dimension.
        own: our own linear program beyond 30 items, even where HiGHS is installed.

    Raises:
        ValueError: an item does not fit into an empty bin, or has other dimensions than the bins.
    """
    room = _sizes(capacity)
    items = tuple(map(_sizes, sizes))
    for at, size in enumerate(items):
        if len(size) != len(room) or any(not 0 <= takes <= there for takes, there in zip(size, room, strict=True)):
            raise ValueError(f"item {at} of size {size} does not fit into a bin of {room}")
    if not items:
        return PackedSizes(bins=(), used=0, bound=0)
    bound = least_bins(items, room)
    if len(items) > EXACT_UP_TO:
        many = pack_many(items, room, bound, own=own)
        return PackedSizes(bins=many.bins, used=many.used, bound=many.bound)
    problem = _problem(items, room, len(items))
    start = quick_packing(cheapest(problem), bound, _TRIES)
    assert start is not None, "a bin an item is enough"
    if len(start) == bound:
        return _told(assignment_of(cheapest(problem), start), bound)
    found = solve(_problem(items, room, len(start)))
    assert isinstance(found, Packed), "so many bins are enough"
    return _told(found.hosts, max(bound, found.cost.bound))


def _sizes(one: int | Sequence[int]) -> Sizes:
    return (one,) if isinstance(one, int) else tuple(one)


def _problem(items: Sequence[Sizes], room: Sizes, bins: int) -> Problem:
    return Problem(
        sizes=(tuple(items),) * bins,
        rooms=(room,) * bins,
        opening=(1,) * bins,
        costs=((0,) * len(items),) * bins,
        now=(None,) * len(items),
    )


def _told(where: Sequence[int], bound: int) -> PackedSizes:
    numbers = {bin_: at for at, bin_ in enumerate(dict.fromkeys(where))}
    return PackedSizes(bins=tuple(numbers[one] for one in where), used=len(numbers), bound=bound)


def least_bins(items: Sequence[Sizes], room: Sizes) -> int:
    """What no packing can be below, dimension by dimension."""
    bounds = [1]
    for d, capacity in enumerate(room):
        if not capacity:
            continue
        column = [size[d] for size in items]
        bounds.append(-(-sum(column) // capacity))
        tried = functions(column, capacity, thresholds=len(column))
        bounds += [-(-sum(map(weigh, column)) // weigh(capacity)) for weigh in tried]
    return max(bounds)
