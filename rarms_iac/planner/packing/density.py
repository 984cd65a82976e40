"""The most profitable set of items by branch and bound, cut by what one dimension of all together would allow.

Quick where profits tell items apart. Where they follow sizes exactly every set looks as good, and this gives up.
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

from rarms_iac.planner.packing.program import Kind, Mask, Program, Sizes
from rarms_iac.planner.packing.worth import by_worth

TRIED = 1_000
"""Sets after which this gives up."""

_UNIT = 4_096

_LARGEST_LINE = 1_500
"""Up to so much room one dimension is looked at unit by unit."""

_NEVER = -(10**18)
_WEIGHTS = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Pattern:
    """Items for one host, and their profit."""

    profit: int
    items: Mask


def by_density(
    program: Program, at: int, gainful: Sequence[int], profits: Sequence[int], above: int
) -> tuple[Pattern | None, bool]:
    """The best set with a profit above that, None where there is none, and whether the search was complete.

    Args:
        program: what is packed.
        at: the kind of host.
        gainful: items of positive profit that fit alone.
        profits: by item.
        above: sets of no more profit do not matter.
    """
    kind = program.kinds[at]
    size_of = {item: size for item in gainful if (size := kind.sizes[item]) is not None}
    line = _lined_up(kind, size_of, profits)
    ordered, gains, ones, sums, totals = line.items, line.gains, line.ones, line.sums, line.totals
    # All dimensions stand side by side in one number; a bit above each falls where it is exceeded.
    width = max(1, *kind.room, *(max(size, default=0) for size in size_of.values())).bit_length() + 1
    takes = [_side_by_side(size_of[item], width) for item in ordered]
    guard = _side_by_side((1 << width - 1,) * len(kind.room), width)
    count, conflicts, fits = len(ordered), program.conflicts, program.fits
    best, chosen, left = max(above, 0), 0, TRIED

    def down(number: int, free: int, space: int, profit: int, items: Mask, banned: Mask) -> None:
        nonlocal best, chosen, left
        while number < count:
            target = sums[number] + space
            full = bisect_right(sums, target, number) - 1
            most = totals[full] - totals[number]
            if full < count:
                most += (target - sums[full]) * gains[full] // ones[full]
            if profit + most <= best or left <= 0:
                return
            left -= 1
            item, after = ordered[number], free - takes[number]
            if after & guard == guard and not banned >> item & 1:
                with_it = items | 1 << item
                if fits is None or fits(at, with_it):
                    gained = profit + gains[number]
                    if gained > best:
                        best, chosen = gained, with_it
                    down(number + 1, after, space - ones[number], gained, with_it, banned | conflicts[item])
            number += 1

    down(0, _side_by_side(kind.room, width) | guard, line.room, 0, 0, 0)
    return Pattern(profit=best, items=chosen) if chosen else None, left > 0


def within(
    program: Program, at: int, profits: Sequence[int], least: int, most: int, spare: Sizes | None = None
) -> list[tuple[int, Mask]] | None:
    """Every set for a host of kind `at` with so much profit at least, and its profit; None where they are too many.

    Where it is known what may be spared, only sets that leave no more.
    """
    kind = program.kinds[at]
    size_of = {
        item: size
        for item, size in enumerate(kind.sizes)
        if size is not None and all(takes <= there for takes, there in zip(size, kind.room, strict=True))
    }
    if len(kind.room) == 1 and kind.room[0] <= _LARGEST_LINE:
        return _along(program, at, profits, least, most, spare[0] if spare else kind.room[0])
    line = _lined_up(kind, size_of, profits)
    ordered, gains, ones, sums, totals = line.items, line.gains, line.ones, line.sums, line.totals
    count, conflicts, fits = len(ordered), program.conflicts, program.fits
    found: list[tuple[int, Mask]] = []
    left = most * 6
    reaches = _reaches(kind, [size_of[item] for item in ordered], spare)

    def down(number: int, free: Sizes, space: int, profit: int, items: Mask, banned: Mask) -> None:
        nonlocal left
        while number < count and left > 0 and len(found) <= most:
            target = sums[number] + space
            full = bisect_right(sums, target, number) - 1
            reach = totals[full] - totals[number]
            if full < count:
                reach += (target - sums[full]) * gains[full] // ones[full]
            if profit + reach < least or any(free[d] - fill[number] > unused for d, unused, fill in reaches):
                return
            left -= 1
            item = ordered[number]
            size = size_of[item]
            after = tuple(map(int.__sub__, free, size))
            with_it = items | 1 << item
            if min(after) >= 0 and not banned >> item & 1 and (fits is None or fits(at, with_it)):
                gained = profit + profits[item]
                if gained >= least and all(after[d] <= unused for d, unused, _ in reaches):
                    found.append((gained, with_it))
                down(number + 1, after, space - ones[number], gained, with_it, banned | conflicts[item])
            number += 1

    down(0, kind.room, line.room, 0, 0, 0)
    return found if left > 0 and len(found) <= most else None


def _along(
    program: Program, at: int, profits: Sequence[int], least: int, most: int, spare: int
) -> list[tuple[int, Mask]] | None:
    """`within` in one dimension: a table says exactly where sets that count can still be."""
    kind = program.kinds[at]
    room = kind.room[0]
    sizes = [-1 if size is None or size[0] > room else size[0] for size in kind.sizes]
    ordered = sorted((item for item, size in enumerate(sizes) if size >= 0), key=lambda item: (-sizes[item], item))
    reach = _best_by_room([sizes[item] for item in ordered], [profits[item] for item in ordered], room, spare)
    count, conflicts, fits = len(ordered), program.conflicts, program.fits
    found: list[tuple[int, Mask]] = []
    left = most * 6

    def down(number: int, free: int, profit: int, items: Mask, banned: Mask) -> None:
        nonlocal left
        while number < count and left > 0 and len(found) <= most and profit + reach[number][free] >= least:
            left -= 1
            item = ordered[number]
            after, with_it = free - sizes[item], items | 1 << item
            if after >= 0 and not banned >> item & 1 and (fits is None or fits(at, with_it)):
                gained = profit + profits[item]
                if gained >= least and after <= spare:
                    found.append((gained, with_it))
                down(number + 1, after, gained, with_it, banned | conflicts[item])
            number += 1

    down(0, room, 0, 0, 0)
    return found if left > 0 and len(found) <= most else None


def _best_by_room(sizes: Sequence[int], profits: Sequence[int], room: int, spare: int) -> list[list[int]]:
    """By number and room: the most that the items from that number on bring where no more than so much is left."""
    row = [0] + [_NEVER] * room
    rows = [_windows(row, spare)]
    for size, profit in zip(reversed(sizes), reversed(profits), strict=True):
        row = row[:size] + list(map(max, row[size:], [one + profit for one in row[: room + 1 - size]]))
        rows.append(_windows(row, spare))
    return rows[::-1]


def _windows(row: list[int], spare: int) -> list[int]:
    """By place: the most among it and so many before it."""
    wide = 1
    while wide <= spare:
        step = min(wide, spare + 1 - wide)
        row = row[:step] + list(map(max, row[step:], row))
        wide += step
    return row


@dataclass(frozen=True, slots=True, kw_only=True)
class _Line:
    """Items by profit for their size, best first; what they take is told in one dimension that none can exceed."""

    items: Sequence[int]
    gains: Sequence[int]  # a loss counts as none: nobody has to take it
    ones: Sequence[int]  # sizes
    sums: Sequence[int]  # of the sizes before each item
    totals: Sequence[int]  # of the gains before each item
    room: int


def _lined_up(kind: Kind, size_of: dict[int, Sizes], profits: Sequence[int]) -> _Line:
    one_of, room = _in_one(kind, size_of)
    ordered = by_worth(size_of, profits, one_of)
    gains, ones = [max(0, profits[item]) for item in ordered], [one_of[item] for item in ordered]
    return _Line(
        items=ordered,
        gains=gains,
        ones=ones,
        sums=[0, *accumulate(ones)],
        totals=[0, *accumulate(gains)],
        room=room,
    )


def _reaches(kind: Kind, sizes: Sequence[Sizes], spare: Sizes | None) -> list[tuple[int, int, list[int]]]:
    """Dimensions with less to spare than there is, with that, and by number what the items from it on can fill."""
    if spare is None:
        return []
    tight = [d for d, unused in enumerate(spare) if unused < kind.room[d]]
    return [(d, spare[d], [*accumulate((size[d] for size in reversed(sizes)), initial=0)][::-1]) for d in tight]


def _side_by_side(sizes: Sizes, width: int) -> int:
    return sum(size << at * width for at, size in enumerate(sizes))


def _in_one(kind: Kind, sizes: dict[int, Sizes]) -> tuple[dict[int, int], int]:
    """By item what it takes of all dimensions together, those that are scarce counting more, and the room in that.

    Rounded down item by item, so that what fits in every dimension always fits here.
    """
    rooms = [max(1, there) for there in kind.room]
    demands = [sum(size[d] for size in sizes.values()) / room for d, room in enumerate(rooms)]
    largest = max(demands, default=0.0) or 1.0
    weights = [1 + round(_WEIGHTS * (demand / largest) ** 2) for demand in demands]
    one_of = {
        item: sum(weight * _UNIT * one // room for weight, one, room in zip(weights, size, rooms, strict=True))
        for item, size in sizes.items()
    }
    return one_of, _UNIT * sum(weights)
