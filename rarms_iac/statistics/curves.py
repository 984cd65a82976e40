"""The curve of a performance index over the reservation: the one place where a value is looked up.

Its line is the measured settings made monotone (isotonic regression weighted by samples), straight between them, with
nothing outside. Its bounds are what more CPU cannot make worse: above (where smaller is better) the least bound of any
setting at or left of the place, below the highest of any at or right of it. Jitter and a minimum may be worse with more
CPU: they have bounds only where they were measured.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import accumulate
from math import ceil, floor, inf, isfinite

from rarms_iac.model.indexes import index_named
from rarms_iac.model.outcomes import Estimate, NoEstimate
from rarms_iac.model.output import OpenBound
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.run import Run
from rarms_iac.model.series import Series
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import AtLeast, AtMost, Threshold
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
    estimates: tuple[Estimate, ...]  # as measured; one a point
    inconclusive: tuple[int, ...] = ()  # reserves that were measured and gave no estimate
    overloaded: tuple[int, ...] = ()  # reserves at which it grows without an end: every threshold is missed there

    def value_at(self, reserve: float) -> Point | None:
        """Look the curve up.

        Args:
            reserve: CR, 1..100 per cent of the partition's own VPs.

        Returns:
            The point; None outside of what was measured.
        """
        known = next((point for point in self.points if point.reserve == reserve), None)
        pairs = zip(self.points, self.points[1:], strict=False)
        around = next((pair for pair in pairs if pair[0].reserve < reserve < pair[1].reserve), None)
        return known if around is None else _between(*around, reserve, self.index)

    def estimate_at(self, reserve: float) -> Estimate | None:
        """Return the measured value at this reservation, before it was made monotone.

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


def curve_of(settings: Iterable[Setting], component: str, index: str, run: Run) -> Curve:
    """Draw the curve of a component's index.

    Args:
        settings: In any order, at most one a reservation (`join_settings`); those without the component, or without an
            estimate of it, give no point, nor do those of the first pass.
        index: A name of `model/indexes`.
        run: The component's; says the deadline.

    Returns:
        The curve; the truth is beyond its band at a measured point with `LOOK_ERROR` on each side. Its points are by
        ascending reserve, made monotone for indexes that cannot get worse with more CPU;
        without points where no setting gave an estimate.
    """
    found = {
        setting.reserve: _estimate(series, index, run)
        for setting in settings
        for series in setting.series
        if series.component == component and not setting.first_pass
    }
    measured = {reserve: each for reserve, each in sorted(found.items()) if isinstance(each, Estimate)}
    overloaded = {reserve for reserve, each in found.items() if isinstance(each, NoEstimate) and each.overload}
    reserves, estimates = list(measured), tuple(measured.values())
    return Curve(
        component=component,
        index=index,
        points=_monotone(reserves, estimates, index),
        estimates=estimates,
        inconclusive=tuple(sorted(found.keys() - measured.keys() - overloaded)),
        overloaded=tuple(sorted(overloaded)),
    )


def least_reserve(apts: Iterable[tuple[Curve, Threshold]]) -> ReservePercent | None:
    """Find the least whole per cent at which all curves meet their thresholds on the safe side of the band.

    Args:
        apts: A pair for every index of every member's APT; none gives None.

    Returns:
        A CR that was measured, since bounds change nowhere else; None where no reservation meets all thresholds.
    """
    pairs = list(apts)
    reserves = sorted({int(point.reserve) for curve, _ in pairs for point in curve.points})
    return next((each for each in reserves if all(holds(curve, threshold, each) for curve, threshold in pairs)), None)


