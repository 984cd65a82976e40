"""The linear program of `simplex.py` for some hundreds of rows: the inverse of the basis is kept as a product.

Each factor differs from the identity in one column, and most of that is empty. The product is made anew now and then,
rows that one column alone has first, so that it stays short.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from rarms_iac.planner.packing.linear.simplex import TOLERANCE, Entries, Master

_AGAIN = 40
"""Factors that are added before the product is made anew."""

_SMALL = 1e-11

_STABLE = 0.05
"""A pivot is no smaller than this part of the largest in its column."""


@dataclass(frozen=True, slots=True)
class _Factor:
    row: int
    pivot: float
    others: list[tuple[int, float]]  # row and value, without the pivot


@dataclass(slots=True)
class Factored(Master):
    """The program, kept optimal between calls of `solve`."""

    factors: list[_Factor] = field(default_factory=list)
    added: int = 0  # since the product was made
    pivots: int = 0  # in all

    def __post_init__(self) -> None:
        """Every row is left unmet at first."""
        self.basis = [-1 - row for row in range(len(self.right))]
        self.values = list(self.right)

    def duals(self) -> list[float]:
        """By row: what one unit more of its right-hand side would cost."""
        return self._backward([self._cost(column) for column in self.basis])

    def _direction(self, entries: Entries) -> list[float]:
        return self._forward(entries, self.factors)

    def _forward(self, entries: Entries, factors: Sequence[_Factor]) -> list[float]:
        found = [0.0] * len(self.right)
        for row, coefficient in entries:
            found[row] += coefficient
        for factor in factors:
            there = found[factor.row]
            if there:
                there /= factor.pivot
                found[factor.row] = there
                for row, value in factor.others:
                    found[row] -= value * there
        return found

    def _backward(self, found: list[float]) -> list[float]:
        for factor in reversed(self.factors):
            found[factor.row] = (
                found[factor.row] - sum([value * found[row] for row, value in factor.others])
            ) / factor.pivot
        return found

    def _pivot(self, column: int) -> bool:
        """Bring the column in; whether the value fell."""
        direction = self._direction(self.entries[column])
        leaving, step = self._leaving(direction)
        gain, pivot = self._reduced(column), direction[leaving]
        row = [0.0] * len(self.right)
        row[leaving] = 1.0
        part = gain / pivot
        self.prices = [
            price + part * one if one else price for price, one in zip(self.prices, self._backward(row), strict=True)
        ]
        others = [(row, value) for row, value in enumerate(direction) if abs(value) > _SMALL and row != leaving]
        for row_, value in others:
            self.values[row_] -= step * value
        self.values[leaving] = step
        self.basis[leaving] = column
        self.factors.append(_Factor(leaving, pivot, others))
        self.added += 1
        self.pivots += 1
        if self.added >= _AGAIN:
            self._anew()
        return step > TOLERANCE

    def solution(self) -> dict[int, float]:
        """The columns that are used, with how much, whatever right-hand sides were made unequal on the way."""
        self.values = self._forward(tuple(enumerate(self.right)), self.factors)
        return Master.solution(self)

    def _anew(self) -> None:
        """The product of the same basis; where a pivot would be too small it stays as it is for a while."""
        self.added = 0
        value_of = dict(zip(self.basis, self.values, strict=True))
        entries = {column: ((-1 - column, 1.0),) if column < 0 else self.entries[column] for column in self.basis}
        factors, basis = list[_Factor](), [0] * len(self.basis)
        free = set(range(len(self.basis)))
        columns_of: list[set[int]] = [set() for _ in self.basis]
        for column, some in entries.items():
            for row, _ in some:
                columns_of[row].add(column)
        for column, wanted in _ordered(entries, columns_of):
            found = self._forward(entries[column], factors)
            largest = max((abs(found[row]) for row in free), default=0.0)
            if largest < TOLERANCE:
                return
            chosen = wanted if wanted in free and abs(found[wanted]) >= _STABLE * largest else -1
            if chosen < 0:
                chosen = min(
                    (row for row in free if abs(found[row]) >= _STABLE * largest),
                    key=lambda row: (len(columns_of[row]), -abs(found[row]), row),
                )
            others = [(row, value) for row, value in enumerate(found) if abs(value) > _SMALL and row != chosen]
            if others or found[chosen] != 1.0:
                factors.append(_Factor(chosen, found[chosen], others))
            free.discard(chosen)
            basis[chosen] = column
        self.factors, self.basis = factors, basis
        self.values = [value_of[column] for column in basis]


def _ordered(entries: dict[int, Entries], columns_of: Sequence[set[int]]) -> list[tuple[int, int]]:
    """Columns with the row to pivot on: rows that one column alone has come first, as often as there are any."""
    left = [set(columns) for columns in columns_of]
    alone = sorted((row for row, columns in enumerate(left) if len(columns) == 1), reverse=True)
    found, taken = list[tuple[int, int]](), set[int]()
    while alone:
        row = alone.pop()
        if len(left[row]) != 1:
            continue
        column = next(iter(left[row]))
        found.append((column, row))
        taken.add(column)
        for other, _ in entries[column]:
            left[other].discard(column)
            if len(left[other]) == 1:
                alone.append(other)
    rest = sorted((column for column in entries if column not in taken), key=lambda one: (len(entries[one]), one))
    return [*found, *((column, -1) for column in rest)]
