"""Isotonic regression: the monotone values nearest to measured ones."""

from collections.abc import Sequence
from itertools import accumulate


def falling(numbers: Sequence[float], weights: Sequence[float]) -> list[float]:
    """The numbers made non-increasing with the least weighted squares, by pooling neighbours that rise."""
    pools: list[tuple[float, float, int]] = []  # mean, weight, how many
    for number, weight in zip(numbers, weights, strict=True):
        pools.append((number, weight, 1))
        while len(pools) > 1 and pools[-2][0] < pools[-1][0]:
            pools.append(_pooled(pools.pop(), pools.pop()))
    return [mean for mean, _, many in pools for _ in range(many)]


def rising(numbers: Sequence[float], weights: Sequence[float]) -> list[float]:
    """The same, non-decreasing."""
    return [-number for number in falling([-number for number in numbers], weights)]


def not_below_later(numbers: Sequence[float]) -> list[float]:
    """Non-increasing and at least each number: what was seen at one place may happen at every place before it."""
    return list(accumulate(reversed(numbers), max))[::-1]


def not_above_earlier(numbers: Sequence[float]) -> list[float]:
    """Non-increasing and at most each number: what was seen at one place may happen at every place after it."""
    return list(accumulate(numbers, min))


def _pooled(one: tuple[float, float, int], other: tuple[float, float, int]) -> tuple[float, float, int]:
    weight = one[1] + other[1]
    return (one[0] * one[1] + other[0] * other[1]) / weight, weight, one[2] + other[2]
