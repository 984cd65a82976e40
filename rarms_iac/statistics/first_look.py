"""Estimates of the first pass: the side of a threshold on which a setting probably lies, and a provisional reservation.

Nothing here is a verdict. A setting of the first pass ends when its estimates lie clearly enough on one side of the
thresholds, or after a short time. Percentiles beyond what its samples can show are those of a fitted tail: of the
excesses over a high quantile a generalised Pareto distribution, by probability-weighted moments (Hosking and Wallis
1987). Begin at `least_estimated`.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, inf, isinf, log, sqrt
from typing import Final

from rarms_iac.model.indexes import index_named, percentile_of
from rarms_iac.model.outcomes import Doubt, Estimate, UncertainEstimate
from rarms_iac.model.quantities import ReservePercent, Unit
from rarms_iac.model.run import USUAL_SAMPLES, Run
from rarms_iac.model.series import Series
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import AtMost, Threshold
from rarms_iac.statistics.curves import falling, not_below_later, rising
from rarms_iac.statistics.estimates import estimate
from rarms_iac.statistics.overload import find_overload, grows_without_end
from rarms_iac.statistics.samples import response_times

LEAST_SAMPLES: Final = 8
"""Samples of each component that a setting of the first pass has, however long they take."""

LONGEST_MS: Final = 15_000.0
"""The host's time after which such a setting ends once it has these."""

_DOUBT: Final = 0.1
"""How probably an estimate lies on the wrong side of its threshold where a setting ends early."""

_DEVIATIONS: Final = 1.3
"""The same, in deviations of a count."""

_BEYOND: Final = 3.0
"""Samples beyond a percentile that show it; with fewer, it is that of the fitted tail."""

_TAIL_PART: Final = 0.25
"""The part of the samples, at least `_TAIL`, that the tail is fitted to."""

_TAIL: Final = 10

FEW: Final = 1000
"""Fewer samples hardly show a maximum, a minimum or a share of jobs."""

