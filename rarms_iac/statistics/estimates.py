"""Estimates of performance indexes, with bounds that say how often they are wrong.

Response times are in ms, shares in per cent, rates a second: the index's own unit, as in an APT.
"""

from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import compress, pairwise, repeat
from math import ceil, inf, sqrt
from operator import mul
from statistics import fmean, stdev

from rarms_iac.model.indexes import index_named, percentile_of
from rarms_iac.model.outcomes import Estimate, NoEstimate, Unsteady
from rarms_iac.model.run import Periodic, Run
from rarms_iac.model.series import SampleColumns, Series, columns_of
from rarms_iac.statistics.distributions import (
    FIRST_LOOK,
    LOOK_ERROR,
    PERIODIC_STARTS,
    beta_quantile,
    share_interval,
    student_quantile,
)
from rarms_iac.statistics.samples import (
    batch_moments,
    deadline_misses,
    effective_samples,
    ends_ms,
    response_times,
    successes,
)
from rarms_iac.statistics.steady_state import answered_before, split_series, steady_part
from rarms_iac.texts.messages import counted

FEWEST_EFFECTIVE = 25
"""Independent samples that a mean's bounds need once there are `FIRST_LOOK`, or half of all, where that is less: of
fewer, their dependence on one another is unknown."""

_WORST_PHASE = 20.0
"""How many times the mean a job takes in the worst phase of a load that no start of it had."""

_QUARTERS = 4
_FEWEST_OF_QUARTER = 10  # samples

_MAXIMUM = "maximum_response_time"
"""It is of all samples: no warm-up excuses a late answer."""

_PER_SECOND = 1000 / 100
"""What per cent of the jobs, over ms a job, are in jobs a second."""

_TREND = 2.0
"""So many times the first quarter the last one is at least, or the other way round, where there is a trend."""


def estimate(
    index: str, series: Series, run: Run, *, error: float = LOOK_ERROR, unseen: bool = True
) -> Estimate | NoEstimate:
    """Estimate a performance index over all samples of a series, which is taken as steady.

    Args:
        run: The component's; says the deadline.
        error: The probability, 0..1, that the truth is above the upper bound, and likewise below the lower one. The
            usual one holds for all looks at a setting together.
        unseen: Whether jobs of a kind that no sample showed are counted in. False: for a guess, never for a verdict.

    Returns:
        The estimate with its bounds, in the index's unit; or why there is none: too few jobs, or too dependent on
            one another. The same question is worked out once.
    """
    samples = columns_of(series.samples)
    return samples.remember(
        (index, error, unseen, run.deadline, series.elapsed_ms, series.starts, series.runs),
        lambda: _estimate(index, replace(series, samples=samples), run, error, unseen),
    )


def _estimate(index: str, series: Series, run: Run, error: float, unseen: bool) -> Estimate | NoEstimate:
    percentile_percent = percentile_of(index)
    if percentile_percent is not None:
        share = float(percentile_percent) / 100
        found = _percentile(response_times(series.samples), share, error, _answered_starts(series))
    else:
        found = _ESTIMATORS[index](series, run, error, unseen)
    starts = 1 + len(_starts(series))
    if unseen and series.starts and isinstance(run.arrival, Periodic) and isinstance(found, Estimate):
        return _with_unseen_phase(index, found, series, starts) if starts < PERIODIC_STARTS else found
    return found


def _with_unseen_phase(index: str, seen: Estimate, series: Series, starts: int) -> Estimate:
    """Widen bounds of a periodic component by the worst phase that none of its few starts had.

    A component may keep one phase of a load for a whole start. So many starts may have missed phases that a share of
    all starts leads to, with a probability of `LOOK_ERROR`. There each job is bad, and takes `_WORST_PHASE` times the
    mean. An extreme stays: it says what was seen.
    """
    if seen.beyond is not None:
        return seen
    missed = 1.0 - LOOK_ERROR ** (1.0 / starts)
    times = response_times(series.samples)
    worst = max(_WORST_PHASE * sum(times) / len(times), *times) if times else inf
    percentile = percentile_of(index)
    lower, upper = (1.0 - missed) * seen.lower, (1.0 - missed) * seen.upper
    if percentile is not None:
        upper = max(seen.upper, worst)
    elif index == "jitter":
        upper = sqrt((1.0 - missed) * seen.upper**2 + missed * worst**2)
    elif index == "deadline_miss_rate":
        upper += 100 * missed
    elif index_named(index).smaller_is_better:
        upper += worst * missed
    else:  # a share of successes, or their rate
        upper = seen.upper
    return replace(seen, lower=lower, upper=upper)


