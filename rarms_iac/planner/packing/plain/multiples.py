"""The bin of most profit where sizes come several times: an exact knapsack, or how much one can carry at most."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace

from rarms_iac.planner.packing.plain.demand import Demand, Pattern, in_doubles, running
from rarms_iac.planner.packing.plain.surrogate import Surrogate, carried, surrogate
from rarms_iac.planner.packing.worth import by_worth

NODES = 4_000
"""Sets that are tried before a table, or a bound, is enough."""

TABLE = 150_000
"""Rows times room up to which the table is made at once: quicker than trying sets."""

LARGEST_TABLE = 8_000_000
"""Larger tables are never made."""

_GRAINS = 4_096
"""Steps in which a bound that is not exact tells profits apart."""

_LAST = 10
"""Times as many sets are tried where none was found, before that is enough."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fill:
    """What a bin can carry: the best that was found above what was asked for, and what none is above."""

    profit: int
    pattern: Pattern  # empty: none was found
    most: int | None  # no bin carries more; None: not known


def best_fill(demand: Demand, profits: Sequence[int], above: int, *, nodes: int = NODES, sure: bool = True) -> Fill:
    """The bin of most profit, if that is above so much.

    Args:
        demand: sizes, with how many there are: a bin holds no more of one.
        profits: by size, whole numbers of either sign.
        above: fills of no more profit do not matter.
        nodes: how many sets may be tried; a count, so that the same input has the same answer.
        sure: whether more is done where none was found in so many.
    """
    gainful = [at for at, profit in enumerate(profits) if profit > 0 and demand.counts[at] > 0]
    if not gainful:
        return Fill(profit=above, pattern=(), most=above)
    cells = sum(demand.most_in_a_bin(at).bit_length() for at in gainful) * demand.room[0]
    one_dimension = len(demand.room) == 1
    if one_dimension and cells <= TABLE:
        return _by_room(demand, profits, gainful, above)
    whole = surrogate(demand, profits, gainful)
    found, complete = _Search(demand, profits, gainful, whole, above, nodes).run()
    if complete or not sure or found.pattern:
        return found if complete else replace(found, most=None)
    if one_dimension and cells <= LARGEST_TABLE:
        return _by_room(demand, profits, gainful, above)
    if one_dimension:
        return _by_profit(demand, profits, gainful, whole, above)
    found, complete = _Search(demand, profits, gainful, whole, above, nodes * _LAST).run()
    return found if complete else replace(found, most=_by_profit(demand, profits, gainful, whole, above).most)


