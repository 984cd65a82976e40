"""A small linear program that grows by columns: minimise cost, every row met with equality.

Floating point, and never believed: what its duals say is made whole numbers and bounded exactly (`columns.py`).
The basis is kept as its inverse, by columns, which suits some dozens of rows and thousands of sparse columns.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from operator import mul

TOLERANCE = 1e-9
_STUCK = 15
"""Steps without gain after which right-hand sides become slightly unequal."""

_SWITCH = 60
"""Steps without gain after which the first eligible column enters instead of the best: that cannot cycle."""

_CANDIDATES = 12
"""Columns of one look at all of them that are tried before the next."""

_GAINS = -1e-7

_NUDGE = 1e-7

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
    inverse: list[list[float]] = field(default_factory=list)  # of the basis, by column
    values: list[float] = field(default_factory=list)  # by row, of its basic column
    prices: list[float] = field(default_factory=list)  # the duals, kept while pivoting

    def __post_init__(self) -> None:
        rows = len(self.right)
        self.basis = [-1 - row for row in range(rows)]
        self.inverse = [[float(row == column) for row in range(rows)] for column in range(rows)]
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
        costs = list(map(self._cost, self.basis))
        return [sum(map(mul, costs, line)) for line in self.inverse]

    def solve(self, limit: int = 20_000) -> float:
        """Pivot until no column gains, and give the value; a limit of pivots ends it earlier."""
        stalled = 0
        self.prices = self.duals()
        candidates: list[int] = []
        for _ in range(limit):
            entering = None if stalled > _SWITCH else self._best(candidates)
            if entering is None:
                self.prices = self.duals()  # what was added up on the way is not trusted for long
                candidates = self._gaining(first=stalled > _SWITCH)
                entering = self._best(candidates)
            if entering is None:
                break
            stalled = 0 if self._pivot(entering) else stalled + 1
            if stalled == _STUCK:
                self._nudge()
        return float(sum(map(mul, map(self._cost, self.basis), self.values)))

    def _nudge(self) -> None:
        """Make right-hand sides slightly unequal, so that steps gain again; duals do not suffer from it."""
        self.values = [value + _NUDGE * (1 + row * 7 % 11) for row, value in enumerate(self.values)]

    def _reduced(self, column: int) -> float:
        reduced = self.costs[column]
        for row, coefficient in self.entries[column]:
            reduced -= self.prices[row] * coefficient
        return reduced

    def _best(self, candidates: Sequence[int]) -> int | None:
        """The candidate that gains most, None where none does."""
        gain, column = min(((self._reduced(one), one) for one in candidates), default=(0.0, 0))
        return column if gain < _GAINS else None

    def _gaining(self, *, first: bool) -> list[int]:
        """The columns that gain most, or only the first that gains."""
        prices, found = self.prices, []
        for column, (cost, entries) in enumerate(zip(self.costs, self.entries, strict=True)):
            reduced = cost
            for row, coefficient in entries:
                reduced -= prices[row] * coefficient
            if reduced < _GAINS:
                found.append((reduced, column))
                if first:
                    break
        return [column for _, column in sorted(found)[:_CANDIDATES]]

    def _pivot(self, column: int) -> bool:
        """Bring the column in; whether the value fell."""
        direction = self._direction(self.entries[column])
        leaving, step = self._leaving(direction)
        gain, pivot = self._reduced(column), direction[leaving]
        direction[leaving] = pivot - 1.0  # so that the row itself is divided by the pivot
        for number, line in enumerate(self.inverse):
            if line[leaving]:
                part = line[leaving] / pivot
                self.inverse[number] = [one - part * steep for one, steep in zip(line, direction, strict=True)]
                self.prices[number] += gain * part
        self.values = [one - step * steep for one, steep in zip(self.values, direction, strict=True)]
        self.values[leaving] = step
        self.basis[leaving] = column
        return step > TOLERANCE

    def _leaving(self, direction: Sequence[float]) -> tuple[int, float]:
        """The row whose column leaves, and how far the entering one goes."""
        leaving, step = -1, float("inf")
        for row, steep in enumerate(direction):
            if steep > TOLERANCE:
                ratio = max(0.0, self.values[row]) / steep
                if ratio < step - 1e-12 or (ratio <= step + 1e-12 and steep > direction[leaving]):
                    leaving, step = row, min(step, ratio)
        assert leaving >= 0, "costs are bounded below, so something must leave"
        return leaving, step

    def _direction(self, entries: Entries) -> list[float]:
        lines = [
            self.inverse[row] if coefficient == 1.0 else [coefficient * one for one in self.inverse[row]]
            for row, coefficient in entries
        ]
        return list(map(sum, zip(*lines, strict=True)))

    def solution(self) -> dict[int, float]:
        """The columns that are used, with how much."""
        return {
            column: value for column, value in zip(self.basis, self.values, strict=True) if column >= 0 and value > 1e-7
        }

    def unmet(self) -> float:
        """How much of all rows is left unmet."""
        return sum(value for column, value in zip(self.basis, self.values, strict=True) if column < 0)
