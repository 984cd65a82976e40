"""Whether the reserves of virtual processors fit onto logical ones, each whole onto one (FACTS 1.2).

NOTE: the planner has its own arithmetic (model/capacity.py), and this one is written apart from it on purpose: a host
that repeated the planner's mistakes would never show them. It refuses only what certainly does not fit.
"""

from collections.abc import Mapping

CAPACITY = 100  # per cent of a logical processor
TRIES = 20_000
"""Placements that are tried before a doubtful case counts as fitting: the documented limit is only the sum."""


def packs(sizes: Mapping[int, int], processors: int) -> bool:
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
    """Every way of placing the largest first, equal gaps tried once, as far as `TRIES` go."""
    free = [CAPACITY] * processors
    choices: list[list[int]] = [_places(free, items[0])]  # of the item at this depth, those not tried yet
    placed: list[int] = []
    for _ in range(TRIES):
        if not choices[-1]:
            choices.pop()
            if not placed:
                return False
            free[placed[-1]] += items[len(placed) - 1]
            placed.pop()
            continue
        at = choices[-1].pop()
        free[at] -= items[len(placed)]
        placed.append(at)
        if len(placed) == len(items):
            return True
        choices.append(_places(free, items[len(placed)]))
    return True


def _places(free: list[int], size: int) -> list[int]:
    """One processor of each amount of room that is enough; the fullest comes last, and so is tried first."""
    by_room = {room: at for at, room in enumerate(free) if room >= size}
    return [by_room[room] for room in sorted(by_room, reverse=True)]
