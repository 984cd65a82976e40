"""The curve of a performance index over the reservation: the one place where a value is looked up (DESIGN section 2).

Measured settings made monotone (isotonic regression weighted by samples; of an extreme what was seen with more CPU
counts for less of it), straight between them, nothing outside.
The band is made monotone likewise; its safe side is the one away from what is good: above for response times.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from math import inf

from rarms_iac.model.indexes import find_index
from rarms_iac.model.measurement import Series, Setting
from rarms_iac.model.system import AtLeast, AtMost, Run, Threshold
from rarms_iac.statistics import samples as values
from rarms_iac.statistics.estimates import USUAL_ERROR, Estimate, NoEstimate, estimate
from rarms_iac.statistics.steady_state import Steady, steady_part
from rarms_iac.statistics.verdicts import part_for


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """The curve at one reservation; measured there, or looked up between two that were."""

    reserve: float  # CR, 1..100 per cent of the partition's own VPs
    value: float
    lower: float
    upper: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """One index of one component, from the settings of its data log; points in the order of their reserves."""

    component: str
    index: str
    error: float  # of the band, at each measured point
    points: tuple[Point, ...]
    estimates: tuple[Estimate, ...]  # as measured, before they were made monotone; one a point
    untold: tuple[int, ...] = ()  # reserves that were measured and gave no estimate

    def value_at(self, reserve: float) -> Point | None:
        """The curve there, None outside of what was measured.

        Across a reservation that was measured and gave no estimate, the line has no safe side: what was seen there is
        not what the line says.
        """
        for left, right in zip(self.points, self.points[1:], strict=False):
            if left.reserve <= reserve <= right.reserve:
                point = _between(left, right, reserve)
                at_an_end = reserve in (left.reserve, right.reserve)
                crosses = any(left.reserve < one < right.reserve for one in self.untold)
                return _unbounded(point, self.index) if crosses and not at_an_end else point
        lone = [point for point in self.points if point.reserve == reserve]
        return lone[0] if lone else None

    def safe_value_at(self, reserve: float) -> float | None:
        """The safe side of the band there: what a reservation rests on."""
        point = self.value_at(reserve)
        if point is None:
            return None
        return point.upper if _smaller_is_better(self.index) else point.lower


@dataclass(frozen=True, slots=True, kw_only=True)
class LeastReserve:
    """The least whole per cent at which every APT holds on the safe side of its band."""

    reserve: int
    interpolated: bool  # it was not itself measured


def curve_of(settings: Iterable[Setting], component: str, index: str, run: Run, *, error: float = USUAL_ERROR) -> Curve:
    """The curve of a component's index; a setting without an estimate (no answer, no steady state) gives no point.

    Several settings at one reservation are taken together, each by its samples.
    """
    measured: dict[int, list[Estimate]] = {}
    untold: set[int] = set()
    for setting in settings:
        for series in setting.series:
            if series.component != component:
                continue
            found = _steady_estimate(series, index, run, error)
            if isinstance(found, Estimate):
                measured.setdefault(setting.reserve, []).append(found)
            else:
                untold.add(setting.reserve)
    reserves = sorted(measured)
    estimates = tuple(_together(measured[reserve], index) for reserve in reserves)
    return Curve(
        component=component,
        index=index,
        error=error,
        points=_monotone(reserves, estimates, index),
        estimates=estimates,
        untold=tuple(sorted(untold - measured.keys())),
    )


def least_reserve(apts: Iterable[tuple[Curve, Threshold]]) -> LeastReserve | None:
    """The least whole per cent at which all these curves meet their thresholds; None: none that was measured does.

    Several members of a partition, and several indexes of one APT, are so many pairs.
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
    """The curve of every index that an APT names, component by component: what `least_reserve` asks for."""
    return tuple(
        (curve_of(settings, component, index, runs[component]), threshold)
        for component, apt in apts.items()
        for index, threshold in apt.items()
    )


def holds(curve: Curve, threshold: Threshold, reserve: int) -> bool:
    """Whether the safe side of the band meets the threshold there: the rule that every reservation rests on."""
    safe = curve.safe_value_at(reserve)
    if safe is None:
        return False
    match threshold:
        case AtMost(value=limit):
            return safe <= float(limit)
        case AtLeast(value=limit):
            return safe >= float(limit)