def estimate_steady(index: str, series: Series, run: Run, *, error: float) -> Estimate | NoEstimate:
    """Estimate a performance index over the steady part of a series, without its warm-up (`estimate`).

    A series that wanders is one of a machine whose speed changes and stays so for seconds. Where its level changes, or
    its samples depend too strongly on one another, its quarters count as four samples of the index (batch means).

    Args:
        series: the samples of one component at one setting, in order.
        run: how the component is run, with its deadline.
        error: the probability, 0..1, that the true value is above the upper bound, and likewise below the lower one.

    Returns:
        The estimate in the index's unit; or the reason why there is none: too few samples, or no steady state.
    """
    part = steady_part(series)
    if isinstance(part, Unsteady):
        steady: Estimate | NoEstimate = NoEstimate(reason=part.reason)
    else:
        steady = estimate(index, series if index == _MAXIMUM else part, run, error=error)
    if isinstance(steady, Estimate) or not series.wanders or series.unsettled:
        return steady
    return _estimate_of_quarters(index, series, run, error) or steady


def _estimate_of_quarters(index: str, series: Series, run: Run, error: float) -> Estimate | None:
    """Return the estimate of four quarters together, no surer than that of all samples as if they were steady.

    None: too few samples; an extreme; a quarter without an answer; or quarters that go one way and double: a trend,
    and it is not known where that ends.
    """
    count = len(series.samples)
    if count < _QUARTERS * _FEWEST_OF_QUARTER:
        return None
    quarters = [estimate(index, part, run, unseen=False) for part in split_series(series, _QUARTERS)]
    values = [quarter.value for quarter in quarters if isinstance(quarter, Estimate) and quarter.beyond is None]
    steps = [later - sooner for sooner, later in pairwise(values)]
    if len(values) < _QUARTERS:
        return None
    if (min(steps) > 0.0 or max(steps) < 0.0) and max(values) >= _TREND * min(values):
        return None
    mean = fmean(values)
    half_width = student_quantile(1.0 - error, _QUARTERS - 1.0) * stdev(values) / sqrt(_QUARTERS)
    lower, upper = max(0.0, mean - half_width), mean + half_width
    if isinstance(whole := estimate(index, series, run, error=error), Estimate):
        lower, upper = min(lower, whole.lower), max(upper, whole.upper)
    return Estimate(value=mean, lower=lower, upper=upper, samples=count, effective_samples=float(_QUARTERS))


def _starts(series: Series) -> list[int]:
    """Return the samples with which the load or the component began again."""
    return sorted({*series.starts, *series.runs})


def _answered_starts(series: Series) -> list[int]:
    """Return the samples of `_starts`, counted among the jobs that answered."""
    return answered_before(series, _starts(series))


@dataclass(frozen=True, slots=True)
class _Moments:
    """The moments from which a mean's bounds follow."""

    mean: float
    second: float  # central moments
    third: float

    def with_unseen_jobs(
        self, distance_below: float, distance_above: float, effective: float
    ) -> tuple["_Moments", "_Moments"]:
        """Return the moments for the lower and for the upper bound, each with an unseen job on its side."""
        return self._with_unseen(distance_below, effective), self._with_unseen(distance_above, effective)

    def _with_unseen(self, distance: float, effective: float) -> "_Moments":
        """Add an unseen job, so far from the mean, to samples worth so many."""
        part = 1.0 / (effective + 1.0)
        shift = part * distance
        second = (1.0 - part) * self.second + part * distance**2
        third = (1.0 - part) * self.third + part * distance**3
        return _Moments(
            self.mean + shift,
            second - shift**2,
            third - 3.0 * shift * second + 2.0 * shift**3,
        )


