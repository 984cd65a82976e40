"""The relaxation of plain sizes into equal bins: every size as often as it is there, by patterns in parts.

The duals of the linear program become whole numbers, one weight a size. Whatever they are, no bin carries more weight
than an exact knapsack says: so what all weights add up to, through the most that a bin carries, bounds every packing.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import ceil

from rarms_iac.planner.packing.columns import SCALE
from rarms_iac.planner.packing.linear.master import Restricted, restricted
from rarms_iac.planner.packing.plain.demand import Demand, Pattern
from rarms_iac.planner.packing.plain.multiples import NODES, best_fill

_GAIN = 1e-6

_ABOVE = SCALE + 8
"""Patterns of no more weight do not matter: those that are known may have so much, by the rounding of weights."""

_MORE = 12
"""Further patterns of one look, each of sizes that those before left."""

_LOOK = 2_000
"""A look for patterns counts as the third power of rows, through this."""

_PIVOTS = 100
"""Pivots that are made in any case."""

_QUICK = 400
"""Sets that are tried for each of those."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Relaxation:
    """No packing has fewer bins than the bound; `parts` is the packing in parts, and `value` its bins."""

    bound: int
    value: float
    weights: tuple[int, ...]
    parts: tuple[tuple[Pattern, float], ...]
    pool: tuple[Pattern, ...]  # all patterns that are known
    work: int  # that it took


@dataclass(frozen=True, slots=True, kw_only=True)
class Looks:
    """How much is tried, in counts."""

    rounds: int = 300
    work: int = 400_000  # after which no more patterns are looked for: pivots times rows, and what looks count as
    nodes: int = NODES
    sure: bool = True  # whether the bound matters
    own: bool = False  # our own linear program, whatever is installed


def relaxed(demand: Demand, known: Iterable[Pattern], least: int, looks: Looks) -> Relaxation:
    """Bound the bins from below, from the least that is known up to what the linear program rounds up to."""
    sizes = [at for at, count in enumerate(demand.counts) if count]
    rows = {at: row for row, at in enumerate(sizes)}
    master = restricted([float(demand.counts[at]) for at in sizes], [1.0] * len(sizes), own=looks.own)
    _lesser(demand, sizes, rows, master)
    pool: dict[Pattern, int] = {}

    def add(pattern: Pattern) -> bool:
        if pattern in pool or not pattern:
            return False
        pool[pattern] = master.add(1.0, tuple((rows[at], float(count)) for at, count in pattern))
        return True

    for pattern in known:
        add(pattern)
    bound, value, weights = least, 0.0, [0] * len(demand.counts)
    look, looked = len(sizes) ** 3 // _LOOK, 0
    for _ in range(looks.rounds):
        looked += look
        master.solve(max(_PIVOTS, looks.work // len(sizes) - master.pivots))
        duals = master.duals()
        value = sum(dual * demand.counts[at] for at, dual in zip(sizes, duals, strict=True))
        for at, dual in zip(sizes, duals, strict=True):
            weights[at] = max(0, round(dual * SCALE))
        found = best_fill(demand, weights, _ABOVE, nodes=looks.nodes, sure=looks.sure)
        if found.most is not None:
            total = sum(weight * count for weight, count in zip(weights, demand.counts, strict=True))
            bound = max(bound, -(-total // found.most))
        if not found.pattern or (looks.sure and bound >= ceil(value - _GAIN)):
            break
        new = [add(pattern) for pattern in _several(demand, weights, found.pattern)]
        if not any(new) or looked + master.pivots * len(sizes) > looks.work:
            break
    numbers = {column: pattern for pattern, column in pool.items()}
    parts = [(numbers[column], part) for column, part in sorted(master.solution().items()) if column in numbers]
    return Relaxation(
        bound=bound,
        value=value,
        weights=tuple(weights),
        parts=tuple(parts),
        pool=tuple(pool),
        work=looked + master.pivots * len(sizes),
    )


def _lesser(demand: Demand, sizes: Sequence[int], rows: dict[int, int], master: Restricted) -> None:
    """Where there is room for a size there is room for one that is no larger, or for none: columns of no cost."""
    for number, at in enumerate(sizes):
        size = demand.sizes[at]
        smaller = (one for one in sizes[number + 1 :] if all(map(int.__le__, demand.sizes[one], size)))
        instead = next(smaller, None)
        row = ((rows[at], -1.0),) if instead is None else ((rows[at], -1.0), (rows[instead], 1.0))
        master.add(0.0, row)


def _several(demand: Demand, weights: Sequence[int], first: Pattern) -> list[Pattern]:
    """The best pattern, and good ones of what it leaves: together they move the weights further."""
    found, counts = [first], list(demand.counts)
    while len(found) <= _MORE:
        for at, _ in found[-1]:
            counts[at] = 0
        next_ = best_fill(replace(demand, counts=tuple(counts)), weights, _ABOVE, nodes=_QUICK, sure=False)
        if not next_.pattern:
            break
        found.append(next_.pattern)
    return found