class _Search:
    """Depth first over sizes of falling profit for their size, as many of each as fit before fewer."""

    def __init__(
        self,
        demand: Demand,
        profits: Sequence[int],
        gainful: Sequence[int],
        whole: Surrogate,
        above: int,
        nodes: int,
    ) -> None:
        ones = whole.takes
        self.order = by_worth(gainful, profits, ones)
        self.sizes = [demand.sizes[at] for at in self.order]
        self.gains = [profits[at] for at in self.order]
        self.ones = [ones[at] for at in self.order]
        self.caps = [demand.most_in_a_bin(at) for at in self.order]
        self.room, self.one_room = demand.room, whole.room
        self.sums = running([one * cap for one, cap in zip(self.ones, self.caps, strict=True)])
        self.totals = running([gain * cap for gain, cap in zip(self.gains, self.caps, strict=True)])
        self.least = [0] * (len(self.order) + 1)  # the smallest from a number on
        smallest = whole.room + 1
        for number in reversed(range(len(self.order))):
            smallest = min(smallest, self.ones[number])
            self.least[number] = smallest
        self.least[-1] = smallest
        self.best, self.chosen, self.left = above, list[tuple[int, int]](), nodes

    def run(self) -> tuple[Fill, bool]:
        self._down(0, self.room, self.one_room, 0, [])
        pattern = tuple(sorted((self.order[number], count) for number, count in self.chosen))
        return Fill(profit=self.best, pattern=pattern, most=self.best), self.left > 0

    def _down(self, number: int, free: tuple[int, ...], space: int, profit: int, taken: list[tuple[int, int]]) -> None:
        order, sums, totals, gains, ones = self.order, self.sums, self.totals, self.gains, self.ones
        count = len(order)
        while number < count and self.least[number] <= space:
            target = sums[number] + space
            full = bisect_right(sums, target, number) - 1
            most = totals[full] - totals[number]
            if full < count:
                most += (target - sums[full]) * gains[full] // ones[full]
            if profit + most <= self.best or self.left <= 0:
                return
            self.left -= 1
            size, one, gain = self.sizes[number], ones[number], gains[number]
            fitting = min(
                [self.caps[number], *(there // takes for there, takes in zip(free, size, strict=True) if takes)]
            )
            for several in range(fitting, 0, -1):
                gained = profit + several * gain
                if gained > self.best:
                    self.best, self.chosen = gained, [*taken, (number, several)]
                after = tuple([there - several * takes for there, takes in zip(free, size, strict=True)])
                taken.append((number, several))
                self._down(number + 1, after, space - several * one, gained, taken)
                taken.pop()
            number += 1


def _by_room(demand: Demand, profits: Sequence[int], gainful: Sequence[int], above: int) -> Fill:
    """In one dimension: by room, the most that the sizes up to a number bring; several of a size as 1, 2, 4 at once."""
    room = demand.room[0]
    parts = [(at, some) for at in gainful for some in in_doubles(demand.most_in_a_bin(at))]
    row = [0] * (room + 1)
    rows = [row]
    for at, some in parts:
        takes, gain = demand.sizes[at][0] * some, profits[at] * some
        row = _more(row, takes, gain)
        rows.append(row)
    if row[room] <= above:
        return Fill(profit=above, pattern=(), most=above)
    free, counts = room, dict[int, int]()
    for number in range(len(parts), 0, -1):
        if rows[number][free] != rows[number - 1][free]:
            at, some = parts[number - 1]
            counts[at] = counts.get(at, 0) + some
            free -= demand.sizes[at][0] * some
    return Fill(profit=row[room], pattern=tuple(sorted(counts.items())), most=row[room])


def _more(row: list[int], takes: int, gain: int) -> list[int]:
    if not takes:
        return [one + gain for one in row]
    return row[:takes] + [
        with_it if (with_it := less + gain) > without else without
        for without, less in zip(row[takes:], row, strict=False)
    ]


def _by_profit(demand: Demand, profits: Sequence[int], gainful: Sequence[int], whole: Surrogate, above: int) -> Fill:
    """By profit, rounded up in grains: the least room that the sizes up to a number need for it.

    The rounding makes it a bound; in one dimension the best that it knows is a fill.
    """
    grain = max(1, above // _GRAINS)
    parts = [(at, some) for at in gainful for some in in_doubles(demand.most_in_a_bin(at))]
    top = carried(whole, demand, profits, gainful) // grain + sum(demand.most_in_a_bin(at) for at in gainful) + 1
    row = [0, *[whole.room + 1] * top]
    rows = [row]
    for at, some in parts:
        row = _less(row, whole.takes[at] * some, -(-profits[at] // grain) * some)
        rows.append(row)
    most = best = max(profit for profit, takes in enumerate(row) if takes <= whole.room)
    if len(demand.room) > 1 or most * grain <= above:
        return Fill(profit=above, pattern=(), most=max(above, most * grain))
    counts = dict[int, int]()
    for number in range(len(parts), 0, -1):
        if rows[number][best] != rows[number - 1][best]:
            at, some = parts[number - 1]
            counts[at] = counts.get(at, 0) + some
            best -= -(-profits[at] // grain) * some
    profit = sum(profits[at] * some for at, some in counts.items())
    if profit <= above:
        return Fill(profit=above, pattern=(), most=most * grain)
    return Fill(profit=profit, pattern=tuple(sorted(counts.items())), most=most * grain)


def _less(row: list[int], takes: int, gain: int) -> list[int]:
    if gain >= len(row):
        return row
    return row[:gain] + [
        with_it if (with_it := less + takes) < without else without
        for without, less in zip(row[gain:], row, strict=False)
    ]
