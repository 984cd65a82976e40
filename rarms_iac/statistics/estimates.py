"""Estimates of performance indexes, with bounds that say how often they are wrong.

Response times are in ms, shares in per cent, rates a second: the index's own unit, as in an APT.
"""

from collections.abc import Callable, Sequence
from math import ceil, exp, inf, log, sqrt

from rarms_iac.model.indexes import percentile_of
from rarms_iac.model.measurement import Sample, Series
from rarms_iac.model.outcomes import Estimate, NoEstimate, Unsteady
from rarms_iac.model.system import Run
from rarms_iac.statistics.distributions import beta_quantile, share_interval, student_quantile
from rarms_iac.statistics.samples import deadline_misses, effective_samples, end_ms, response_times, successes
from rarms_iac.statistics.steady_state import find_steady_part, steady_series

USUAL_ERROR = 0.05
"""The probability that the truth lies outside an interval that is shown to people."""

SAFE_SIDE = USUAL_ERROR / 2
"""The probability that its safe side is wrong: what a setting passes by, and a reservation rests on."""

_ROUNDING = 1e-9


def estimate(index: str, series: Series, run: Run, *, error: float = USUAL_ERROR) -> Estimate | NoEstimate:
    """Estimate a performance index over all samples of a series, which is taken as steady.

    Args:
        index: A name of `model/indexes`.
        series: Of one component at one setting.
        run: The component's; says the deadline.
        error: The probability, 0..1, that the truth lies outside the bounds; half of it on each side.
    """
    share = percentile_of(index)
    if share is not None:
        return _percentile(response_times(series.samples), float(share) / 100, error)
    return _ESTIMATORS[index](series, run, error)


def estimate_steady(index: str, series: Series, run: Run, *, error: float = USUAL_ERROR) -> Estimate | NoEstimate:
    """Estimate a performance index over the steady part of a series, without its warm-up (`estimate`).

    Args:
        index: the index's name.
        series: the samples of one component at one setting, in order.
        run: how the component is run, with its deadline.
        error: the probability, 0..1, that the true value lies outside of the interval.

    Returns:
        The estimate in the index's unit; or the reason why there is none: too few samples, or no steady state.
    """
    first = find_steady_part(response_times(series.samples))
    if isinstance(first, Unsteady):
        return NoEstimate(reason=first.reason)
    return estimate(index, steady_series(index, series, first), run, error=error)


def mean_estimate(numbers: Sequence[float], error: float) -> Estimate | NoEstimate:
    """Estimate the mean of numbers of any unit, by Student's t over as many samples as they are worth.

    Where all numbers are alike, a share of others may not have been seen (`_unseen_share`); these are taken to be away
    by the mean itself at most.

    Args:
        numbers: in the order in which they were sampled, since neighbours may be correlated.
        error: the probability, 0..1, that the true mean lies outside of the interval.

    Returns:
        The estimate in the numbers' unit; or the reason why there is none: fewer than two numbers.
    """
    count = len(numbers)
    if count < 2:
        return NoEstimate(reason=f"{count} jobs answered; a mean with bounds needs two")
    mean, worth = sum(numbers) / count, effective_samples(numbers)
    if _are_equal(numbers):
        below = above = abs(mean) * _unseen_share(worth, error)
    else:
        deviation = _deviation(numbers, mean)
        half = _half_width(deviation, worth, error)
        lean = _lean(numbers, mean, deviation, worth, half)
        below, above = half + max(0.0, -lean), half + max(0.0, lean)
    return Estimate(
        value=mean, lower=mean - below, upper=mean + above, error=error, samples=count, effective_samples=worth
    )


def _lean(numbers: Sequence[float], mean: float, deviation: float, worth: float, half: float) -> float:
    """How far the bounds of a mean move towards the longer tail (Johnson's correction of Student's t).

    With the skewness g: g * (1 + 2 t^2) / (6 * sqrt(n)) standard errors. A rare long job is rarer still among few.
    """
    standard = deviation / sqrt(worth)
    skewness = sum((number - mean) ** 3 for number in numbers) / len(numbers) / deviation**3
    return standard * skewness * (1.0 + 2.0 * (half / standard) ** 2) / (6.0 * sqrt(worth))


def share_estimate(ones: Sequence[float], error: float) -> Estimate | NoEstimate:
    """Estimate the share of ones among zeros and ones, by Clopper and Pearson's bounds.

    Args:
        ones: 1 or 0 for each job, in the order in which they were sampled.
        error: the probability, 0..1, that the true share lies outside of the interval.

    Returns:
        The estimate in per cent; or the reason why there is none: no job.
    """
    if not ones:
        return NoEstimate(reason="no job ended")
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


def _are_equal(numbers: Sequence[float]) -> bool:
    """Whether they show no spread to state an error by (but for what a computed time is rounded by)."""
    least, greatest = min(numbers), max(numbers)
    return greatest - least <= _ROUNDING * max(abs(least), abs(greatest))


