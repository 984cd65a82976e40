"""The most profitable set of items that one host takes: an exact knapsack in any number of dimensions.

Column generation prices with it, and bounds are exact because its profits are whole numbers.
"""

from collections.abc import Callable, Sequence
from operator import getitem, sub

from rarms_iac.planner.packing.density import Pattern, by_density
from rarms_iac.planner.packing.program import Kind, Mask, Program, Sizes, members

GRAIN = 128
"""Steps in which a large dimension is bounded; sizes are rounded down, so the bound stays one."""

EXACT_ROOM = 1_500
"""A dimension of at most so many units is bounded without rounding."""

_Table = list[list[int]]


def best_pattern(
    program: Program, at: int, profits: Sequence[int], nodes: int, above: int = 0
) -> tuple[Pattern | None, bool]:
    """The most profitable set for a host of kind `at` with one item at least, and whether it is known to be that.

    Args:
        program: what is packed.
        at: the kind.
        profits: by item, whole numbers of either sign.
        nodes: how many sets may be tried; a count, so that the same input has the same answer.
        above: sets of no more profit do not matter; None is the answer where there is no other.
    """
    if program.patterns is not None:
        return _above(_best_known(program, at, profits), above), True
    kind = program.kinds[at]
    possible = [item for item in range(program.items) if _fits_alone(program, at, item)]
    gainful = [item for item in possible if profits[item] > 0]
    if not gainful:
        best = max(possible, key=lambda item: profits[item], default=None)
        return _above(None if best is None else Pattern(profit=profits[best], items=1 << best), above), True
    found, complete = by_density(program, at, gainful, profits, above)
    if not complete and found is None:
        ordered = sorted(gainful, key=lambda item: (-profits[item] / _share(kind, item), item))
        found, complete = _Knapsack(program, at, ordered, profits).search(nodes, above)
    return _above(found, above), complete


def _above(found: Pattern | None, above: int) -> Pattern | None:
    return found if found is not None and found.profit > above else None


def _best_known(program: Program, at: int, profits: Sequence[int]) -> Pattern | None:
    """The most profitable of the patterns that are known to be all."""
    assert program.patterns is not None
    banned = sum(1 << item for item, size in enumerate(program.kinds[at].sizes) if size is None)
    best = None
    for mask in program.patterns:
        if mask & banned or (program.fits is not None and not program.fits(at, mask)):
            continue
        profit = sum([profits[item] for item in members(mask)])
        if best is None or profit > best.profit:
            best = Pattern(profit=profit, items=mask)
    return best


def _fits_alone(program: Program, at: int, item: int) -> bool:
    size, room = program.kinds[at].sizes[item], program.kinds[at].room
    if size is None or any(takes > there for takes, there in zip(size, room, strict=True)):
        return False
    return program.fits is None or program.fits(at, 1 << item)


def _share(kind: Kind, item: int) -> float:
    """The part of a host that the item takes, over all dimensions; never zero."""
    size = kind.sizes[item]
    assert size is not None
    return sum(takes / max(1, there) for takes, there in zip(size, kind.room, strict=True)) + 1e-6


class _Knapsack:
    """Depth first over items of falling profit per size, cut by what each dimension alone would allow."""

    def __init__(self, program: Program, at: int, ordered: Sequence[int], profits: Sequence[int]) -> None:
        self.program, self.at, self.ordered = program, at, ordered
        kind = program.kinds[at]
        self.profits = [profits[item] for item in ordered]
        self.sizes = [size for item in ordered if (size := kind.sizes[item]) is not None]
        self.room = kind.room
        self.scales = [_scale(room) for room in kind.room]
        coarse = [
            [takes * scale // max(1, room) for takes, scale, room in zip(size, self.scales, self.room, strict=True)]
            for size in self.sizes
        ]
        self.tables = [_table([one[d] for one in coarse], self.profits, self.scales[d]) for d in range(len(self.room))]
        if len(self.room) > 1:  # all dimensions added up: cuts where none alone is full
            self.tables.append(_table(_in_sum(self.sizes, self.room), self.profits, GRAIN * len(self.room)))

    def search(self, nodes: int, above: int) -> tuple[Pattern | None, bool]:
        """The best set of so much profit, and whether nothing was left untried."""
        if len(self.room) == 1 and self.scales[0] == self.room[0] and not self._hindered():
            return self._by_table(), True
        best_profit, best_items = above, 0
        left = nodes
        count, profits, sizes = len(self.ordered), self.profits, self.sizes
        conflicts, fits = self.program.conflicts, self.program.fits
        rows, levels_of = list(zip(*self.tables, strict=True)), self._levels()

        def down(number: int, free: tuple[int, ...], profit: int, items: Mask, banned: Mask) -> None:
            nonlocal best_profit, best_items, left
            levels = levels_of(free)
            # What the items from the number on can still bring is the least of what each table says.
            while number < count and profit + min(map(getitem, rows[number], levels)) > best_profit and left > 0:
                left -= 1
                after = tuple(map(sub, free, sizes[number]))
                bit = 1 << self.ordered[number]
                if min(after) >= 0 and not banned & bit and (fits is None or fits(self.at, items | bit)):
                    item, gained = self.ordered[number], profit + profits[number]
                    if gained > best_profit:
                        best_profit, best_items = gained, items | bit
                    down(number + 1, after, gained, items | bit, banned | conflicts[item])
                number += 1

        down(0, self.room, 0, 0, 0)
        return Pattern(profit=best_profit, items=best_items) if best_items else None, left > 0

    def _hindered(self) -> bool:
        """Whether anything but size keeps items apart."""
        inside = sum(1 << item for item in self.ordered)
        return self.program.fits is not None or any(self.program.conflicts[item] & inside for item in self.ordered)

    def _by_table(self) -> Pattern:
        """In one dimension the table is the answer; the items are read out of it."""
        table, free, items = self.tables[0], self.room[0], 0
        for number, item in enumerate(self.ordered):
            if table[number][free] != table[number + 1][free]:
                items |= 1 << item
                free -= self.sizes[number][0]
        return Pattern(profit=table[0][self.room[0]], items=items)

    def _levels(self) -> Callable[[Sizes], Sequence[int]]:
        """By table: the place of what is free."""
        rooms, scales = tuple(max(1, room) for room in self.room), tuple(self.scales)
        if len(rooms) == 1:
            return lambda free: (free[0] * scales[0] // rooms[0],)

        def levels(free: Sizes) -> Sequence[int]:
            alone = [left * scale // room for left, scale, room in zip(free, scales, rooms, strict=True)]
            return (*alone, sum([left * GRAIN // room for left, room in zip(free, rooms, strict=True)]))

        return levels


def _scale(room: int) -> int:
    return room if room <= EXACT_ROOM else GRAIN


def _in_sum(sizes: Sequence[tuple[int, ...]], room: tuple[int, ...]) -> list[int]:
    return [sum(takes * GRAIN // max(1, there) for takes, there in zip(size, room, strict=True)) for size in sizes]


def _table(sizes: Sequence[int], profits: Sequence[int], room: int) -> _Table:
    """By number and room left: the most that the items from that number on bring, by this one dimension."""
    row = [0] * (room + 1)
    table = [row]
    for size, profit in zip(reversed(sizes), reversed(profits), strict=True):
        if size == 0:
            row = [one + profit for one in row]
        elif size <= room:
            row = row[:size] + [
                with_it if (with_it := less + profit) > without else without
                for without, less in zip(row[size:], row, strict=False)
            ]
        table.append(row)
    table.reverse()
    return table
