"""A program in whole numbers, solved by HiGHS: the only module that imports highspy, and only when it is asked.

One thread, a fixed seed and a limit in nodes instead of seconds, so that the same program has the same answer with the
same version of HiGHS.
"""

import importlib.util
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

_OPTIONS: Mapping[str, bool | int | float] = {
    "output_flag": False,
    "threads": 1,
    "random_seed": 0,
    "mip_rel_gap": 0.0,
    "mip_abs_gap": 0.99,  # objectives are whole numbers
}

_NEARLY = 1e-6
"""A bound in floating point that is so little above a whole number is taken for that number."""


@dataclass(frozen=True, slots=True)
class Row:
    """`low <= sum of coefficient * variable <= high`."""

    coefficients: Mapping[int, int]  # by the variable's number
    low: float
    high: float


@dataclass(slots=True)
class Nodes:
    """Nodes that several searches may look at in all: a count, never a time."""

    remaining: int
    # Iterations of the simplex method that count as a node, since a search may spend thousands before its second node;
    # 0: only nodes count.
    iterations_each: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class SolverAnswer:
    """The answer of HiGHS."""

    ones: tuple[int, ...] | None  # the variables that are 1; None: it found no solution
    bound: int | None  # no solution has less; None: no solution


def is_installed() -> bool:
    """Return whether HiGHS can be asked here; it is not imported."""
    return importlib.util.find_spec("highspy") is not None


def minimise(
    costs: Sequence[int],
    rows: Sequence[Row],
    *,
    nodes: int,
    start: Sequence[int] | None = None,
    budget: Nodes | None = None,
) -> SolverAnswer:
    """Find the cheapest choice of variables that are 0 or 1.

    Args:
        costs: What each variable costs where it is 1, at least 0.
        nodes: After so many nodes of the search the best solution so far is taken.
        start: Variables that are 1 in a solution that is known.
        budget: What other searches left, too; a search takes one node at least. None: `nodes` alone counts.

    Returns:
        The best solution that was found, with a bound; in floating point, so that the solution has to be checked.
    """
    if budget is not None and budget.remaining <= 0:
        return SolverAnswer(ones=None, bound=0)
    import highspy

    solver = highspy.Highs()
    for name, value in _OPTIONS.items():
        solver.setOptionValue(name, value)
    solver.setOptionValue("mip_max_nodes", nodes if budget is None else min(nodes, budget.remaining))
    for cost in costs:
        solver.addCol(float(cost), 0.0, 1.0, 0, [], [])
    integer = highspy.HighsVarType.kInteger
    solver.changeColsIntegrality(len(costs), list(range(len(costs))), [integer] * len(costs))
    for row in rows:
        numbers = list(row.coefficients)
        solver.addRow(row.low, row.high, len(numbers), numbers, [float(row.coefficients[at]) for at in numbers])
    if start is not None:
        solution = highspy.HighsSolution()
        chosen = set(start)
        solution.col_value = [float(at in chosen) for at in range(len(costs))]
        solver.setSolution(solution)
    solver.run()
    info = solver.getInfo()
    if budget is not None:
        by_iterations = info.simplex_iteration_count // budget.iterations_each if budget.iterations_each else 0
        budget.remaining -= max(1, info.mip_node_count, by_iterations)
    if solver.getModelStatus() == highspy.HighsModelStatus.kInfeasible:
        return SolverAnswer(ones=None, bound=None)
    bound = max(0, math.ceil(info.mip_dual_bound - _NEARLY)) if math.isfinite(info.mip_dual_bound) else 0
    if not math.isfinite(info.objective_function_value) or info.primal_solution_status != 2:
        return SolverAnswer(ones=None, bound=bound)
    values = solver.getSolution().col_value
    return SolverAnswer(ones=tuple(at for at, value in enumerate(values) if value > 0.5), bound=bound)