def curves_of(
    settings: Sequence[Setting], runs: Mapping[str, Run], apts: Mapping[str, Mapping[str, Threshold]]
) -> tuple[tuple[Curve, Threshold], ...]:
    """Draw the curve of every index that an APT names, component by component, as `least_reserve` takes them.

    Args:
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


def holds(curve: Curve, threshold: Threshold, reserve: ReservePercent) -> bool:
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


def components_not_shown(apts: Iterable[tuple[Curve, Threshold]], reserve: ReservePercent) -> tuple[str, ...]:
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
    """Return the curve as it was measured, not made monotone."""
    points = (
        Point(reserve=point.reserve, value=estimate.value, lower=estimate.lower, upper=estimate.upper)
        for point, estimate in zip(curve.points, curve.estimates, strict=True)
    )
    return replace(curve, points=tuple(points))


STEPS_OF_ONE = 1000
"""Thresholds are offered with three digits, and with thousandths below 1, as a person would write them."""


def tightest_threshold(curve: Curve, reserve: ReservePercent) -> Threshold | None:
    """Find the tightest threshold of three digits that the safe side of the curve's band meets.

    Args:
        curve: a performance index over CRs.
        reserve: the CR, in whole per cent.

    Returns:
        The threshold in the index's unit; None: the curve says nothing at this CR.
    """
    safe = curve.safe_value_at(reserve)
    return None if safe is None else threshold_met_by(curve.index, safe)


def threshold_met_by(index: str, value: float) -> Threshold | None:
    """Find the tightest threshold of three digits that a value meets.

    Args:
        value: of it, in its unit; the safe side of a bound.

    Returns:
        None: it is not a number.
    """
    if not isfinite(value):
        return None
    step = Fraction(1, STEPS_OF_ONE)
    while abs(value) >= STEPS_OF_ONE * step:
        step *= 10
    if index_named(index).smaller_is_better:
        return AtMost(value=step * ceil(Fraction(value) / step))
    return AtLeast(value=step * floor(Fraction(value) / step))


def highest_missed(apts: Iterable[tuple[Curve, Threshold]]) -> int:
    """Find the highest measured CR at which a threshold is missed for sure: on the good side of the band, too.

    Args:
        apts: each threshold with the curve of its index.

    Returns:
        Per cent; 0: nowhere. Between it and the least reserve that holds lies the noise.
    """
    pairs = list(apts)
    missed = (point.reserve for curve, threshold in pairs for point in curve.points if _misses(point, curve, threshold))
    overloaded = (reserve for curve, _ in pairs for reserve in curve.overloaded)
    return int(max((*missed, *overloaded), default=0))


def _misses(point: Point, curve: Curve, threshold: Threshold) -> bool:
    good = point.lower if index_named(curve.index).smaller_is_better else point.upper
    match threshold:
        case AtMost(value=limit):
            return good > float(limit)
        case AtLeast(value=limit):
            return good < float(limit)


def _estimate(series: Series, index: str, run: Run) -> Estimate | NoEstimate:
    estimate = estimate_of_setting(index, series, run)
    if isinstance(estimate, Estimate) and estimate.beyond is not None:
        # An extreme has no bound of its own: the curve shows what was seen.
        return replace(estimate, lower=estimate.value, upper=estimate.value)
    return estimate


def _monotone(reserves: Sequence[int], estimates: Sequence[Estimate], index: str) -> tuple[Point, ...]:
    values, lowers, uppers = (
        [getattr(estimate, side) for estimate in estimates] for side in ("value", "lower", "upper")
    )
    if index in _MAY_BE_WORSE_WITH_MORE:
        pass
    elif index == _MAXIMUM:
        values = lowers = uppers = not_below_later(values)
    else:
        weights = [estimate.effective_samples for estimate in estimates]
        if index_named(index).smaller_is_better:
            lowers, uppers = _bounds_of_falling(lowers, uppers)
            line = falling(values, weights)
        else:
            mirrored = _bounds_of_falling([-upper for upper in uppers], [-lower for lower in lowers])
            uppers, lowers = ([-bound for bound in side] for side in mirrored)
            line = rising(values, weights)
        values = [min(max(value, low), max(low, high)) for value, low, high in zip(line, lowers, uppers, strict=True)]
    return tuple(
        Point(reserve=float(reserve), value=value, lower=lower, upper=upper)
        for reserve, value, lower, upper in zip(reserves, values, lowers, uppers, strict=True)
    )


_MAXIMUM = "maximum_response_time"
_MAY_BE_WORSE_WITH_MORE = frozenset({"jitter", "minimum_response_time"})


def _bounds_of_falling(lowers: Sequence[float], uppers: Sequence[float]) -> tuple[list[float], list[float]]:
    """Bound a curve that cannot rise. An upper bound below a lower one further right bounds nothing."""
    highest = list(accumulate(reversed(lowers), max))[::-1]
    valid = [upper if upper >= later else inf for upper, later in zip(uppers, highest, strict=True)]
    return highest, list(accumulate(valid, min))


def _between(below: Point, above: Point, reserve: float, index: str) -> Point:
    """Interpolate; the bounds are those that hold right of the one and left of the other point."""
    part = (reserve - below.reserve) / (above.reserve - below.reserve)
    value = (1.0 - part) * below.value + part * above.value
    if index in _MAY_BE_WORSE_WITH_MORE:
        return Point(reserve=reserve, value=value, lower=-inf, upper=inf)
    lower, upper = (above.lower, below.upper) if index_named(index).smaller_is_better else (below.lower, above.upper)
    return Point(reserve=reserve, value=value, lower=lower, upper=upper)


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


def _pooled(later: tuple[float, float, int], earlier: tuple[float, float, int]) -> tuple[float, float, int]:
    weight = later[1] + earlier[1]
    return (later[0] * later[1] + earlier[0] * earlier[1]) / weight, weight, later[2] + earlier[2]