def mean_estimate(
    numbers: Sequence[float], error: float, *, unseen: bool = True, starts: Sequence[int] = ()
) -> Estimate | NoEstimate:
    """Estimate the mean of numbers that cannot be negative, such as times.

    Student's t over as many samples as they are worth, moved towards the longer tail by what the skewness asks for
    (Johnson 1978). Before that an unseen job is added to each side: above it takes twice the mean, or as much
    as the longest seen, below it takes nothing. Without it no bound of a mean can hold, since a rare kind of job may
    be in none of the samples (Bahadur and Savage 1956); with it the bound follows that of a Poisson count, from no
    such job seen to many.

    Args:
        numbers: in the order in which they were sampled, since neighbours may be correlated.
        error: the probability, 0..1, that the true mean is above the upper bound, and likewise below the lower one.
        unseen: whether that job is added.

    Returns:
        The estimate in the numbers' unit; or the reason why there is none: too few, all of them 0, or too dependent on
            one another (`FEWEST_EFFECTIVE`) for bounds.
    """
    count = len(numbers)
    if count < 2:
        return NoEstimate(reason=f"{counted(count, 'job')} answered; a mean with bounds needs two")
    mean, effective = sum(numbers) / count, effective_samples(numbers, starts, error)
    if unseen and mean <= 0.0:
        return NoEstimate(reason="every job took 0 ms: the clock is too coarse")
    if unseen and count >= FIRST_LOOK and effective < min(FEWEST_EFFECTIVE, count / 2):
        return NoEstimate(reason=_too_dependent(count, effective))
    seen, effective = _moments(numbers, mean, effective, starts, error)
    distance_above = max(mean, max(numbers) - mean)
    below, above = seen.with_unseen_jobs(-mean, distance_above, effective) if unseen else (seen, seen)
    return Estimate(
        value=mean,
        lower=max(0.0, _bound(below, effective, error, side=-1.0)),
        upper=_bound(above, effective, error, side=1.0),
        samples=count,
        effective_samples=effective,
    )


def _moments(
    numbers: Sequence[float], mean: float, effective: float, starts: Sequence[int], error: float
) -> tuple[_Moments, float]:
    """Return the moments for bounds, and of how many samples.

    Of batches, where high and low neighbours balance each other.
    """
    count = len(numbers)
    if effective > count / 2 and (of_batches := batch_moments(numbers, starts, error)):
        return _Moments(mean, *of_batches), float(count)
    deviations = [number - mean for number in numbers]
    squares, cubes = sum(map(mul, deviations, deviations)), sum(map(pow, deviations, repeat(3)))
    return _Moments(mean, squares / count, cubes / count), effective


def _too_dependent(count: int, effective: float) -> str:
    needed = f"a bound needs {min(FEWEST_EFFECTIVE, -(-count // 2))}"
    return f"its {count} samples are correlated and count as {effective:.0f} independent samples; {needed}"


def _bound(moments: _Moments, effective: float, error: float, *, side: float) -> float:
    """Return the bound of a mean on one side; skewness only ever moves it outwards."""
    standard = sqrt(max(0.0, moments.second) / max(1.0, effective - 1.0))
    if standard == 0.0:
        return moments.mean
    quantile = student_quantile(1.0 - error, max(1.0, float(int(effective) - 1)))
    skewness = max(0.0, side * moments.third / sqrt(moments.second) ** 3)
    return moments.mean + side * standard * (quantile + skewness * (1.0 + 2.0 * quantile**2) / (6.0 * sqrt(effective)))


def share_estimate(
    ones: Sequence[float], error: float, times: Sequence[float] = (), starts: Sequence[int] = ()
) -> Estimate | NoEstimate:
    """Estimate the share of ones among zeros and ones: Clopper and Pearson, or as a mean where `batch_moments` gain.

    Args:
        ones: 1 or 0 for each job, in the order in which they were sampled.
        error: the probability, 0..1, that the true share is above the upper bound, and likewise below the lower one.
        times: what the same jobs took: where all ones are alike, these say how far jobs depend on one another.

    Returns:
        The estimate in per cent; or the reason why there is none: no job.
    """
    if not ones:
        return NoEstimate(reason="no job ended")
    share, effective = sum(ones) / len(ones), effective_samples(ones, starts, error)
    if min(ones) == max(ones) and len(times) == len(ones):
        effective = effective_samples(times, starts, error)
    lower, upper = share_interval(share * effective, effective, error=2.0 * error)
    if room := _room_of_batches(ones, effective, starts, error):
        lower, upper, effective = max(0.0, share - room[0]), min(1.0, share + room[1]), float(len(ones))
    return Estimate(
        value=100 * share, lower=100 * lower, upper=100 * upper, samples=len(ones), effective_samples=effective
    )


