"""A packing out of the patterns that are nearly free under given weights: few are, and good packings are made of them.

The weights bound all packings; what a packing costs more than the bound is the sum of what its patterns cost more than
their weight. So a packing of a wanted cost has no pattern that alone costs more than is left. What is left is an exact
cover: each item by one pattern, each host at most once.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from operator import or_

from rarms_iac.planner.packing.columns import Weights, excess_of
from rarms_iac.planner.packing.nearly_free import CloseFits, Sums, nearly_free
from rarms_iac.planner.packing.program import Bundles, Mask, Program, Sizes, charge_of, members

PATTERNS = 50_000
"""More patterns than these that are nearly free are too many."""

_LEVELS = 64
"""Amounts of waste that are told apart."""

_LISTING = 5_000
"""Steps that listing patterns is worth."""

AT_ONCE = 2
"""Values that patterns are listed for at once: the more, the more patterns are nearly free."""

_WIDE = 4_000
"""So many patterns make a step count twice."""

Column = tuple[int, int, Mask]
"""What it costs more than its weight, kind, items: none where the host stays empty."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Covered:
    """What was found, a packing that costs less than was known or none, and what none can be below."""

    bundles: Bundles | None
    lowest: int
    steps: int  # that it took


def covered(
    program: Program, weights: Weights, lowest: int, below: int, steps: int, close: CloseFits | None = None
) -> Covered:
    """The packing that costs least, if that is less than `below`; or a bound as high as so many steps show.

    Args:
        program: what is packed.
        weights: that bound it.
        lowest: a bound of it.
        below: what a packing is known to cost.
        steps: how much is tried.
        close: what may be wasted, where that is little.
    """
    spent = 0
    while lowest < below:
        top = min(lowest + AT_ONCE, below)
        found = _up_to(program, weights, lowest, top, steps - spent, close)
        if found is None and top > lowest + 1:
            top = lowest + 1
            found = _up_to(program, weights, lowest, top, steps - spent, close)
        if found is None:
            return Covered(bundles=None, lowest=lowest, steps=spent + _LISTING)
        spent += found.steps
        if found.bundles is not None or found.lowest < top:
            return replace(found, steps=spent)
        lowest = top
    return Covered(bundles=None, lowest=below, steps=spent)


def _up_to(
    program: Program, weights: Weights, lowest: int, below: int, steps: int, close: CloseFits | None
) -> Covered | None:
    """The same with patterns listed at once; None where they are too many."""
    scale, kinds = weights.scale, range(len(program.kinds))
    excess = [excess_of(program, at, weights) for at in kinds]
    if None in excess:
        return None
    least = [-one for one in excess if one is not None]
    total = weights.total(program.budget) + sum(len(program.kinds[at].hosts) * least[at] for at in kinds)
    most = (below - 1) * scale - total
    lists = [nearly_free(program, at, weights, most + least[at], close) for at in kinds]
    if any(one is None for one in lists):
        return None
    columns = sorted(
        (cost - least[at], at, mask)
        for at, some in enumerate(lists)
        for cost, mask in some or ()
        if cost - least[at] <= most
    )
    search = _Cover(program, columns[:PATTERNS], tuple(-one for one in least), steps, close)
    sure = most if len(columns) <= PATTERNS else columns[PATTERNS][0] - 1
    for value in range(lowest, below):
        slack = value * scale - total
        found = search.run(slack) if slack <= sure else None
        if found is not None or search.steps <= 0 or slack > sure:
            return Covered(bundles=found, lowest=value, steps=_LISTING + steps - search.steps)
    return Covered(bundles=None, lowest=below, steps=_LISTING + steps - search.steps)


