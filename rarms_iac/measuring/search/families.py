"""Shapes that the level of a response may have over the reservation, each through one measured point.

A shape takes the point it must pass through and the work alone (level times CR that the consumed CPU time has), and
gives curves with weights. They are guesses: the posterior weighs them by the other settings.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import ceil

Level = Callable[[float], float]

CERTAIN = 0.03
"""A level this part above the work alone, or below it, counts as the work alone: the CPU time is known so well."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Through:
    """What a curve must pass through."""

    reserve: int
    level: float
    work: float  # the work alone has the level work / CR
    wanted: float  # the target
    good: tuple[int, float, float] | None  # the lowest setting that passed: its CR, level, and work alone


@dataclass(frozen=True, slots=True, kw_only=True)
class Guess:
    """A possible curve."""

    weight: float
    level: Level
    edge: float = 0.0  # below this CR nothing is foretold but that it fails


Family = Callable[[Through], Iterator[Guess]]


def hyperbola(point: Through) -> Iterator[Guess]:
    """Work that the CR stretches, and time that no CPU shortens: a + b / CR."""
    work, fixed = point.work, point.level - point.work / point.reserve
    if fixed >= -CERTAIN * point.level:
        yield Guess(weight=1.0, level=lambda reserve: max(fixed, 0.0) + work / reserve)


def floor(point: Through) -> Iterator[Guess]:
    """Work alone, down to a floor: max(a, b / CR)."""
    work, lowest = point.work, point.level
    if lowest >= (1.0 + CERTAIN) * work / point.reserve:
        yield Guess(weight=1.0, level=lambda reserve: max(lowest, work / reserve))
    elif lowest >= (1.0 - CERTAIN) * work / point.reserve:
        yield Guess(weight=1.0, level=lambda reserve: work / reserve)


PERIODS = tuple(0.5 * 1.03**number for number in range(203))
"""Quota periods in ms, 0.5 to 200."""


def staircase(point: Through) -> Iterator[Guess]:
    """A quota a period: the work waits for the next one whenever its quota is used up."""
    alone = point.work / 100
    for period in PERIODS:

        def level(reserve: float, period: float = period) -> float:
            quota = period * reserve / 100
            return alone + (ceil(alone / quota - 1e-9) - 1) * (period - quota)

        miss = abs(level(point.reserve) / point.level - 1.0)
        if miss < CERTAIN:
            yield Guess(weight=1.0 / len(PERIODS), level=level)


ROOMS = tuple(1.0 + 0.02 * number for number in range(75))
"""By how much the edge of a cliff may lie above what the work alone needs there."""

_LIKELY_ROOM = 1.5


def cliff(point: Through) -> Iterator[Guess]:
    """Good from some CR on, hopeless below it: the edge lies above what is consumed where it is good."""
    if point.good is None:
        for edge in range(point.reserve + 1, 101):
            yield Guess(weight=0.01, level=lambda _reserve: 0.5 * point.wanted, edge=edge)
        return
    reserve, level, work = point.good
    for room in ROOMS:
        if work / level * room <= reserve:
            yield Guess(weight=_likely(room), level=lambda _reserve: level, edge=work / level * room)


def _likely(room: float) -> float:
    """What must be served in time is two thirds busy or more at the edge, as a rule."""
    return 0.03 * min(1.0, (_LIKELY_ROOM / room) ** 6)


SLOPES = tuple(0.05 * 1.3**number for number in range(16))


def free(point: Through) -> Iterator[Guess]:
    """No shape: a slope on logarithmic scales, from nearly flat to steeper than the work alone."""
    for slope in SLOPES:

        def level(reserve: float, slope: float = slope) -> float:
            return float(point.level * (point.reserve / reserve) ** slope)

        yield Guess(weight=1.0 / len(SLOPES), level=level)
