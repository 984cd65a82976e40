"""Estimates of performance indexes, with bounds that say how often they are wrong.

Response times are in ms, shares in per cent, rates a second: the index's own unit, as in an APT.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil, exp, inf, log, sqrt

from rarms_iac.model.indexes import percentile_of
from rarms_iac.model.measurement import Series
from rarms_iac.model.system import Run
from rarms_iac.statistics import values
from rarms_iac.statistics.correlation import effective_samples
from rarms_iac.statistics.distributions import beta_quantile, share_interval, student_quantile

USUAL_ERROR = 0.05
"""The probability that the truth lies outside an interval that is shown to people."""

SAFE_SIDE = USUAL_ERROR / 2
"""The probability that its safe side is wrong: what a setting passes by, and a reservation rests on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A performance index of one series: what was seen, and between what the truth lies."""

    value: float
    lower: float  # the truth is below with at most half the error; -inf: samples say nothing about this side
    upper: float  # the truth is above with at most half the error; inf: likewise
    error: float
    samples: int  # those that the value is made of
    effective_samples: float  # what they are worth when each depends on those before it; at most `samples`
    beyond: float | None = None  # of an extreme: the share of jobs, in per cent, that may yet lie beyond it


@dataclass(frozen=True, slots=True, kw_only=True)
class NoEstimate:
    """The samples say nothing about the index."""

    why: str


def estimate(index: str, series: Series, run: Run, *, error: float = USUAL_ERROR) -> Estimate | NoEstimate:
    """The index of this name (`model/indexes`) over all samples of the series, with two-sided bounds of this error.

    The series is taken as steady: `steadiness.steady_part` cuts a warm-up off. `run` says the deadline.
    """
    share = percentile_of(index)
    if share is not None:
        return _percentile(values.response_times(series.samples), float(share) / 100, error)
    return _ESTIMATORS[index](series, run, error)


def mean_estimate(numbers: Sequence[float], error: float) -> Estimate | NoEstimate:
    """The mean of numbers of any unit, by Student's t over as many samples as they are worth."""
    count = len(numbers)
    if count < 2:
        return NoEstimate(why=f"{count} jobs answered; a mean with bounds needs two")
    mean, worth = sum(numbers) / count, effective_samples(numbers)
    half = _half_width(_deviation(numbers, mean), worth, error)
    return Estimate(
        value=mean, lower=mean - half, upper=mean + half, error=error, samples=count, effective_samples=worth
    )


def share_estimate(ones: Sequence[float], error: float) -> Estimate | NoEstimate:
    """The share of ones among zeros and ones, in per cent, by Clopper and Pearson's bounds."""
    if not ones:
        return NoEstimate(why="no job ended")
    share, worth = sum(ones) / len(ones), effective_samples(ones)
    lower, upper = share_interval(share * worth, worth, error=error)
    return Estimate(
        value=100 * share,
        lower=100 * lower,
        upper=100 * upper,
        error=error,
        samples=len(ones),
        effective_samples=worth,
    )


def _percentile(times: Sequence[float], share: float, error: float) -> Estimate | NoEstimate:
    """Order statistics: whatever the distribution, the number of samples below its percentile is binomial."""
    count = len(times)
    if count == 0:
        return NoEstimate(why="no job answered")
    ordered = sorted(times)
    value = ordered[min(count - 1, ceil(share * count) - 1)]
    worth = effective_samples([1.0 if time > value else 0.0 for time in times])
    lower, upper = _rank_bounds(share, worth, error)
    return Estimate(
        value=value,
        lower=ordered[ceil(lower * count) - 1] if lower > 0.0 else -inf,
        upper=ordered[ceil(upper * count) - 1] if upper < 1.0 else inf,
        error=error,
        samples=count,
        effective_samples=worth,
    )


def _rank_bounds(share: float, worth: float, error: float) -> tuple[float, float]:
    """Ranks, as shares of all samples, that enclose the percentile; 0 or 1 where so few samples have none.

    The r-th of n ordered samples has a share of the distribution below it that is Beta(r, n + 1 - r): the least r
    whose share is above the percentile's, and the greatest whose share is below it, each but for half the error.
    """
    whole = max(1, int(worth))
    upper, lower = whole + 1, 0
    low, high = 1, whole + 1
    while low < high:
        rank = (low + high) // 2
        if rank <= whole and beta_quantile(error / 2, rank, whole + 1 - rank) < share:
            low = rank + 1
        else:
            high = rank
    upper = low
    low, high = 0, whole
    while low < high:
        rank = (low + high + 1) // 2
        if beta_quantile(1.0 - error / 2, rank, whole + 1 - rank) <= share:
            low = rank
        else:
            high = rank - 1
    lower = low
    return lower / whole, upper / whole if upper <= whole else 1.0


