"""The curve of a performance index over the reservation: the one place where a value is looked up.

Measured settings made monotone (isotonic regression weighted by samples; of an extreme what was seen with more CPU
counts for less of it), straight between them, nothing outside.
The band is made monotone likewise; its safe side is the one away from what is good: above for response times.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import accumulate
from math import ceil, floor, inf, isfinite

from rarms_iac.model.indexes import index_named
from rarms_iac.model.measurement import Setting
from rarms_iac.model.outcomes import Estimate, NoEstimate
from rarms_iac.model.output import OpenBound
from rarms_iac.model.run import Run
from rarms_iac.model.series import Series
from rarms_iac.model.system import AtLeast, AtMost, Threshold
from rarms_iac.statistics.error_probability import LOOK_ERROR
from rarms_iac.statistics.overload import estimate_of_setting


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """The curve at one reservation; measured there, or looked up between two that were."""

    reserve: float  # CR, 1..100 per cent of the partition's own VPs
    value: float
    lower: OpenBound
    upper: OpenBound


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """One index of one component, from the settings of its data log; points in the order of their reserves."""

    component: str
    index: str
    points: tuple[Point, ...]
    estimates: tuple[Estimate, ...]  # as measured, before they were made monotone; one a point
    inconclusive: tuple[int, ...] = ()  # reserves that were measured and gave no estimate

    def value_at(self, reserve: float) -> Point | None:
        """Look the curve up.

        Between two measured reservations it is straight, where none between them was inconclusive; otherwise its safe
        side has no bound there.

        Args:
            reserve: CR, 1..100 per cent of the partition's own VPs.

        Returns:
            The point, with the safe side unbounded where a setting between its neighbours was inconclusive; None
                outside of what was measured.
        """
        for below, above in zip(self.points, self.points[1:], strict=False):
            if below.reserve <= reserve <= above.reserve:
                point = _between(below, above, reserve)
                at_an_end = reserve in (below.reserve, above.reserve)
                crosses = any(below.reserve < measured < above.reserve for measured in self.inconclusive)
                return _unbounded(point, self.index) if crosses and not at_an_end else point
        return next((point for point in self.points if point.reserve == reserve), None)

    def estimate_at(self, reserve: float) -> Estimate | None:
        """Return what was measured at this reservation, before it was made monotone.

        Args:
            reserve: as of `value_at`.

        Returns:
            None where nothing was measured, or without an estimate.
        """
        measured = zip(self.points, self.estimates, strict=True)
        return next((estimate for point, estimate in measured if point.reserve == reserve), None)

    def safe_value_at(self, reserve: float) -> float | None:
        """Look up the safe side of the band, which gives a reservation.

        Args:
            reserve: as of `value_at`.

        Returns:
            The upper bound where smaller is better, otherwise the lower one, in the index's unit; None outside of
                what was measured.
        """
        point = self.value_at(reserve)
        if point is None:
            return None
        return point.upper if index_named(self.index).smaller_is_better else point.lower


@dataclass(frozen=True, slots=True, kw_only=True)
class LeastReserve:
    """The least whole per cent at which every APT holds on the safe side of its band."""

    reserve: int
    interpolated: bool  # it was not itself measured


def curve_of(settings: Iterable[Setting], component: str, index: str, run: Run, *, error: float = LOOK_ERROR) -> Curve:
    """Draw the curve of a component's index.

    A setting without an estimate (no answer, no steady state) gives no point; several settings at one reservation are
    taken together, each by its samples.

    Args:
        settings: In any order; those without the component count for nothing.
        component: Its name.
        index: A name of `model/indexes`.
        run: The component's; says the deadline.
        error: The probability, 0..1, that the truth is beyond the band, on each side, at a look at a measured point.

    Returns:
        The curve, its points by ascending reserve, made monotone; without points where no setting gave an estimate.
    """
    measured: dict[int, list[Estimate]] = {}
    inconclusive: set[int] = set()
    for setting in settings:
        for series in setting.series:
            if series.component != component:
                continue
            estimate = _estimate(series, index, run, error)
            if isinstance(estimate, Estimate):
                measured.setdefault(setting.reserve, []).append(estimate)
            else:
                inconclusive.add(setting.reserve)
    reserves = sorted(measured)
    estimates = tuple(_combine(measured[reserve], index) for reserve in reserves)
    return Curve(
        component=component,
        index=index,
        points=_monotone(reserves, estimates, index),
        estimates=estimates,
        inconclusive=tuple(sorted(inconclusive - measured.keys())),
    )


def least_reserve(apts: Iterable[tuple[Curve, Threshold]]) -> LeastReserve | None:
    """Find the least whole per cent at which all curves meet their thresholds on the safe side of the band.

    Args:
        apts: A pair for every index of every member's APT; none gives None.

    Returns:
        None where no reservation within what was measured meets all thresholds.
    """
    pairs = list(apts)
    for reserve in range(1, 101):
        if pairs and all(holds(curve, threshold, reserve) for curve, threshold in pairs):
            measured = all(any(point.reserve == reserve for point in curve.points) for curve, _ in pairs)
            return LeastReserve(reserve=reserve, interpolated=not measured)
    return None


def curves_of(
    settings: Sequence[Setting], runs: Mapping[str, Run], apts: Mapping[str, Mapping[str, Threshold]]
) -> tuple[tuple[Curve, Threshold], ...]:
    """Draw the curve of every index that an APT names, component by component, as `least_reserve` takes them.

    Args:
        settings: Of all components.
        runs: By component; every one that has thresholds.
        apts: By component, then by index.

    Returns:
        A pair for each threshold, in the order of `apts`.
    """
    return tuple(
        (curve_of(settings, component, index, runs[component]), threshold)
        for component, apt in apts.items()
        for index, threshold in apt.items()
    )


def holds(curve: Curve, threshold: Threshold, reserve: int) -> bool:
    """Tell whether the safe side of the curve's band meets the threshold: the rule of every reservation.

    Args:
        curve: a performance index over CRs.
        threshold: in the unit of that index.
        reserve: the CR, in whole per cent.

    Returns:
        False also where the curve says nothing at this CR.
    """
    safe = curve.safe_value_at(reserve)
    if safe is None:
        return False
    match threshold:
        case AtMost(value=limit):
            return safe <= float(limit)
        case AtLeast(value=limit):
            return safe >= float(limit)


def components_not_shown(apts: Iterable[tuple[Curve, Threshold]], reserve: int) -> tuple[str, ...]:
    """Name the components that a measured CR does not show to meet all of their thresholds.

    Args:
        apts: each threshold with the curve of its index.
        reserve: the CR, in whole per cent.

    Returns:
        Names in order, none where all curves hold. Named is whose own band there misses, since the curve moves with
        any later measurement; where no band does, whose curve does not hold.
    """
    pairs = list(apts)
    on_the_curve = {curve.component for curve, threshold in pairs if not holds(curve, threshold, reserve)}
    alone = {curve.component for curve, threshold in pairs if not holds(_unpooled(curve), threshold, reserve)}
    return tuple(sorted(on_the_curve & alone or on_the_curve))


def _unpooled(curve: Curve) -> Curve:
    """The curve as it was measured, not made monotone."""
    points = (
        Point(reserve=point.reserve, value=estimate.value, lower=estimate.lower, upper=estimate.upper)
        for point, estimate in zip(curve.points, curve.estimates, strict=True)
    )
    return replace(curve, points=tuple(points))


DIGITS = 1000
"""Thresholds are offered with three digits, as a person would write them."""


def tightest_threshold(curve: Curve, reserve: int) -> Threshold | None:
    """Find the tightest threshold of three digits that the safe side of the curve's band meets.

    Args:
        curve: a performance index over CRs.
        reserve: the CR, in whole per cent.

    Returns:
        The threshold in the index's unit; None: the curve says nothing at this CR.
    """
    safe = curve.safe_value_at(reserve)
    if safe is None or not isfinite(safe):
        return None
    step = Fraction(1, DIGITS)
    while abs(safe) >= DIGITS * step:
        step *= 10
    if index_named(curve.index).smaller_is_better:
        return AtMost(value=step * ceil(Fraction(safe) / step))
    return AtLeast(value=step * floor(Fraction(safe) / step))


def highest_missed(apts: Iterable[tuple[Curve, Threshold]]) -> int:
    """Find the highest measured CR at which a threshold is missed for sure: on the good side of the band, too.

    Args:
        apts: each threshold with the curve of its index.

    Returns:
        Per cent; 0: nowhere. Between it and the least reserve that holds lies the noise.
    """
    missed = (point.reserve for curve, threshold in apts for point in curve.points if _misses(point, curve, threshold))
    return int(max(missed, default=0))


def _misses(point: Point, curve: Curve, threshold: Threshold) -> bool:
    good = point.lower if index_named(curve.index).smaller_is_better else point.upper
    match threshold:
        case AtMost(value=limit):
            return good > float(limit)
        case AtLeast(value=limit):
            return good < float(limit)


def _estimate(series: Series, index: str, run: Run, error: float) -> Estimate | NoEstimate:
    estimate = estimate_of_setting(index, series, run, error=error)
    if isinstance(estimate, Estimate) and estimate.beyond is not None:
        # An extreme has no bound of its own: the curve shows what was seen.
        return replace(estimate, lower=estimate.value, upper=estimate.value)
    return estimate


def _combine(estimates: Sequence[Estimate], index: str) -> Estimate:
    """Combine repeated settings: means weighted by samples; the band narrows as its samples grow."""
    if len(estimates) == 1:
        return estimates[0]
    if estimates[0].beyond is not None:  # of an extreme nothing is averaged: what was seen once was seen
        return (min if index == "minimum_response_time" else max)(estimates, key=lambda estimate: estimate.value)
    total = sum(estimate.effective_samples for estimate in estimates)
    weighted = [(estimate.effective_samples / total, estimate) for estimate in estimates]
    value = sum(part * estimate.value for part, estimate in weighted)
    below = sum((part * (estimate.value - estimate.lower)) ** 2 for part, estimate in weighted) ** 0.5
    above = sum((part * (estimate.upper - estimate.value)) ** 2 for part, estimate in weighted) ** 0.5
    return Estimate(
        value=value,
        lower=value - below,
        upper=value + above,
        samples=sum(estimate.samples for estimate in estimates),
        effective_samples=total,
    )


def _monotone(reserves: Sequence[int], estimates: Sequence[Estimate], index: str) -> tuple[Point, ...]:
    fit = _fit_of(index, [estimate.effective_samples for estimate in estimates])
    value = fit([estimate.value for estimate in estimates])
    lower = fit([estimate.lower for estimate in estimates])
    upper = fit([estimate.upper for estimate in estimates])
    return tuple(
        Point(reserve=float(reserve), value=value[at], lower=lower[at], upper=upper[at])
        for at, reserve in enumerate(reserves)
    )


def _unbounded(point: Point, index: str) -> Point:
    """With nothing known of the side that a reservation would rest on."""
    return replace(point, upper=inf) if index_named(index).smaller_is_better else replace(point, lower=-inf)


def _fit_of(index: str, weights: Sequence[float]) -> Callable[[Sequence[float]], list[float]]:
    """How an index is made monotone; of an extreme nothing is averaged: more CPU does not undo what was seen."""
    match index:
        case "maximum_response_time":
            return not_below_later
        case "minimum_response_time":
            return not_above_earlier
        case _:
            fit = falling if index_named(index).smaller_is_better else rising
            return lambda side: fit(side, weights)


def _between(below: Point, above: Point, reserve: float) -> Point:
    part = (reserve - below.reserve) / (above.reserve - below.reserve)
    return Point(
        reserve=reserve,
        value=_mix(below.value, above.value, part),
        lower=_mix(below.lower, above.lower, part),
        upper=_mix(below.upper, above.upper, part),
    )


def _mix(start: float, end: float, part: float) -> float:
    """Straight between; exact at the ends, also where the other end is infinite."""
    if part <= 0.0 or start == end:
        return start
    return end if part >= 1.0 else (1.0 - part) * start + part * end


def falling(numbers: Sequence[float], weights: Sequence[float]) -> list[float]:
    """Make the numbers non-increasing with the least weighted squares, by pooling neighbours that rise (isotonic).

    Args:
        numbers: in the order of their places.
        weights: above 0, one for each number.

    Returns:
        As many numbers, in the same order. The cost is linear.

    Raises:
        ValueError: there are not as many weights as numbers.
    """
    pools: list[tuple[float, float, int]] = []  # mean, weight, how many
    for number, weight in zip(numbers, weights, strict=True):
        pools.append((number, weight, 1))
        while len(pools) > 1 and pools[-2][0] < pools[-1][0]:
            pools.append(_pooled(pools.pop(), pools.pop()))
    return [mean for mean, _, many in pools for _ in range(many)]


def rising(numbers: Sequence[float], weights: Sequence[float]) -> list[float]:
    """Make the numbers non-decreasing with the least weighted squares, as `falling` makes them non-increasing.

    Args:
        numbers: in the order of their places.
        weights: above 0, one for each number.

    Returns:
        As many numbers, in the same order.

    Raises:
        ValueError: there are not as many weights as numbers.
    """
    return [-number for number in falling([-number for number in numbers], weights)]


def not_below_later(numbers: Sequence[float]) -> list[float]:
    """Make the numbers non-increasing, each at least as it was: what was seen may happen at every place before, too.

    Args:
        numbers: in the order of their places.

    Returns:
        At each place the largest number from there on.
    """
    return list(accumulate(reversed(numbers), max))[::-1]


def not_above_earlier(numbers: Sequence[float]) -> list[float]:
    """Make the numbers non-increasing, each at most as it was: what was seen may happen at every place after, too.

    Args:
        numbers: in the order of their places.

    Returns:
        At each place the smallest number up to there.
    """
    return list(accumulate(numbers, min))


def _pooled(later: tuple[float, float, int], earlier: tuple[float, float, int]) -> tuple[float, float, int]:
    weight = later[1] + earlier[1]
    return (later[0] * later[1] + earlier[0] * earlier[1]) / weight, weight, later[2] + earlier[2]
