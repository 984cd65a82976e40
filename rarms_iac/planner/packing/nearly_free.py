"""The patterns of a host that cost little more than their weight: the only ones that good packings are made of."""

from collections.abc import Sequence
from dataclasses import dataclass

from rarms_iac.planner.packing.columns import Weights, fixed_cost, profits_of
from rarms_iac.planner.packing.density import within
from rarms_iac.planner.packing.nodes import View
from rarms_iac.planner.packing.program import Mask, Program, Sizes
from rarms_iac.planner.packing.waste import fills, spare

LISTED = 12_000
"""Patterns of a kind of host that are listed at most where there is room to spare."""

_MOST_ITEMS = 36
"""Nearly full sets of more items are not listed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CloseFits:
    """What a packing may waste in all, and by kind the only sets that a host can have, where they could be listed."""

    most: Sizes
    fills: tuple[Sequence[Mask] | None, ...]

    def below(self, view: View) -> "CloseFits":
        """The same for the smaller program of a view."""
        known: dict[int, tuple[Mask, ...]] = {}
        ours = [
            None if one is None else known.get(id(one)) or known.setdefault(id(one), tuple(view.those(one)))
            for one in self.fills
        ]
        return CloseFits(most=self.most, fills=tuple(ours))


def close_fits(program: Program) -> CloseFits | None:
    """What little a packing may waste; None where that is not known, or much."""
    most = spare(program) if program.items <= _MOST_ITEMS else None
    if most is None:
        return None
    known = {kind.room: fills(program, kind, most) for kind in program.kinds}
    return CloseFits(most=most, fills=tuple(known[kind.room] for kind in program.kinds))


def nearly_free(
    program: Program, at: int, weights: Weights, slack: int, close: CloseFits | None
) -> list[tuple[int, Mask]] | None:
    """The patterns of a kind that cost no more than the slack beyond their weight, and that; None: too many."""
    fixed, profits = fixed_cost(program, at, weights), profits_of(program, at, weights)
    known = None if close is None else close.fills[at]
    if known is None:
        found = within(program, at, profits, fixed - slack, LISTED, None if close is None else close.most)
        return None if found is None else [(fixed - profit, mask) for profit, mask in found]
    kind = program.kinds[at]
    banned = sum(1 << item for item, size in enumerate(kind.sizes) if size is None)
    profit_of = Sums(profits)
    low, middle, high, width = profit_of.low, profit_of.middle, profit_of.high, profit_of.width
    inside, twice, wanted = (1 << width) - 1, 2 * width, fixed - slack
    weighed = [
        (fixed - profit, mask)
        for mask in known
        if (profit := low[mask & inside] + middle[mask >> width & inside] + high[mask >> twice]) >= wanted
        and not mask & banned
    ]
    return [one for one in weighed if program.fits is None or program.fits(at, one[1])]


class Sums:
    """Sums over sets of items, looked up in three parts: quick for many sets of few items."""

    def __init__(self, numbers: Sequence[int]) -> None:
        self.width = -(-len(numbers) // 3)
        parts = [numbers[part * self.width : (part + 1) * self.width] for part in range(3)]
        self.low, self.middle, self.high = map(_sums, parts)

    def of(self, mask: Mask) -> int:
        """What the items of a set add up to."""
        inside = (1 << self.width) - 1
        return self.low[mask & inside] + self.middle[mask >> self.width & inside] + self.high[mask >> 2 * self.width]


def _sums(numbers: Sequence[int]) -> list[int]:
    """By set of them, as bits: what they add up to."""
    sums = [0]
    for one in numbers:
        sums += [there + one for there in sums]
    return sums
