"""How probable each reservation is as the least that meets the APT, after the settings measured so far.

A handful of shapes, each drawn many times through the measured setting nearest to the target, weighed by how well
they foretell the other settings (their evidence), and bent to pass through those; beside them curves of no shape, and
a small uniform part, so that nothing is ruled out by a guess.
"""

from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import ceil, exp, inf, log
from statistics import NormalDist

from rarms_iac.measuring.search.observations import Question, SettingObservation

# Shapes that the level of a response may have over the reservation, each through one measured point. A shape takes that
# point and the work alone (level times CR that the consumed CPU time has), and gives curves with weights. They are
# guesses: the posterior weighs them by the other settings.

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


UNIFORM = 0.01
"""The part of the probability that rests on no model."""

SHAPELESS = 0.1
"""The prior of a curve that follows nothing: any reservation in the bracket is as probable as the next."""

BULGE = 0.7
"""How unevenly a curve of no shape may fall between two settings: one standard deviation of the power's logarithm."""

UNLIKELY = 0.1
"""A component whose shape alone leaves it open is taken as achievable with this much doubt: people know their APTs."""

_HOPELESS = 0.3  # density of a level's logarithm of which nothing is foretold: anything within a factor of 20

_SERVED_EARLY = 0.9  # a job that meets a fresh quota is served sooner than its share says

_TOP = 101  # stands for: no setting meets it


@dataclass(frozen=True, slots=True, kw_only=True)
class _FamilyKind:
    """A family with its prior, how many curves are drawn for each guess, and how far off a good guess may be."""

    family: Family
    prior: float
    draws: int
    off: float  # one standard deviation, of the logarithm, however near the points
    astray: float  # more of it, for each unit of the logarithm of the CR between points; 0: it has a shape


KINDS = (
    _FamilyKind(family=hyperbola, prior=0.3, draws=40, off=0.004, astray=0.0),
    _FamilyKind(family=floor, prior=0.2, draws=40, off=0.004, astray=0.0),
    _FamilyKind(family=staircase, prior=0.2, draws=2, off=0.004, astray=0.0),
    _FamilyKind(family=cliff, prior=0.1, draws=2, off=0.004, astray=0.0),
    _FamilyKind(family=free, prior=0.2, draws=8, off=0.01, astray=0.15),
)


def chances(question: Question, failed: int, passed: int, processors: int) -> list[float]:
    """The probability of each CR 0..101 as the least that meets the APT; it lies above `failed`, not above `passed`."""
    found = [0.0] * (_TOP + 1)
    for curve in _curves(question, processors):
        _spread_over(found, curve, question, failed, passed)
    if passed == _TOP:
        found[_TOP] *= UNLIKELY
    shapeless = SHAPELESS * _HOPELESS ** (len(question.observations) - 1) / (passed - failed)
    least = max(failed + 1, min(passed, _least_served(question, processors)))
    found = [weight + shapeless if least <= reserve <= passed else 0.0 for reserve, weight in enumerate(found)]
    return mixed(found, failed, passed)


def _least_served(question: Question, processors: int) -> int:
    """Below this CR the work alone takes longer than the APT allows, on as many processors as there are."""
    known = [_work(point, processors) for point in question.observations if point.served is not None]
    if not known or question.highest == inf:
        return 1
    return int(_SERVED_EARLY * min(known) / exp(question.highest))


def mixed(found: Sequence[float], failed: int, passed: int) -> list[float]:
    """Made to sum to one, with the uniform part."""
    total = sum(found[failed + 1 : passed + 1])
    uniform = 1.0 / (passed - failed)
    part = UNIFORM if total > 0.0 else 1.0
    inside = [(1.0 - part) * weight / (total or 1.0) + part * uniform for weight in found[failed + 1 : passed + 1]]
    return [0.0] * (failed + 1) + inside + [0.0] * (_TOP - passed)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Curve:
    weight: float
    level: Callable[[float], float]  # logarithm
    shift: float  # of the target, in deviations of its vagueness


def _curves(question: Question, processors: int) -> Iterator[_Curve]:
    """All draws of all families, each with its weight."""
    points = sorted(question.observations, key=lambda observation: observation.reserve)
    middle = _target(question)
    anchor = min(points, key=lambda point: abs(point.level - middle) if middle is not None else 0.0)
    for kind in KINDS:
        yield from _of_kind(kind, points, anchor, middle, processors)


def _target(question: Question) -> float | None:
    ends = [end for end in (question.lowest, question.highest) if abs(end) < inf]
    return sum(ends) / len(ends) if ends else None


def _of_kind(
    kind: _FamilyKind,
    points: Sequence[SettingObservation],
    anchor: SettingObservation,
    middle: float | None,
    processors: int,
) -> Iterator[_Curve]:
    number = 0
    for parallel, likely in _parallel(points, processors):
        for guess in kind.family(_through(points, anchor, middle, parallel)):
            base = _logarithm(guess)
            fit = _fit(kind, guess, base, points, anchor)
            if fit < 1e-9:
                continue
            for _ in range(kind.draws):
                number += 1
                normals = _normals(number)
                yield _Curve(
                    weight=kind.prior * likely * guess.weight * fit / kind.draws,
                    level=_bent(kind, base, [point for point in points if point.reserve >= guess.edge], normals),
                    shift=normals[-1],
                )


