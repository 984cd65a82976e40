"""The linear program of column generation by HiGHS: the only module that imports it, and only where it is installed.

One thread and no presolve, so that the same program has the same answer in one installation. Nothing it says is
believed: bounds are made of its duals as of our own, by exact knapsacks.
"""

from collections.abc import Sequence

from rarms_iac.planner.packing.linear.simplex import TOLERANCE, Entries

_OPTIONS: tuple[tuple[str, bool | int | str], ...] = (
    ("output_flag", False),
    ("threads", 1),
    ("random_seed", 0),
    ("presolve", "off"),
    ("solver", "simplex"),
)

_CHEAPER = 3
"""Pivots that cost as much as one of our own."""


class Highs:
    """The program of `master.Restricted`."""

    def __init__(self, right: Sequence[float], penalties: Sequence[float]) -> None:
        import highspy

        self._unbounded = float(highspy.kHighsInf)
        self._solver = highspy.Highs()
        for name, value in _OPTIONS:
            self._solver.setOptionValue(name, value)
        for there in right:
            self._solver.addRow(there, there, 0, [], [])
        self._penalties = len(right)  # the first columns: a row that is left unmet
        for row, penalty in enumerate(penalties):
            self._solver.addCol(penalty, 0.0, self._unbounded, 1, [row], [1.0])
        self._columns = 0
        self._pivots = 0

    @property
    def pivots(self) -> int:
        """Steps that it took so far, in steps of our own."""
        return self._pivots // _CHEAPER

    def add(self, cost: float, entries: Entries) -> int:
        """One column more; its number."""
        rows, coefficients = [row for row, _ in entries], [coefficient for _, coefficient in entries]
        self._solver.addCol(cost, 0.0, self._unbounded, len(rows), rows, coefficients)
        self._columns += 1
        return self._columns - 1

    def solve(self, limit: int = 20_000) -> float:
        """The value of the optimum, or of what so many pivots made of it."""
        self._solver.setOptionValue("simplex_iteration_limit", limit * _CHEAPER)
        self._solver.run()
        info = self._solver.getInfo()
        self._pivots += max(0, int(info.simplex_iteration_count))
        return float(info.objective_function_value)

    def duals(self) -> list[float]:
        """By row: what one unit more of its right-hand side would cost."""
        return [float(one) for one in self._solver.getSolution().row_dual]

    def solution(self) -> dict[int, float]:
        """The columns that are used, with how much."""
        values = self._solver.getSolution().col_value[self._penalties :]
        return {column: float(value) for column, value in enumerate(values) if value > TOLERANCE}
