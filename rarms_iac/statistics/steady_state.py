"""Warm-up and steady state, found by change points."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import sqrt

FEWEST = 40
"""A shorter series shows no change that could be told from its noise: it is taken as steady."""

_BLOCKS = 40
_SHORTEST_BLOCK = 5
_MOST_WARM_UP = 0.25  # a warm-up that takes more of the series leaves no steady state


@dataclass(frozen=True, slots=True, kw_only=True)
class Steady:
    """From this sample on (counted from 0) the series keeps its level; what is before is warm-up."""

    first: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Unsteady:
    """The series has no steady state."""

    why: str


def steady_part(numbers: Sequence[float]) -> Steady | Unsteady:
    """Where the numbers, response times in ms in order, begin to be steady."""
    first = 0
    while True:
        rest = numbers[first:]
        if len(rest) < FEWEST:
            return Steady(first=first)
        change = _change(rest)
        if change is None:
            return Steady(first=first)
        first += change.at
        if first > _MOST_WARM_UP * len(numbers):
            return Unsteady(why=change.says(len(numbers)))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Change:
    at: int
    before: float
    after: float

    def says(self, count: int) -> str:
        levels = f"from {self.before:.4g} ms to {self.after:.4g} ms"
        return f"its response times still changed within {count} samples, {levels}"


def _change(numbers: Sequence[float]) -> _Change | None:
    """The clearest change of level, None if chance explains it."""
    length = max(_SHORTEST_BLOCK, len(numbers) // _BLOCKS)
    means = [sum(numbers[start : start + length]) / length for start in range(0, len(numbers) - length + 1, length)]
    noise = _noise(means)
    if noise == 0.0 and means.count(means[0]) == len(means):
        return None
    best, where = 0.0, 0
    total, left = sum(means), 0.0
    for count in range(1, len(means)):
        left += means[count - 1]
        difference = abs(left / count - (total - left) / (len(means) - count))
        clear = difference / sqrt(1.0 / count + 1.0 / (len(means) - count))
        if clear > best:
            best, where = clear, count
    if best <= _limit(len(means)) * noise:
        return None
    left = sum(means[:where])
    return _Change(at=where * length, before=left / where, after=(total - left) / (len(means) - where))


def _noise(means: Sequence[float]) -> float:
    """The standard deviation of a block's mean, from neighbours only: a drift hardly moves it (von Neumann)."""
    squares = sum((later - sooner) ** 2 for sooner, later in pairwise(means))
    return sqrt(squares / (2 * (len(means) - 1)))


def _limit(blocks: int) -> float:
    """How clear the clearest change of so many blocks is by chance in one steady series of seventy (simulated)."""
    return 3.45 + 5.0 / blocks
