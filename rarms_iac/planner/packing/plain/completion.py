"""Packings into so many bins and no more: bin by bin, the largest first, each as full as it must be.

All bins together have so much more room than there is to pack. A bin that leaves more than that open has no place in
the packing, and what it leaves open the others cannot (after Gent's and Korf's bin completion).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rarms_iac.planner.packing.plain.demand import Demand, Pattern, in_doubles
from rarms_iac.planner.packing.program import Sizes

_FILLS = 200
"""Fills of a bin that are listed at most."""

_BRANCHES = 12
"""Of them those that are tried, the fullest first."""

_LOOKS = 4_000
"""Sets that are looked at for one bin at most."""

LARGEST = 20_000
"""In larger rooms sums are not told apart."""


@dataclass(frozen=True, slots=True)
class _Fill:
    left: Sizes
    pattern: Pattern


def completed(demand: Demand, bins: int, steps: int) -> list[Pattern] | None:
    """A packing into so many bins, None where none was found in so many steps."""
    total = [
        sum(size[d] * count for size, count in zip(demand.sizes, demand.counts, strict=True)) for d in _dims(demand)
    ]
    spare = tuple(bins * room - takes for room, takes in zip(demand.room, total, strict=True))
    counts = list(demand.counts)
    left = steps

    def down(bins: int, spare: Sizes) -> list[Pattern] | None:
        nonlocal left
        first = next((at for at, count in enumerate(counts) if count), None)
        if first is None:
            return []
        if not bins or min(spare) < 0:
            return None
        for fill in _fills(demand, counts, first, spare):
            left -= 1
            if left < 0:
                return None
            for at, count in fill.pattern:
                counts[at] -= count
            rest = down(bins - 1, tuple(map(int.__sub__, spare, fill.left)))
            for at, count in fill.pattern:
                counts[at] += count
            if rest is not None:
                return [fill.pattern, *rest]
        return None

    return down(bins, spare)


def _dims(demand: Demand) -> range:
    return range(len(demand.room))


def _fills(demand: Demand, counts: Sequence[int], first: int, spare: Sizes) -> list[_Fill]:
    """Ways to fill a bin beside one of the first size, those that leave least open first."""
    found = []
    for fill in _every_fill(demand, counts, first, spare):
        found.append(fill)
        if len(found) >= _FILLS:
            break
    rooms = [max(1, one) for one in demand.room]
    found.sort(key=lambda one: (sum(left / room for left, room in zip(one.left, rooms, strict=True)), one.pattern))
    return found[:_BRANCHES]


def _every_fill(demand: Demand, counts: Sequence[int], first: int, spare: Sizes) -> Iterator[_Fill]:
    order = [at for at, count in enumerate(counts) if count and at >= first]
    caps = [counts[at] - (at == first) for at in order]
    sums = [_sums([demand.sizes[at][d] for at in order], caps, demand.room[d]) for d in _dims(demand)]
    several = [1, *[0] * (len(order) - 1)]
    looks = _LOOKS

    def down(number: int, free: Sizes) -> Iterator[_Fill]:
        nonlocal looks
        looks -= 1
        if looks < 0:
            return
        if all(map(int.__le__, free, spare)) and not any(
            count and all(map(int.__le__, demand.sizes[at], free))
            for at, count in zip(order[number:], caps[number:], strict=True)
        ):
            yield _Fill(free, tuple((at, some) for at, some in zip(order, several, strict=True) if some))
            return
        for at in range(number, len(order)):
            for reach, there, open_ in zip(sums, free, spare, strict=True):
                least = max(0, there - open_)
                if reach is not None and not reach[at] >> least & (2 << there - least) - 1:
                    return
            size = demand.sizes[order[at]]
            most = min([caps[at], *(there // takes for there, takes in zip(free, size, strict=True) if takes)])
            for some in range(most, 0, -1):
                several[at] += some
                yield from down(at + 1, tuple([there - some * takes for there, takes in zip(free, size, strict=True)]))
                several[at] -= some

    yield from down(0, tuple(map(int.__sub__, demand.room, demand.sizes[first])))


def _sums(sizes: Sequence[int], caps: Sequence[int], room: int) -> list[int] | None:
    """By number: the sums, as bits, that the sizes from that number on can make; None where the room is too large."""
    if room > LARGEST:
        return None
    inside = (1 << room + 1) - 1
    sums = [1]
    for size, cap in zip(reversed(sizes), reversed(caps), strict=True):
        reach = sums[-1]
        for some in in_doubles(cap) if size else ():
            reach |= reach << size * some
        sums.append(reach & inside)
    return sums[::-1]