def _room_of_batches(
    ones: Sequence[float], effective: float, starts: Sequence[int], error: float
) -> tuple[float, float] | None:
    """Return a share's distances (0..1) to its lower and upper bound, as of a mean, if `batch_moments` gain."""
    if effective <= len(ones) / 2 or not (of_batches := batch_moments(ones, starts, error)):
        return None
    share, count = sum(ones) / len(ones), float(len(ones))
    below, above = _Moments(share, *of_batches).with_unseen_jobs(-share, max(share, 1.0 - share), count)
    return share - _bound(below, count, error, side=-1.0), _bound(above, count, error, side=1.0) - share


def _percentile(times: Sequence[float], share: float, error: float, starts: Sequence[int]) -> Estimate | NoEstimate:
    """Order statistics: for every distribution, the number of samples below its percentile is binomial.

    Where `batch_moments` gain, the ranks are as far from it as the bounds of the share of jobs that take no longer are
    from that share (Woodruff 1952).
    """
    count = len(times)
    if count == 0:
        return NoEstimate(reason="no job answered")
    ordered = sorted(times)
    value = ordered[min(count - 1, ceil(share * count) - 1)]
    below = [1.0 if time <= value else 0.0 for time in times]
    effective = effective_samples(below, starts, error)
    lower, upper = _rank_bounds(share, effective, 2.0 * error)
    if room := _room_of_batches(below, effective, starts, error):
        lower, upper = share - room[1], share + room[0]
    return Estimate(
        value=value,
        lower=ordered[ceil(lower * count) - 1] if lower > 0.0 else -inf,
        upper=ordered[ceil(upper * count) - 1] if upper <= 1.0 else inf,
        samples=count,
        effective_samples=effective,
    )


def _rank_bounds(share: float, effective: float, error: float) -> tuple[float, float]:
    """Return ranks, as shares of all samples, that enclose the percentile; 0 or above 1 for too few samples.

    The r-th of n ordered samples has a share of the distribution below it that is Beta(r, n + 1 - r): the least r
    whose share is above the percentile's, and the greatest whose share is below it, each but for half the error.
    """
    whole = max(1, int(effective))

    def below(error: float, rank: int) -> float:
        return beta_quantile(error, rank, whole + 1 - rank)

    ranks = range(1, whole + 1)
    lower = bisect_left(ranks, True, key=lambda rank: below(1.0 - error / 2, rank) > share)
    upper = 1 + bisect_left(ranks, True, key=lambda rank: below(error / 2, rank) >= share)
    return lower / whole, upper / whole


def _mean_response_time(series: Series, _run: Run, error: float, unseen: bool) -> Estimate | NoEstimate:
    return mean_estimate(response_times(series.samples), error, unseen=unseen, starts=_answered_starts(series))


def _success_rate(series: Series, _run: Run, error: float, _unseen: bool) -> Estimate | NoEstimate:
    return share_estimate(successes(series.samples), error, response_times(series.samples), _starts(series))


def _deadline_miss_rate(series: Series, run: Run, error: float, _unseen: bool) -> Estimate | NoEstimate:
    return share_estimate(deadline_misses(series.samples, run), error, response_times(series.samples), _starts(series))


def _maximum_response_time(series: Series, _run: Run, error: float, _unseen: bool) -> Estimate | NoEstimate:
    return _extreme(response_times(series.samples), error, _answered_starts(series), longest=True)


def _minimum_response_time(series: Series, _run: Run, error: float, _unseen: bool) -> Estimate | NoEstimate:
    return _extreme(response_times(series.samples), error, _answered_starts(series), longest=False)


def _extreme(times: Sequence[float], error: float, starts: Sequence[int], *, longest: bool) -> Estimate | NoEstimate:
    """Return the extreme seen; n samples leave a share of 1 - error ** (1 / n) of the jobs possibly beyond it."""
    if not times:
        return NoEstimate(reason="no job answered")
    effective = effective_samples(times, starts, error)
    value = max(times) if longest else min(times)
    return Estimate(
        value=value,
        lower=value if longest else -inf,
        upper=inf if longest else value,
        samples=len(times),
        effective_samples=effective,
        beyond=100 * (1.0 - error ** (1.0 / effective)),
    )


