"""Packings of plain sizes bin by bin: the largest item that is left, and beside it what fills the bin best.

What fills a bin best is found exactly, with the sums that the rest can make as bits of one number
(after Gupta and Ho's minimum bin slack).
"""

from collections.abc import Sequence
from random import Random

LARGEST_ROOM = 20_000
"""Larger rooms have too many sums."""


def fullest(sizes: Sequence[int], room: int, tries: int, target: int) -> tuple[int, ...] | None:
    """The bin of each item, in the best of so many packings; None where the room is too large to try.

    The same sizes always give the same answer; a packing into `target` bins ends the search.
    """
    if room > LARGEST_ROOM:
        return None
    random = Random(len(sizes))  # noqa: S311 - the same input gives the same orders
    by_size = sorted(range(len(sizes)), key=lambda item: (-sizes[item], item))
    best: tuple[int, ...] | None = None
    for number in range(tries):
        found = _packed(sizes, room, by_size, random if number else None)
        if best is None or max(found) < max(best):
            best = found
        if max(best, default=-1) + 1 <= target:
            break
    return best


def _packed(sizes: Sequence[int], room: int, by_size: Sequence[int], random: Random | None) -> tuple[int, ...]:
    where = [0] * len(sizes)
    left, number = list(by_size), 0
    while left:
        first, rest = left[0], left[1:]
        # In which order the rest is looked at decides between sets that fill a bin as well.
        order = rest if random is None else sorted(rest, key=lambda item: -sizes[item] * (1 + random.random()))
        taken = {first, *_filling(sizes, order, room - sizes[first])}
        for item in taken:
            where[item] = number
        left, number = [item for item in left if item not in taken], number + 1
    return tuple(where)


def _filling(sizes: Sequence[int], order: Sequence[int], room: int) -> list[int]:
    """Of the items those that together leave least of the room; early ones in the order rather than late ones."""
    inside = (1 << room + 1) - 1
    sums = [1]  # from the last item backwards: what can be made, as bits
    for item in reversed(order):
        sums.append((sums[-1] | sums[-1] << sizes[item]) & inside)
    goal, chosen = sums[-1].bit_length() - 1, []
    for item, without in zip(order, reversed(sums[:-1]), strict=True):
        if goal >= sizes[item] and without >> goal - sizes[item] & 1 and sizes[item]:
            chosen.append(item)
            goal -= sizes[item]
    return chosen
