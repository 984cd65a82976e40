"""A small linear program that grows by columns: minimise cost, every row met with equality.

Floating point, and never believed: what its duals say is made whole numbers and bounded exactly (`columns.py`).
The basis is kept as its inverse, which suits some dozens of rows and thousands of sparse columns.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

TOLERANCE = 1e-9
_SWITCH = 40
"""Steps without gain after which the first eligible column enters instead of the best: that cannot cycle."""

Entries = tuple[tuple[int, float], ...]
"""Row and coefficient of a sparse column."""


@dataclass(slots=True)
class Master:
    """The program, kept optimal between calls of `solve`."""

    right: list[float]  # right-hand sides, none negative
    penalties: list[float]  # by row: cost of leaving it unmet
    costs: list[float] = field(default_factory=list)
    entries: list[Entries] = field(default_factory=list)
    basis: list[int] = field(default_factory=list)  # by row: a column, or -1 - row where the row is left unmet
    inverse: list[list[float]] = field(default_factory=list)
    values: list[float] = field(default_factory=list)  # by row, of its basic column

    def __post_init__(self) -> None:
        rows = len(self.right)
        self.basis = [-1 - row for row in range(rows)]
        self.inverse = [[float(row == column) for column in range(rows)] for row in range(rows)]
        self.values = list(self.right)

    def add(self, cost: float, entries: Entries) -> int:
        """One column more; its number."""
        self.costs.append(cost)
        self.entries.append(entries)
        return len(self.costs) - 1

    def _cost(self, column: int) -> float:
        return self.costs[column] if column >= 0 else self.penalties[-1 - column]

    def duals(self) -> list[float]:
        """By row: what one unit more of its right-hand side would cost."""
        found = [0.0] * len(self.right)
        for row, column in enumerate(self.basis):
            cost = self._cost(column)
            if cost:
                found = [one + cost * other for one, other in zip(found, self.inverse[row], strict=True)]
        return found

    def solve(self, limit: int = 20_000) -> float:
        """Pivot until no column gains, and give the value; a limit of pivots ends it earlier."""
        stalled = 0
        for _ in range(limit):
            duals = self.duals()
            entering = self._entering(duals, first=stalled > _SWITCH)
            if entering is None:
                break
            gained = self._pivot(entering)
            stalled = 0 if gained else stalled + 1
        return sum(self._cost(column) * value for column, value in zip(self.basis, self.values, strict=True))

    def _entering(self, duals: Sequence[float], *, first: bool) -> int | None:
        best, chosen = -1e-7, None
        for column, (cost, entries) in enumerate(zip(self.costs, self.entries, strict=True)):
            reduced = cost
            for row, coefficient in entries:
                reduced -= duals[row] * coefficient
            if reduced < best:
                best, chosen = reduced, column
                if first:
                    break
        return chosen

    def _pivot(self, column: int) -> bool:
        """Bring the column in; whether the value fell."""
        entries = self.entries[column]
        direction = [sum(line[row] * coefficient for row, coefficient in entries) for line in self.inverse]
        leaving, step = -1, float("inf")
        for row, steep in enumerate(direction):
            if steep > TOLERANCE:
                ratio = max(0.0, self.values[row]) / steep
                if ratio < step - 1e-12 or (ratio <= step + 1e-12 and steep > direction[leaving]):
                    leaving, step = row, min(step, ratio)
        assert leaving >= 0, "costs are bounded below, so something must leave"
        pivot = direction[leaving]
        line = [one / pivot for one in self.inverse[leaving]]
        self.inverse[leaving] = line
        for row, steep in enumerate(direction):
            if row != leaving and abs(steep) > 1e-12:
                self.inverse[row] = [one - steep * other for one, other in zip(self.inverse[row], line, strict=True)]
                self.values[row] -= steep * step
        self.values[leaving] = step
        self.basis[leaving] = column
        return step > TOLERANCE

    def solution(self) -> dict[int, float]:
        """The columns that are used, with how much."""
        return {
            column: value for column, value in zip(self.basis, self.values, strict=True) if column >= 0 and value > 1e-7
        }

    def unmet(self) -> float:
        """How much of all rows is left unmet."""
        return sum(value for column, value in zip(self.basis, self.values, strict=True) if column < 0)