class _Cover:
    """Depth first over the rows of an exact cover: each item, and each host of which there is one.

    The row with the fewest patterns left is decided next. Sets of patterns are bits of one number, the dearest on top,
    so a step costs a few operations on whole numbers a row, however many patterns there are.
    """

    def __init__(
        self, program: Program, columns: Sequence[Column], idle: tuple[int, ...], steps: int, close: CloseFits | None
    ) -> None:
        self.program, self.idle, self.steps = program, idle, steps
        self.single = {at for at, kind in enumerate(program.kinds) if len(kind.hosts) == 1}
        self.several = [at for at, kind in enumerate(program.kinds) if len(kind.hosts) > 1]
        self.columns = sorted([*columns, *((idle[at], at, 0) for at in self.single)])
        self.costs = [column[0] for column in self.columns]
        self.covers = [[*members(mask), program.items + at] for _, at, mask in self.columns]
        self.of_row = _bits_of_rows(self.covers, program.items + len(program.kinds))
        self.widest = max(map(len, self.covers), default=1)
        self.clashing: dict[int, int] = {}
        self.wastes = [] if close is None else _wastes(program, self.columns, close.most)

    def run(self, slack: int) -> Bundles | None:
        """The first packing that costs no more than the slack above the bound."""
        left = tuple(len(kind.hosts) for kind in self.program.kinds)
        rows = [*range(self.program.items), *(self.program.items + at for at in sorted(self.single))]
        return self._down(self._within(slack), rows, left, slack, tuple(one.most for one in self.wastes), ())

    def _within(self, slack: int) -> int:
        """The patterns that cost no more."""
        return (1 << bisect_right(self.costs, slack)) - 1

    def _clashes(self, number: int) -> int:
        """The patterns that share an item or a single host with this one."""
        if number not in self.clashing:
            clashing = 0
            for row in self.covers[number]:
                if row < self.program.items or row - self.program.items in self.single:
                    clashing |= self.of_row[row]
            self.clashing[number] = clashing
        return self.clashing[number]

    def _down(
        self, alive: int, rows: list[int], left: tuple[int, ...], slack: int, spare: Sizes, taken: Bundles
    ) -> Bundles | None:
        self.steps -= 1 + alive.bit_length() // _WIDE
        if not rows:
            return self._whole(left, slack, taken)
        chosen = self._tightest(alive, rows, left, slack)
        while chosen and self.steps > 0:
            low = chosen & -chosen
            chosen ^= low
            number = low.bit_length() - 1
            more, kind, mask = self.columns[number]
            fitting = alive & self._within(slack - more)
            fitting ^= fitting & self._clashes(number)
            after = tuple([hosts - (at == kind) for at, hosts in enumerate(left)])
            if not after[kind]:
                fitting ^= fitting & self.of_row[self.program.items + kind]
            covers = self.covers[number]
            rest = [row for row in rows if row not in covers]
            unused = spare
            if mask and self.wastes:
                unused = tuple([most - one.of[number] for most, one in zip(spare, self.wastes, strict=True)])
                for most, one in zip(unused, self.wastes, strict=True):
                    fitting &= one.at_most(most)
            found = self._down(fitting, rest, after, slack - more, unused, (*taken, (kind, mask)) if mask else taken)
            if found is not None:
                return found
            alive ^= low
        return None

    def _tightest(self, alive: int, rows: list[int], left: tuple[int, ...], slack: int) -> int:
        """The patterns of the row that has the fewest; none where a row has none, or all together cost too much."""
        fewest, chosen, total = len(self.columns) + 1, 0, 0
        slack -= self._wasted(alive, left)
        for row in rows:
            there = alive & self.of_row[row]
            if not there:
                return 0
            total += self.costs[(there & -there).bit_length() - 1]
            count = there.bit_count()
            if count < fewest:
                fewest, chosen = count, there
        return chosen if total <= slack * self.widest else 0

    def _wasted(self, alive: int, left: tuple[int, ...]) -> int:
        """What hosts cost that nothing can use any more."""
        first = self.program.items
        return sum([left[at] * self.idle[at] for at in self.several if not alive & self.of_row[first + at]])

    def _whole(self, left: tuple[int, ...], slack: int, taken: Bundles) -> Bundles | None:
        """What was taken, if hosts that stay empty and the budget row allow."""
        unused = sum(left[at] * self.idle[at] for at in self.several)
        paid = self.program.budget is None or charge_of(self.program, taken) == self.program.budget
        return tuple(sorted(taken)) if paid and unused <= slack else None


def _bits_of_rows(covers: Sequence[Sequence[int]], rows: int) -> list[int]:
    """By row: the columns that cover it, a bit each."""
    bits = [bytearray(len(covers) // 8 + 1) for _ in range(rows)]
    for number, some in enumerate(covers):
        at, bit = number >> 3, 1 << (number & 7)
        for row in some:
            bits[row][at] |= bit
    return [int.from_bytes(one, "little") for one in bits]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Waste:
    """In one dimension: what may be wasted in all, and what each column wastes."""

    most: int
    of: Sequence[int]
    levels: Sequence[int]
    masks: Sequence[int]  # by level: the columns that waste no more

    def at_most(self, much: int) -> int:
        """The columns that waste no more, and maybe a few more."""
        return self.masks[min(bisect_left(self.levels, much), len(self.masks) - 1)] if much >= 0 else 0


def _wastes(program: Program, columns: Sequence[Column], most: Sizes) -> list[_Waste]:
    """By dimension in which little may be wasted."""
    found = []
    for d, left in enumerate(most):
        sums = {kind.sizes: Sums([0 if size is None else size[d] for size in kind.sizes]) for kind in program.kinds}
        of = [
            program.kinds[at].room[d] - sums[program.kinds[at].sizes].of(mask) if mask else 0 for _, at, mask in columns
        ]
        if max(of, default=0) == 0:
            continue
        found.append(_amounts(of, left))
    return found


def _amounts(of: Sequence[int], most: int) -> _Waste:
    values = sorted({min(one, most + 1) for one in of})
    levels = values[:: -(-len(values) // _LEVELS)]
    levels = levels if levels[-1] == values[-1] else [*levels, values[-1]]
    by_level = _bits_of_rows([[bisect_left(levels, min(one, most + 1))] for one in of], len(levels))
    return _Waste(most=most, of=of, levels=levels, masks=list(accumulate(by_level, or_)))