def highest_missed(apts: Iterable[tuple[Curve, Threshold]]) -> int:
    """The highest measured CR at which one of these thresholds is missed for sure, on the good side of the band, too.

    0: nowhere. Above it and below what holds is the noise.
    """
    missed = (point.reserve for curve, threshold in apts for point in curve.points if _misses(point, curve, threshold))
    return int(max(missed, default=0))


def _misses(point: Point, curve: Curve, threshold: Threshold) -> bool:
    good = point.lower if _smaller_is_better(curve.index) else point.upper
    match threshold:
        case AtMost(value=limit):
            return good > float(limit)
        case AtLeast(value=limit):
            return good < float(limit)


def _steady_estimate(series: Series, index: str, run: Run, error: float) -> Estimate | NoEstimate:
    begin = steady_part(values.response_times(series.samples))
    if not isinstance(begin, Steady):
        return NoEstimate(why=begin.why)
    found = estimate(index, part_for(index, series, begin.first), run, error=error)
    if isinstance(found, Estimate) and found.beyond is not None:
        # An extreme has no bound of its own: the curve shows what was seen.
        return Estimate(
            value=found.value,
            lower=found.value,
            upper=found.value,
            error=error,
            samples=found.samples,
            effective_samples=found.effective_samples,
            beyond=found.beyond,
        )
    return found


def _together(estimates: Sequence[Estimate], index: str) -> Estimate:
    """Repeated settings as one: means weighted by samples; the band narrows as its samples grow."""
    if len(estimates) == 1:
        return estimates[0]
    if estimates[0].beyond is not None:  # of an extreme nothing is averaged: what was seen once was seen
        return (min if index == "minimum_response_time" else max)(estimates, key=lambda estimate: estimate.value)
    total = sum(estimate.effective_samples for estimate in estimates)
    parts = [estimate.effective_samples / total for estimate in estimates]
    value = sum(part * estimate.value for part, estimate in zip(parts, estimates, strict=True))
    below = (
        sum((part * (estimate.value - estimate.lower)) ** 2 for part, estimate in zip(parts, estimates, strict=True))
        ** 0.5
    )
    above = (
        sum((part * (estimate.upper - estimate.value)) ** 2 for part, estimate in zip(parts, estimates, strict=True))
        ** 0.5
    )
    return Estimate(
        value=value,
        lower=value - below,
        upper=value + above,
        error=estimates[0].error,
        samples=sum(estimate.samples for estimate in estimates),
        effective_samples=total,
    )


def _monotone(reserves: Sequence[int], estimates: Sequence[Estimate], index: str) -> tuple[Point, ...]:
    fit = _fit_of(index, [estimate.effective_samples for estimate in estimates])
    value, lower, upper = (
        fit(side)
        for side in (
            [estimate.value for estimate in estimates],
            [estimate.lower for estimate in estimates],
            [estimate.upper for estimate in estimates],
        )
    )
    return tuple(
        Point(reserve=float(reserve), value=value[at], lower=lower[at], upper=upper[at])
        for at, reserve in enumerate(reserves)
    )


def _unbounded(point: Point, index: str) -> Point:
    """With nothing known of the side that a reservation would rest on."""
    return replace(point, upper=inf) if _smaller_is_better(index) else replace(point, lower=-inf)


def _fit_of(index: str, weights: Sequence[float]) -> Callable[[Sequence[float]], list[float]]:
    """How an index is made monotone; of an extreme nothing is averaged: more CPU does not undo what was seen."""
    match index:
        case "maximum_response_time":
            return not_below_later
        case "minimum_response_time":
            return not_above_earlier
        case _:
            fit = falling if _smaller_is_better(index) else rising
            return lambda side: fit(side, weights)


def _between(left: Point, right: Point, reserve: float) -> Point:
    part = (reserve - left.reserve) / (right.reserve - left.reserve)
    value, lower, upper = (
        _mix(one, other, part)
        for one, other in ((left.value, right.value), (left.lower, right.lower), (left.upper, right.upper))
    )
    return Point(reserve=reserve, value=value, lower=lower, upper=upper)


def _mix(left: float, right: float, part: float) -> float:
    """Straight between; exact at the ends, also where the other end is infinite."""
    if part <= 0.0 or left == right:
        return left
    return right if part >= 1.0 else (1.0 - part) * left + part * right


def _smaller_is_better(index: str) -> bool:
    found = find_index(index)
    if found is None:
        raise ValueError(f"{index!r} is no performance index")
    return found.smaller_is_better


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