def _jitter(series: Series, _run: Run, error: float, unseen: bool) -> Estimate | NoEstimate:
    """Return the standard deviation.

    The root of a mean, that of the squared deviations, with an unseen job as that has.
    """
    times = response_times(series.samples)
    if len(times) < 3:
        return NoEstimate(reason=f"{counted(len(times), 'job')} answered; jitter with bounds needs three")
    count, mean = len(times), sum(times) / len(times)
    squares = [(time - mean) ** 2 for time in times]
    variance = sum(squares) / count
    starts = _answered_starts(series)
    effective = min(effective_samples(times, starts, error), effective_samples(squares, starts, error))
    if unseen and count >= FIRST_LOOK and effective < min(FEWEST_EFFECTIVE, count / 2):
        return NoEstimate(reason=_too_dependent(count, effective))
    seen = _Moments(
        variance,
        sum((square - variance) ** 2 for square in squares) / count,
        sum((square - variance) ** 3 for square in squares) / count,
    )
    distance_above = max(mean**2, *squares) - variance
    below, above = seen.with_unseen_jobs(-variance, distance_above, effective) if unseen else (seen, seen)
    lower, upper = _bound(below, effective, error, side=-1.0), _bound(above, effective, error, side=1.0)
    return Estimate(
        value=sqrt(variance * count / (count - 1)),
        lower=sqrt(max(0.0, lower)),
        upper=sqrt(max(0.0, upper) * effective / max(1.0, effective - 1.0)),
        samples=count,
        effective_samples=effective,
    )


def _throughput(series: Series, _run: Run, error: float, unseen: bool) -> Estimate | NoEstimate:
    """Divide successes by time: the share of jobs that succeed, times what each counts, by the time of a job.

    A third of the error is spent on each (union bound): where all of 40 jobs succeeded, no spread of what was counted
    shows the one in ten that fails.
    """
    count = len(series.samples)
    if count < 2 or series.elapsed_ms <= 0.0:
        return NoEstimate(reason=f"{count} jobs ended; a throughput with bounds needs two")
    ends = ends_ms(series.samples)
    jobs = columns_of(series.samples).take(sorted(range(count), key=ends.__getitem__))
    ends = sorted(ends)
    times = [later - sooner for sooner, later in zip([0.0, *ends], ends, strict=False)]
    starts = _starts(series)
    share = share_estimate(successes(jobs), error / 3.0, times, starts)
    time = mean_estimate(times, error / 3.0, unseen=unseen, starts=starts)
    gained = _counts_a_success(jobs, error / 3.0, unseen)
    if isinstance(time, NoEstimate):
        return time
    assert isinstance(share, Estimate), "jobs ended, so a share of them succeeded"
    return Estimate(
        value=_PER_SECOND * share.value * gained[1] * count / series.elapsed_ms,
        lower=_PER_SECOND * share.lower * gained[0] / time.upper,
        upper=_PER_SECOND * share.upper * gained[2] / time.lower if time.lower > 0.0 else inf,
        samples=count,
        effective_samples=min(time.effective_samples, share.effective_samples),
    )


def _counts_a_success(jobs: SampleColumns, error: float, unseen: bool) -> tuple[float, float, float]:
    """Return the count of a success, between its bounds; a count by definition is known."""
    counts = list(compress(jobs.counts, jobs.successful)) or jobs.counts.tolist()
    mean = sum(counts) / len(counts)
    if all(count == 1.0 for count in counts):
        return 1.0, 1.0, 1.0
    seen = mean_estimate(counts, error, unseen=unseen)
    return (0.0, mean, inf) if isinstance(seen, NoEstimate) else (seen.lower, mean, seen.upper)


_ESTIMATORS: dict[str, Callable[[Series, Run, float, bool], Estimate | NoEstimate]] = {
    "mean_response_time": _mean_response_time,
    "minimum_response_time": _minimum_response_time,
    "maximum_response_time": _maximum_response_time,
    "jitter": _jitter,
    "success_rate": _success_rate,
    "deadline_miss_rate": _deadline_miss_rate,
    "throughput": _throughput,
}