def _mean_response_time(series: Series, _run: Run, error: float) -> Estimate | NoEstimate:
    return mean_estimate(values.response_times(series.samples), error)


def _success_rate(series: Series, _run: Run, error: float) -> Estimate | NoEstimate:
    return share_estimate(values.successes(series.samples), error)


def _deadline_miss_rate(series: Series, run: Run, error: float) -> Estimate | NoEstimate:
    return share_estimate(values.misses(series.samples, run), error)


def _maximum_response_time(series: Series, _run: Run, error: float) -> Estimate | NoEstimate:
    return _extreme(values.response_times(series.samples), error, longest=True)


def _minimum_response_time(series: Series, _run: Run, error: float) -> Estimate | NoEstimate:
    return _extreme(values.response_times(series.samples), error, longest=False)


def _extreme(times: Sequence[float], error: float, *, longest: bool) -> Estimate | NoEstimate:
    """The extreme seen; n samples leave a share of 1 - error ** (1 / n) of the jobs possibly beyond it."""
    if not times:
        return NoEstimate(why="no job answered")
    worth = effective_samples(times)
    value = max(times) if longest else min(times)
    return Estimate(
        value=value,
        lower=value if longest else -inf,
        upper=inf if longest else value,
        error=error,
        samples=len(times),
        effective_samples=worth,
        beyond=100 * (1.0 - error ** (1.0 / worth)),
    )


def _jitter(series: Series, _run: Run, error: float) -> Estimate | NoEstimate:
    """The standard deviation; its bounds from the spread of the squared deviations, whatever the distribution."""
    times = values.response_times(series.samples)
    if len(times) < 3:
        return NoEstimate(why=f"{len(times)} jobs answered; jitter with bounds needs three")
    mean = sum(times) / len(times)
    squares = [(time - mean) ** 2 for time in times]
    variance = sum(squares) / (len(times) - 1)
    worth = min(effective_samples(times), effective_samples(squares))
    if variance == 0.0:
        return Estimate(value=0.0, lower=0.0, upper=0.0, error=error, samples=len(times), effective_samples=worth)
    # On the logarithm's scale, where the estimate is nearly symmetric: d log(s) = d(s^2) / (2 s^2).
    half = _half_width(_deviation(squares, variance), worth, error) / (2.0 * variance)
    middle = log(variance) / 2
    return Estimate(
        value=exp(middle),
        lower=exp(middle - half),
        upper=exp(middle + half),
        error=error,
        samples=len(times),
        effective_samples=worth,
    )


def _throughput(series: Series, _run: Run, error: float) -> Estimate | NoEstimate:
    """Successes over elapsed time, as a ratio of means: what each job gave against the time until it was over."""
    if len(series.samples) < 2 or series.elapsed_ms <= 0.0:
        return NoEstimate(why=f"{len(series.samples)} jobs ended; a throughput with bounds needs two")
    jobs = sorted(zip(values.ends_ms(series.samples), values.gains(series.samples), strict=True))
    gains = [gain for _, gain in jobs]
    rate = sum(gains) / series.elapsed_ms
    times = [later - sooner for (sooner, _), (later, _) in zip([(0.0, 0.0), *jobs], jobs, strict=False)]
    residuals = [gain - rate * time for gain, time in zip(gains, times, strict=True)]
    worth = effective_samples(residuals)
    half = _half_width(_deviation(residuals, 0.0), worth, error) * len(jobs) / series.elapsed_ms
    return Estimate(
        value=1000 * rate,
        lower=max(0.0, 1000 * (rate - half)),
        upper=1000 * (rate + half),
        error=error,
        samples=len(jobs),
        effective_samples=worth,
    )


def _deviation(numbers: Sequence[float], mean: float) -> float:
    return sqrt(sum((number - mean) ** 2 for number in numbers) / (len(numbers) - 1))


def _half_width(deviation: float, worth: float, error: float) -> float:
    """How far the truth may lie from a mean of samples worth so many, but for this error."""
    return student_quantile(1.0 - error / 2, max(1.0, float(int(worth) - 1))) * deviation / sqrt(worth)


_ESTIMATORS: dict[str, Callable[[Series, Run, float], Estimate | NoEstimate]] = {
    "mean_response_time": _mean_response_time,
    "minimum_response_time": _minimum_response_time,
    "maximum_response_time": _maximum_response_time,
    "jitter": _jitter,
    "success_rate": _success_rate,
    "deadline_miss_rate": _deadline_miss_rate,
    "throughput": _throughput,
}