_HEAVIEST: Final = 0.5
"""The shape of a fitted tail at most, and at least but for its sign: of few samples it is hardly known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PointEstimate:
    """An index of a component as a setting showed it, without bounds."""

    value: float  # in the index's unit
    doubt: Doubt | None = None  # why few samples hardly show it; None: they do


def point_estimate(index: str, series: Series, run: Run) -> PointEstimate | None:
    """Estimate an index by the samples of one setting.

    Returns:
        None: the samples say nothing of it. A maximum is that of as many samples as a usual setting has. A component
            that falls behind its jobs has the worst value there is.
    """
    if grows_without_end(index, series, run) and find_overload(series, run, error=_DOUBT):
        return PointEstimate(value=inf if index_named(index).smaller_is_better else -inf)
    percentile, times = percentile_of(index), response_times(series.samples)
    share = None if percentile is None else float(percentile) / 100
    if index == "maximum_response_time" and 0 < len(times) < USUAL_SAMPLES:
        longest = fitted_percentile(times, 1.0 - 1.0 / USUAL_SAMPLES)
        return PointEstimate(value=max(longest, *times), doubt=Doubt.EXTREME)
    if share is not None and times and len(times) * (1.0 - share) < _BEYOND:
        exceeded = sorted(times)[-min(len(times), ceil(_BEYOND) + 1)]  # by as many as show a percentile
        return PointEstimate(value=max(fitted_percentile(times, share), exceeded), doubt=Doubt.TAIL)
    seen = estimate(index, series, run, unseen=False)
    return PointEstimate(value=seen.value, doubt=_doubt(index, series)) if isinstance(seen, Estimate) else None


def _doubt(index: str, series: Series) -> Doubt | None:
    """Return why so few samples hardly show a maximum, a minimum or a share of jobs; None: it is shown."""
    if len(series.samples) >= FEW:
        return None
    if index_named(index).is_extreme:
        return Doubt.EXTREME
    return Doubt.SHARE if index_named(index).unit is Unit.SHARE else None


def uncertain_estimates(
    series: Iterable[Series], runs: Mapping[str, Run], apts: Mapping[str, Mapping[str, Threshold]]
) -> tuple[UncertainEstimate, ...]:
    """Return the estimates at one setting that more samples may change most.

    Args:
        series: of the setting, one a component.
    """
    by_name = {each.component: each for each in series}
    return tuple(
        UncertainEstimate(component=name, index=index, doubt=found.doubt)
        for name, apt in apts.items()
        if name in by_name
        for index in apt
        if (found := point_estimate(index, by_name[name], runs[name])) is not None and found.doubt is not None
    )


def fitted_percentile(times: Sequence[float], share: float) -> float:
    """Return a percentile of the tail that fits the longest times.

    Args:
        times: at least one, in any order.
        share: of all jobs that take no longer, 0..1.

    Returns:
        At least the time beyond which the tail begins.
    """
    ordered = sorted(times)
    count = len(ordered)
    tail = min(count - 1, max(_TAIL, ceil(_TAIL_PART * count)))
    if tail < 2 or (1.0 - share) * count >= tail:
        return ordered[min(count - 1, int(share * count))]
    begin = ordered[count - tail - 1]
    excesses = [time - begin for time in ordered[count - tail :]]
    mean = sum(excesses) / tail
    weighted = sum((1.0 - (at + 0.65) / tail) * excess for at, excess in enumerate(excesses)) / tail
    if mean <= 0.0:
        return begin
    shape = 2.0 - mean / (mean - 2.0 * weighted) if mean > 2.0 * weighted else _HEAVIEST
    shape = min(_HEAVIEST, max(-_HEAVIEST, shape))
    scale, beyond = mean * (1.0 - shape), tail / (count * (1.0 - share))
    return begin + scale * (log(beyond) if abs(shape) < 1e-9 else (beyond**shape - 1.0) / shape)


def meets_point(value: float, threshold: Threshold) -> bool:
    """Tell whether a value meets a threshold, in its unit."""
    limit = float(threshold.value)
    return value <= limit if isinstance(threshold, AtMost) else value >= limit


def estimated_to_meet(
    settings: Sequence[Setting], runs: Mapping[str, Run], apts: Mapping[str, Mapping[str, Threshold]]
) -> dict[ReservePercent, bool]:
    """Say of each setting whether all thresholds are met there by the estimates, made monotone where they can be.

    Args:
        settings: one a reservation, in any order.
        runs: by component.
        apts: by component, then by index.

    Returns:
        By CR, ascending; a setting that says nothing of an index does not meet it.
    """
    ordered = sorted(settings, key=lambda setting: setting.reserve)
    meets = {setting.reserve: True for setting in ordered}
    for component, apt in apts.items():
        for index, threshold in apt.items():
            values = _line(ordered, component, index, runs[component])
            for reserve in meets:
                meets[reserve] &= reserve in values and meets_point(values[reserve], threshold)
    return meets


def _line(settings: Sequence[Setting], component: str, index: str, run: Run) -> dict[ReservePercent, float]:
    """Return an index by CR, as it cannot get worse with more CPU."""
    found = [
        (setting.reserve, estimated.value, len(series.samples))
        for setting in settings
        for series in setting.series
        if series.component == component and (estimated := point_estimate(index, series, run)) is not None
    ]
    overloaded = {reserve: value for reserve, value, _ in found if isinf(value)}
    known = [each for each in found if not isinf(each[1])]
    values, weights = [value for _, value, _ in known], [float(count) for *_, count in known]
    if index == "maximum_response_time":
        values = not_below_later(values)
    elif index not in {"jitter", "minimum_response_time"}:
        values = (falling if index_named(index).smaller_is_better else rising)(values, weights)
    return dict(zip((reserve for reserve, *_ in known), values, strict=True)) | overloaded


def least_estimated(
    settings: Sequence[Setting], runs: Mapping[str, Run], apts: Mapping[str, Mapping[str, Threshold]]
) -> ReservePercent | None:
    """Find the least measured CR at which all thresholds are met by the estimates, and at every higher one, too.

    Args:
        settings: as of `estimated_to_meet`.

    Returns:
        None: they are met at no measured CR.
    """
    if not any(apts.values()):
        return None
    meets = estimated_to_meet(settings, runs, apts)
    above = [reserve for reserve, met in meets.items() if not met]
    return next((reserve for reserve in meets if reserve > max(above, default=0)), None)


def is_probable(series: Series, apt: Mapping[str, Threshold], run: Run) -> bool:
    """Tell whether the samples probably show on which side of its thresholds a component lies.

    Args:
        series: of the component, at one setting.
        apt: its thresholds by index.

    Returns:
        True where each estimate lies off its threshold by more than its error, or is known well enough for a first
        look.
    """
    return all(_is_off(index, threshold, series, run) for index, threshold in apt.items())


def _is_off(index: str, threshold: Threshold, series: Series, run: Run) -> bool:
    value = point_estimate(index, series, run)
    if value is None:
        return False
    if isinf(value.value):
        return True
    percentile, limit = percentile_of(index), float(threshold.value)
    if percentile is not None:  # the rank's error, by the share of jobs that take longer than the limit
        times = response_times(series.samples)
        late, allowed = sum(time > limit for time in times), len(times) * (1.0 - float(percentile) / 100)
        return allowed >= 1.0 and abs(late - allowed) > _DEVIATIONS * sqrt(allowed)
    seen = estimate(index, series, run, error=_DOUBT, unseen=False)
    if not isinstance(seen, Estimate):
        return False
    return seen.beyond is not None or not seen.lower <= limit <= seen.upper
