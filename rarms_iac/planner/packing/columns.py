"""The relaxation of a packing: every item is covered by patterns in parts, found by column generation.

The duals of the linear program become whole numbers, one weight an item. Whatever they are, they bound every packing
from below: no pattern of a kind can carry more weight than the exact knapsack says. So the bound is exact, and the
weights are its certificate.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from rarms_iac.planner.packing.linear.simplex import Master
from rarms_iac.planner.packing.patterns import best_pattern
from rarms_iac.planner.packing.program import Mask, Program, members, pattern_charge, pattern_cost

SCALE = 1_000_000
"""What one unit of cost is in weights."""

NODES = 50_000
"""Sets that are tried for the excess of a host."""

_ROUNDS = 400
_GAIN = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True)
class Weights:
    """Whole numbers that bound every packing from below."""

    items: tuple[int, ...]  # by item
    budget: int = 0  # of the budget row
    scale: int = SCALE

    def total(self, budget: int | None) -> int:
        """What they bound a packing by, in parts of the scale, where no pattern gains."""
        return sum(self.items) + self.budget * (budget or 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Relaxed:
    """What the relaxation says: no packing costs less than `bound`; `parts` is the fractional packing."""

    bound: int
    total: int  # the same before it is rounded up, in parts of the weights' scale
    weights: Weights
    parts: tuple[tuple[int, Mask, float], ...]  # kind, items, how much of it
    patterns: int  # knapsacks that were solved


@dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
    """How much is tried, in counts."""

    pattern_nodes: int = 20_000
    rounds: int = _ROUNDS
    fully: bool = False  # until no pattern gains, even where the bound rounded up cannot rise any more


def profits_of(program: Program, at: int, weights: Weights) -> list[int]:
    """By item: what the weights gain by putting it onto a host of this kind."""
    kind, scale, budget = program.kinds[at], weights.scale, weights.budget
    if not budget or not kind.charges:
        return [weight - scale * cost for weight, cost in zip(weights.items, kind.costs, strict=True)]
    return [
        weight + budget * charge - scale * cost
        for weight, cost, charge in zip(weights.items, kind.costs, kind.charges, strict=True)
    ]


def fixed_cost(program: Program, at: int, weights: Weights) -> int:
    """What using a host of this kind costs, in weights."""
    return weights.scale * program.kinds[at].opening - weights.budget * program.kinds[at].charge


def excess_of(program: Program, at: int, weights: Weights) -> int | None:
    """What a set of items on a host of this kind weighs more than it costs, at most; never less than nothing.

    None where no search has the end of it.
    """
    fixed, profits = fixed_cost(program, at, weights), profits_of(program, at, weights)
    most, complete = fixed, False
    while not complete:
        best, complete = best_pattern(program, at, profits, NODES, most)
        if best is None and not complete:
            return None
        most = most if best is None else best.profit
    return most - fixed


class _Columns:
    """The linear program of a packing, with the patterns that are in it."""

    def __init__(self, program: Program, penalty: int) -> None:
        self.program = program
        self.patterns: dict[tuple[int, Mask], int] = {}
        self.by_column: dict[int, tuple[int, Mask]] = {}
        right = [1.0] * program.items + [float(len(kind.hosts)) for kind in program.kinds]
        penalties = [float(penalty)] * program.items + [0.0] * len(program.kinds)
        if program.budget is not None:
            right.append(float(program.budget))
            penalties.append(float(penalty))
        self.master = Master(right=right, penalties=penalties)
        for row in range(program.items, program.items + len(program.kinds)):
            self.master.add(0.0, ((row, 1.0),))  # hosts that stay empty
        if program.budget is not None:
            self.master.add(float(penalty), ((program.items + len(program.kinds), -1.0),))

    def add(self, kind: int, mask: Mask) -> bool:
        """Whether the pattern was new."""
        if (kind, mask) in self.patterns:
            return False
        program = self.program
        entries = [(item, 1.0) for item in members(mask)]
        entries.append((program.items + kind, 1.0))
        if program.budget is not None:
            charge = pattern_charge(program.kinds[kind], mask)
            if charge:
                entries.append((program.items + len(program.kinds), float(charge)))
        column = self.master.add(float(pattern_cost(program.kinds[kind], mask)), tuple(entries))
        self.patterns[kind, mask] = column
        self.by_column[column] = (kind, mask)
        return True

    def weights(self) -> tuple[Weights, list[float]]:
        """The duals as whole numbers, and those of the kinds as they are."""
        duals = self.master.duals()
        items, kinds = self.program.items, len(self.program.kinds)
        return (
            Weights(
                items=tuple(round(one * SCALE) for one in duals[:items]),
                budget=round(duals[items + kinds] * SCALE) if self.program.budget is not None else 0,
            ),
            duals[items : items + kinds],
        )

    def parts(self) -> tuple[tuple[int, Mask, float], ...]:
        """The fractional packing."""
        return tuple(
            (*self.by_column[column], part)
            for column, part in sorted(self.master.solution().items())
            if column in self.by_column
        )


def relax(
    program: Program, known: Iterable[tuple[int, Mask]], target: int, penalty: int, effort: Effort
) -> Relaxed | None:
    """Bound the packing from below; None where a knapsack could not be finished.

    Args:
        program: what is packed.
        known: patterns to begin with.
        target: a bound of so much is enough.
        penalty: what an item that no pattern covers costs; the bound never says more than all of them together.
        effort: how much is tried.
    """
    columns = _Columns(program, penalty)
    for number, mask in known:
        columns.add(number, mask)
    best, best_weights = 0, Weights(items=(0,) * program.items)  # in parts of the scale
    solved = 0
    for _ in range(effort.rounds):
        value = columns.master.solve()
        weights, kinds = columns.weights()
        total = weights.total(program.budget)
        new, exact = False, True
        for at, kind in enumerate(program.kinds):
            fixed = fixed_cost(program, at, weights)
            # The linear program has patterns of so much profit, but for what rounding an item's weight changes.
            enough = fixed + math.ceil(-kinds[at] * SCALE) + program.items
            profits = profits_of(program, at, weights)
            pattern, complete = best_pattern(program, at, profits, effort.pattern_nodes, enough)
            solved += 1
            if not complete and pattern is None:
                return None
            exact &= complete
            total += len(kind.hosts) * min(0, fixed - (enough if pattern is None else pattern.profit))
            if pattern is not None:
                new |= columns.add(at, pattern.items)
        if exact and (total > best or not any(best_weights.items)):
            best, best_weights = max(best, total), weights
        if best > (target - 1) * SCALE:
            break
        # What is to be paid is whole, so a bound of the value rounded up is all there is to find.
        if not new or (not effort.fully and -(-best // SCALE) >= math.ceil(value - _GAIN)):
            break
    bound = -(-best // SCALE)
    return Relaxed(bound=bound, total=best, weights=best_weights, parts=columns.parts(), patterns=solved)
