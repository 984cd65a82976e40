"""Whether the processors of a simulated host hold the reserves of its machines. Pure."""

from collections.abc import Mapping

CAPACITY = 100  # per cent of a logical processor
TRIES = 20_000
"""Placements that are tried before a doubtful case counts as fitting: the documented limit is only the sum."""


# NOTE: the planner has its own arithmetic (model/capacity.py), and this is written apart from it on purpose: a host
# that repeated the planner's mistakes would never show them. It refuses only what certainly does not fit.
def reserves_fit(sizes: Mapping[int, int], processors: int) -> bool:
    """Whether so many logical processors hold all reserves; `sizes` maps a per cent to how many have it."""
    items = [size for size, count in sorted(sizes.items(), reverse=True) for _ in range(count) if size > 0]
    if sum(items) > CAPACITY * processors or any(size > CAPACITY for size in items):
        return False
    return _first_fit(items, processors) or _search(items, processors)


def _first_fit(items: list[int], processors: int) -> bool:
    free = [CAPACITY] * processors
    for size in items:
        at = next((at for at, room in enumerate(free) if room >= size), None)
        if at is None:
            return False
        free[at] -= size
    return True


def _search(items: list[int], processors: int) -> bool:
    """Whether some placement holds all; also true where `TRIES` placements did not tell.

    The largest item comes first, the fullest processor that has room for it is tried first, and of processors with
    equal room one alone.
    """
    untried = [(0, (CAPACITY,) * processors)]  # the next item, and the room on each processor
    for _ in range(TRIES):
        if not untried:
            return False
        number, free = untried.pop()
        if number == len(items):
            return True
        by_room = {room: at for at, room in enumerate(free) if room >= items[number]}
        for room in sorted(by_room, reverse=True):
            at = by_room[room]
            untried.append((number + 1, (*free[:at], room - items[number], *free[at + 1 :])))
    return True