def _unseen_share(worth: float, error: float) -> float:
    """The share of jobs that may be of a kind of which samples worth so many show none, but for half the error."""
    return 1.0 - exp(log(error / 2) / worth)


def _percentile(times: Sequence[float], share: float, error: float) -> Estimate | NoEstimate:
    """Order statistics: whatever the distribution, the number of samples below its percentile is binomial."""
    count = len(times)
    if count == 0:
        return NoEstimate(reason="no job answered")
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
    return mean_estimate(response_times(series.samples), error)


def _success_rate(series: Series, _run: Run, error: float) -> Estimate | NoEstimate:
    return share_estimate(successes(series.samples), error)


def _deadline_miss_rate(series: Series, run: Run, error: float) -> Estimate | NoEstimate:
    return share_estimate(deadline_misses(series.samples, run), error)


def _maximum_response_time(series: Series, _run: Run, error: float) -> Estimate | NoEstimate:
    return _extreme(response_times(series.samples), error, longest=True)


def _minimum_response_time(series: Series, _run: Run, error: float) -> Estimate | NoEstimate:
    return _extreme(response_times(series.samples), error, longest=False)


def _extreme(times: Sequence[float], error: float, *, longest: bool) -> Estimate | NoEstimate:
    """The extreme seen; n samples leave a share of 1 - error ** (1 / n) of the jobs possibly beyond it."""
    if not times:
        return NoEstimate(reason="no job answered")
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
    """The standard deviation; its bounds from the spread of the squared deviations, whatever the distribution.

    Above on the logarithm's scale, d log(s) = d(s^2) / (2 s^2), below on that of squares: each is the wider one there,
    and where a few rare jobs make all of the spread, their number is as uncertain.
    """
    times = response_times(series.samples)
    if len(times) < 3:
        return NoEstimate(reason=f"{len(times)} jobs answered; jitter with bounds needs three")
    mean = sum(times) / len(times)
    squares = [(time - mean) ** 2 for time in times]
    variance = sum(squares) / (len(times) - 1)
    worth = min(effective_samples(times), effective_samples(squares))
    if _are_equal(times):
        unseen = _unseen_share(worth, error)
        lower, upper = 0.0, mean * sqrt(unseen * (1.0 - unseen)) if unseen < 0.5 else mean / 2
    else:
        half = _half_width(_deviation(squares, variance), worth, error)
        lower, upper = sqrt(max(0.0, variance - half)), sqrt(variance) * exp(half / (2.0 * variance))
    return Estimate(
        value=sqrt(variance), lower=lower, upper=upper, error=error, samples=len(times), effective_samples=worth
    )


def _throughput(series: Series, _run: Run, error: float) -> Estimate | NoEstimate:
    """Successes over elapsed time: the share of successes, times the rate at which jobs would count if all succeeded.

    Either bound is wrong with half of the error (union bound). Together in one spread they would be known too well:
    where all of 40 jobs succeeded, the spread does not show the one in ten that fails.
    """
    count = len(series.samples)
    if count < 2 or series.elapsed_ms <= 0.0:
        return NoEstimate(reason=f"{count} jobs ended; a throughput with bounds needs two")
    jobs = sorted(series.samples, key=end_ms)
    share = share_estimate(successes(jobs), error / 2)
    if isinstance(share, NoEstimate):
        return share
    rate, half, worth = _rate_of_successes(jobs, series.elapsed_ms, error / 2)
    return Estimate(
        value=10 * share.value * rate,
        lower=10 * share.lower * max(0.0, rate - half),
        upper=10 * share.upper * (rate + half),
        error=error,
        samples=count,
        effective_samples=min(worth, share.effective_samples),
    )


def _rate_of_successes(jobs: Sequence[Sample], elapsed_ms: float, error: float) -> tuple[float, float, float]:
    """What a success counts over the time a job takes, a ms; how far the truth may be from it; what the jobs are worth.

    A ratio of means: its spread is that of (what a success counts beyond its mean - rate * a job's time).
    """
    succeeded = [job for job in jobs if job.successful] or jobs
    counts = sum(job.count for job in succeeded) / len(succeeded)
    weight = len(jobs) / len(succeeded)
    rate = counts * len(jobs) / elapsed_ms
    ends = [end_ms(job) for job in jobs]
    times = [later - sooner for sooner, later in zip([0.0, *ends], ends, strict=False)]
    residuals = [
        (weight * (job.count - counts) if job.successful else 0.0) - rate * time
        for job, time in zip(jobs, times, strict=True)
    ]
    mean, worth = sum(residuals) / len(jobs), effective_samples(residuals)
    return rate, _half_width(_deviation(residuals, mean), worth, error) * len(jobs) / elapsed_ms, worth


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
