"""Weights read off sizes alone, for any number of items: dual feasible functions (Fekete and Schepers).

Such a function of sizes is never more for several sizes than for their sum. So no host carries more than the function
of its room, and items that weigh more than all hosts together have no packing.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

from rarms_iac.planner.packing.program import Problem

PARTS = 20
"""Functions that round sizes down to so many parts of a room are tried."""

THRESHOLDS = 100
"""Sizes below which items weigh nothing that are tried, at most."""


def too_heavy(problem: Problem) -> tuple[int, ...] | None:
    """By item a weight, so that all weigh more than all hosts carry, and as few as possible weigh anything.

    None where no function of sizes shows that there is no packing.
    """
    best: tuple[int, ...] | None = None
    for d in range(len(problem.rooms[0])):
        rooms = [room[d] for room in problem.rooms]
        sizes = [
            min((size[d] for row in problem.sizes if (size := row[item]) is not None), default=0)
            for item in range(problem.items)
        ]
        for weigh in functions(sizes, max(rooms)):
            found = _fewest([weigh(size) for size in sizes], sum(map(weigh, rooms)))
            if found is not None and (best is None or found.count(0) > best.count(0)):
                best = found
    return best


def functions(sizes: Sequence[int], room: int, thresholds: int = THRESHOLDS) -> Iterator[Callable[[int], int]]:
    """Those that are tried for these sizes in such a room, with so many thresholds at most."""
    if not room:
        return
    for k in range(1, PARTS):
        yield partial(_rounded, capacity=room, k=k)
    halves = sorted({size for size in sizes if 0 < 2 * size <= room})
    for threshold in halves[:: -(-len(halves) // thresholds) or 1]:
        yield partial(_above, capacity=room, threshold=threshold)


def _fewest(weights: Sequence[int], most: int) -> tuple[int, ...] | None:
    """The weights of the heaviest items, until they are too much; the others weigh nothing."""
    kept, total = [0] * len(weights), 0
    for item in sorted(range(len(weights)), key=lambda item: (-weights[item], item)):
        kept[item] = weights[item]
        total += weights[item]
        if total > most:
            return tuple(kept)
    return None


def _rounded(size: int, capacity: int, k: int) -> int:
    """The size, in k-ths of itself: what is no whole part of k + 1 in a bin is rounded down to one in k."""
    parts = (k + 1) * size
    return size * k if parts % capacity == 0 else parts // capacity * capacity


def _above(size: int, capacity: int, threshold: int) -> int:
    """The size; nothing where it is below the threshold, and all of a bin where only that much is left beside it."""
    if size > capacity - threshold:
        return capacity
    return size if size >= threshold else 0