def _parallel(points: Sequence[SettingObservation], processors: int) -> list[tuple[int, float]]:
    """On how many processors at once the component may work, with their probabilities: fewer are likelier.

    No more work than a CR serves can be done in a response: what was consumed rules the too few out.
    """
    known = [point for point in points if point.served is not None]
    counts = [
        count
        for count in range(1, processors + 1)
        if all(_work(point, count) <= (1.0 + CERTAIN) * exp(point.level) * point.reserve for point in known)
    ] or [processors]
    counts = counts if known else [1]
    whole = sum(1.0 / count for count in counts)
    return [(count, 1.0 / count / whole) for count in counts]


def _through(
    points: Sequence[SettingObservation], anchor: SettingObservation, middle: float | None, parallel: int
) -> Through:
    good = next((point for point in points if middle is not None and point.level <= middle), None)
    return Through(
        reserve=anchor.reserve,
        level=exp(anchor.level),
        work=_work(anchor, parallel),
        wanted=exp(anchor.level - 0.7 if middle is None else middle),
        good=None if good is None else (good.reserve, exp(good.level), _work(good, parallel)),
    )


def _work(point: SettingObservation, parallel: int) -> float:
    return exp(point.level if point.served is None else point.served) / parallel


def _logarithm(guess: Guess) -> Callable[[float], float]:
    return lambda reserve: inf if reserve < guess.edge else log(max(guess.level(reserve), 1e-12))


def _fit(
    kind: _FamilyKind,
    guess: Guess,
    base: Callable[[float], float],
    points: Sequence[SettingObservation],
    anchor: SettingObservation,
) -> float:
    """How well the guess foretells the other settings: the product of their densities."""
    exponent, scale = 0.0, 1.0
    anchor = next((point for point in points if point.reserve >= guess.edge), anchor) if guess.edge else anchor
    offset = 0.0 if anchor.reserve < guess.edge else anchor.level - base(anchor.reserve)
    for point in points:
        if point is anchor:
            continue
        if point.reserve < guess.edge:
            scale *= _HOPELESS
            continue
        far = abs(log(point.reserve / anchor.reserve))
        variance = point.error**2 + anchor.error**2 + kind.off**2 + (kind.astray * far) ** 2
        exponent += (point.level - base(point.reserve) - offset) ** 2 / (2 * variance)
        scale *= variance**-0.5
    return scale * exp(-min(exponent, 700.0))


def _bent(
    kind: _FamilyKind, base: Callable[[float], float], points: Sequence[SettingObservation], normals: Sequence[float]
) -> Callable[[float], float]:
    """The guess with its misses at the measured settings taken away, straight between them on the CR's logarithm.

    Each measured level is moved by a draw of its own error. A curve of no shape falls between two measured settings
    by a power of the way between them, so that it may do most of its fall near either.
    """
    places = [log(point.reserve) for point in points]
    levels = [point.level + normals[number] * point.error for number, point in enumerate(points)]
    misses = [level - base(point.reserve) for point, level in zip(points, levels, strict=True)]
    power = exp(BULGE * normals[-2])

    def level(reserve: float) -> float:
        foretold = base(reserve)
        if not places or foretold == inf:
            return foretold
        place = log(reserve)
        at = bisect_left(places, place)
        if at == 0 or at == len(places):
            near = 0 if at == 0 else -1
            return foretold + misses[near] + normals[-2] * kind.astray * abs(place - places[near])
        left, right = places[at - 1], places[at]
        part = (place - left) / (right - left)
        if kind.astray:
            upper, lower = levels[at - 1], levels[at]
            return upper + (lower - upper) * float(part**power)
        return foretold + (1.0 - part) * misses[at - 1] + part * misses[at]

    return level


def _spread_over(found: list[float], curve: _Curve, question: Question, failed: int, passed: int) -> None:
    """Adds the curve's weight where it falls to the target; where that is not known, evenly over what it may be."""
    moved = curve.shift * question.vague
    if question.lowest == question.highest:
        found[_first(curve.level, question.lowest + moved, failed, passed)] += curve.weight
        return
    right = passed if question.lowest == -inf else _first(curve.level, question.lowest + moved, failed, passed)
    left = failed + 1 if question.highest == inf else _first(curve.level, question.highest + moved, failed, passed)
    for reserve in range(left, max(left, right) + 1):
        found[reserve] += curve.weight / (passed - failed)


def _first(level: Callable[[float], float], target: float, failed: int, passed: int) -> int:
    """The least CR in the bracket whose level is at most the target; the bracket's upper end if none is."""
    low, high = failed + 1, passed
    while low < high:
        middle = (low + high) // 2
        if level(middle) <= target:
            high = middle
        else:
            low = middle + 1
    return low


@lru_cache(maxsize=8192)
def _normals(number: int) -> tuple[float, ...]:
    """Standard normal numbers, the same for the same number: no chance, so that a search can be replayed.

    Golden-ratio sequences of several irrationals lie more evenly than chance would.
    """
    normal = NormalDist()
    return tuple(normal.inv_cdf((0.5 + (number + 1) * root) % 1.0 or 0.5) for root in _ROOTS)


_ROOTS = tuple((prime**0.5) % 1.0 for prime in (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53))
