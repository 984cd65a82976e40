"""A packing out of the patterns that are nearly free under given weights: few are, and good packings are made of them.

The weights bound all packings; what a packing costs more than the bound is the sum of what its patterns cost more than
their weight. So a packing of a wanted cost has no pattern that alone costs more than is left.
"""

from collections import Counter
from collections.abc import Sequence
from itertools import chain

from rarms_iac.planner.packing.columns import Weights, fixed_cost, profits_of
from rarms_iac.planner.packing.density import within
from rarms_iac.planner.packing.exact_fills import exact_fills, full_dimensions
from rarms_iac.planner.packing.program import Bundles, Mask, Program, charge_of, members

FILLS = 40_000
"""Exact fills that are listed at most."""

LISTED = 5_000
"""Patterns of a kind of host that are listed at most where there is room to spare."""

PATTERNS = 30_000
"""More patterns than these that are nearly free are too many."""

SCANNED = 10_000_000
"""Patterns that are looked at in all."""

_COUNTING = 8
"""What counting costs beside looking."""

Column = tuple[int, int, Mask, tuple[int, ...]]
"""What it costs more than its weight, kind, items as bits, and as numbers with the kind's behind them."""


def covered(program: Program, weights: Weights, lowest: int, below: int) -> tuple[Bundles | None, int]:
    """A packing that costs less than `below`, None where none was found; and what none can be below, by trying all.

    Args:
        program: what is packed.
        weights: that bound it.
        lowest: a bound of it.
        below: what a packing is known to cost.
    """
    fills = _fills(program)
    scanned = SCANNED
    for value in range(lowest, below):
        columns, idle, slack = _columns(program, weights, value, fills)
        if columns is None:
            return None, value
        search = _Cover(program, columns, idle, scanned)
        found = search.run(slack)
        scanned = search.scanned
        if found is not None:
            return found, value
        if scanned <= 0:
            return None, value
    return None, below


def _fills(program: Program) -> tuple[Mask, ...] | None:
    if program.patterns is not None:
        return program.patterns
    full = full_dimensions(program)
    return exact_fills(program, full, FILLS) if full else None


def _columns(
    program: Program, weights: Weights, value: int, fills: Sequence[Mask] | None
) -> tuple[list[Column] | None, tuple[int, ...], int]:
    """The patterns that a packing of this value may have, cheapest first; what idle hosts cost, by kind; the slack."""
    scale, kinds = weights.scale, range(len(program.kinds))
    total = sum(weights.items) + weights.budget * (program.budget or 0)
    fixed = [fixed_cost(program, at, weights) for at in kinds]
    listed = None if fills is None else [(mask, members(mask)) for mask in fills]
    lists: list[list[tuple[int, Mask]]] = []
    rooms: list[int] = []
    for at in kinds:
        profits = profits_of(program, at, weights)
        found: list[tuple[int, Mask]] | None
        if listed is not None:
            found = [(sum([profits[item] for item in items]), mask) for mask, items in listed]
            found = [one for one in found if program.fits is None or program.fits(at, one[1])]
        else:
            found = within(program, at, profits, fixed[at] + min(0, total - value * scale), LISTED)
        if found is None:
            return None, (), 0
        lists.append(found)
        rooms.append(min(0, fixed[at] - max((profit for profit, _ in found), default=fixed[at])))
    slack = value * scale - total - sum(len(program.kinds[at].hosts) * rooms[at] for at in kinds)
    columns = [
        (fixed[at] - profit - rooms[at], at, mask, (*members(mask), program.items + at))
        for at in kinds
        for profit, mask in lists[at]
        if fixed[at] - profit - rooms[at] <= slack
    ]
    return (None if len(columns) > PATTERNS else sorted(columns)), tuple(-one for one in rooms), slack


class _Cover:
    """Depth first: what has the fewest patterns left is decided next, be it an item or a host that must be used."""

    def __init__(self, program: Program, columns: list[Column], idle: tuple[int, ...], scanned: int) -> None:
        self.program, self.columns, self.idle, self.scanned = program, columns, idle, scanned
        self.everything = (1 << program.items) - 1

    def run(self, slack: int) -> Bundles | None:
        """The first packing that costs no more than the slack above the bound."""
        return self._down(self.columns, 0, tuple(len(kind.hosts) for kind in self.program.kinds), slack, ())

    def _down(
        self, columns: list[Column], done: Mask, left: tuple[int, ...], slack: int, taken: Bundles
    ) -> Bundles | None:
        program, first = self.program, self.program.items
        if done == self.everything:
            unused = sum(hosts * cost for hosts, cost in zip(left, self.idle, strict=True))
            paid = program.budget is None or charge_of(program, taken) == program.budget
            return tuple(sorted(taken)) if paid and unused <= slack else None
        self.scanned -= _COUNTING * len(columns)
        counts = Counter(chain.from_iterable([column[3] for column in columns]))
        spent = sum(
            hosts * self.idle[kind] for kind, hosts in enumerate(left) if hosts and not counts[first + kind]
        )  # hosts that nothing can use any more
        if spent > slack:
            return None
        wanted = [item for item in range(first) if not done >> item & 1]
        wanted += [
            first + kind
            for kind, hosts in enumerate(left)
            if hosts == 1 and counts[first + kind] and self.idle[kind] > slack - spent
        ]
        chosen = min(wanted, key=lambda one: (counts[one], one))
        for more, kind, mask, covers in columns:
            if chosen not in covers or more + spent > slack:
                continue
            self.scanned -= len(columns)
            if self.scanned <= 0:
                return None
            after = tuple(hosts - (at == kind) for at, hosts in enumerate(left))
            rest = slack - more
            fitting = [one for one in columns if not one[2] & mask and one[0] <= rest and after[one[1]]]
            found = self._down(fitting, done | mask, after, rest, (*taken, (kind, mask)))
            if found is not None:
                return found
        return None
