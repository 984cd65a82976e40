"""The numbers in the samples of a series, and how many independent ones they are worth."""

from collections.abc import Sequence
from itertools import pairwise
from math import inf, isnan, sqrt
from operator import mul
from statistics import NormalDist

from rarms_iac.model.run import Run
from rarms_iac.model.series import Sample, Series, columns_of
from rarms_iac.statistics.distributions import LOOK_ERROR, student_quantile

_LONGEST_LAG = 4  # a share of the samples: 1/4


def response_times(samples: Sequence[Sample]) -> list[float]:
    """List the response times of all jobs that answered.

    Args:
        samples: in the order in which the jobs began.

    Returns:
        Times in ms, in the same order; jobs without an answer are left out.
    """
    times = columns_of(samples).response_ms.tolist()
    # NOTE: their sum shows whether there are jobs without an answer (no number), which is far quicker than to look.
    return [time for time in times if not isnan(time)] if isnan(sum(times)) else times


def successes(samples: Sequence[Sample]) -> list[float]:
    """Mark the jobs that succeeded.

    Args:
        samples: in the order in which the jobs began.

    Returns:
        1 for a job that succeeded and 0 for every other, in the same order.
    """
    return list(map(float, columns_of(samples).successful))


def deadline_misses(samples: Sequence[Sample], run: Run) -> list[float]:
    """Mark the jobs that missed their deadline.

    Args:
        samples: in the order in which the jobs began.
        run: has the deadline in ms; without one only a missing answer is a miss.

    Returns:
        1 for a job that answered late or not at all and 0 for every other, in the same order.
    """
    deadline = inf if run.deadline is None else float(run.deadline)
    # NOTE: a missing answer is not a number, which is not within any deadline.
    return [0.0 if time <= deadline else 1.0 for time in columns_of(samples).response_ms]


def ends_ms(samples: Sequence[Sample]) -> list[float]:
    """Say when each job was over.

    Returns:
        Milliseconds since the setting began, in the same order; for a job without an answer, when it began.
    """
    columns = columns_of(samples)
    return [
        began + (0.0 if isnan(time) else time)
        for began, time in zip(columns.began_ms, columns.response_ms, strict=True)
    ]


def failures(series: Series) -> tuple[str, ...]:
    """List why samples failed: death of the component, time-out, an unreadable answer.

    Args:
        series: the samples of one component at one setting.

    Returns:
        A sentence for each failed sample, in order.
    """
    return tuple(columns_of(series.samples).failures.values())


def effective_samples(values: Sequence[float], starts: Sequence[int] = (), error: float = LOOK_ERROR) -> float:
    """Count the independent samples that would know the mean as well: n / (1 + 2 * sum of autocorrelations).

    The sum ends where neighbouring pairs of autocorrelations stop being positive (Geyer's initial positive sequence);
    it is never less than what a first-order process of the same, bias-corrected, first autocorrelation has. Negative
    correlation is not a gain here (`batch_moments`). Where the starts of a series differ by more than the values within
    them explain, the starts are the samples (batch means; Student's t with their number).

    Args:
        values: in the order in which they were sampled, of any unit.
        starts: the numbers of the values with which something began again, ascending; the first start is at 0.
        error: the probability, 0..1, of a bound from so many starts: few starts widen it as Student's t does.

    Returns:
        1 to n, not necessarily whole; n where all values are alike or there are fewer than three.
    """
    bounds = _bounds(values, starts)
    worth = _of_a_stretch(values)
    return worth if len(bounds) < 3 else _of_starts(values, bounds, error) or worth


def starts_differ(values: Sequence[float], starts: Sequence[int]) -> bool:
    """Tell whether starts differ by more than the values within them explain.

    Returns:
        False where there is but one start.
    """
    bounds = _bounds(values, starts)
    return len(bounds) > 2 and _of_starts(values, bounds, LOOK_ERROR) is not None


def batch_moments(values: Sequence[float], starts: Sequence[int], error: float) -> tuple[float, float] | None:
    """Find what a mean gains from values that make up for one another, as short jobs do within a scheduler's window.

    In each window a job waits until the next one, and the others do not: their times differ, and their sum hardly does.
    So means of batches, whole starts or equal parts of a series, differ less than independent values would. How much
    they differ counts where chance would make it so little in 0.1 % of series, and neighbours are no more alike than
    others (batch means: Schmeiser 1982, who advises 10 to 30).

    Args:
        values: as of `effective_samples`, which finds no positive correlation in them.

    Returns:
        The second and third central moment that as many independent values would have; the second is widened as
            Student's t with the number of batches is. None: nothing is gained, or there are too few batches.
    """
    bounds = _batches(values, starts)
    count, many = len(values), len(bounds) - 1
    if many < _FEWEST_BATCHES:
        return None
    mean = sum(values) / count
    sums = [sum(values[begin:end]) - (end - begin) * mean for begin, end in pairwise(bounds)]
    of_batches = sum(each * each / (end - begin) for each, (begin, end) in zip(sums, pairwise(bounds), strict=True))
    variance = sum((value - mean) ** 2 for value in values) / (count - 1)
    if of_batches / (many - 1) > variance * _chi_squared_share(many - 1, -_BATCHES_UNLIKE_CHANCE):
        return None
    if sum(map(mul, sums, sums[1:])) > _NEIGHBOURS_ALIKE / sqrt(many) * sum(map(mul, sums, sums)):
        return None
    wider = student_quantile(1.0 - error, many - 1.0) / -NormalDist().inv_cdf(error)
    second = of_batches / (many - 1) * wider**2
    return (second, sum(each**3 for each in sums) / count) if second < variance else None


_BATCHES, _FEWEST_BATCHES, _SHORTEST_BATCH = 30, 8, 10
_BATCHES_UNLIKE_CHANCE = 3.09
_NEIGHBOURS_ALIKE = 2.33


def _bounds(values: Sequence[float], starts: Sequence[int]) -> list[int]:
    return [0, *(start for start in starts if 0 < start < len(values)), len(values)]


def _batches(values: Sequence[float], starts: Sequence[int]) -> list[int]:
    """Cut values into at most `_BATCHES` of about equal length, where there are starts at these alone."""
    count = len(values)
    length = max(_SHORTEST_BATCH, -(-count // _BATCHES))
    cuts = _bounds(values, starts)[1:-1] or range(length, count, length)
    bounds = [0]
    for cut in cuts:
        if length <= cut - bounds[-1] and length <= count - cut:
            bounds.append(cut)
    return [*bounds, count]


def _chi_squared_share(free: int, deviations: float) -> float:
    """Return chi squared by degrees of freedom, so many deviations from the middle (Wilson, Hilferty 1931)."""
    step = 2.0 / (9.0 * free)
    return max(0.0, 1.0 - step + deviations * sqrt(step)) ** 3


_STARTS_ALIKE = 2.33
"""Starts differ where so great a difference has a probability of 1 % by chance, in deviations."""


def _of_starts(values: Sequence[float], bounds: Sequence[int], error: float) -> float | None:
    """Return the worth of starts that differ; None: they are alike."""
    parts = [values[begin:end] for begin, end in pairwise(bounds) if end > begin]
    count, many = len(values), len(parts)
    mean, means = sum(values) / count, [sum(part) / len(part) for part in parts]
    between = sum(len(part) * (own - mean) ** 2 for part, own in zip(parts, means, strict=True)) / (many - 1)
    within = [value - own for part, own in zip(parts, means, strict=True) for value in part]
    squares = sum(map(mul, within, within))
    free = max(1, count - many)
    expected = squares / free * len(within) / _of_a_stretch(within)
    if between <= expected * _chi_squared_share(many - 1, _STARTS_ALIKE):
        return None
    total = sum((value - mean) ** 2 for value in values) / count
    of_mean = sum((len(part) * (own - mean)) ** 2 for part, own in zip(parts, means, strict=True)) / count**2
    wider = student_quantile(1.0 - error, many - 1.0) / -NormalDist().inv_cdf(error)
    return min(float(count), max(1.0, total / (of_mean * many / (many - 1)) / wider**2))


def _of_a_stretch(values: Sequence[float]) -> float:
    """Return the effective number of values that were sampled in one run."""
    count = len(values)
    if count < 3:
        return float(count)
    mean = sum(values) / count
    deviations = [value - mean for value in values]
    variance = sum(map(mul, deviations, deviations))
    if variance <= 1e-18 * max(1.0, mean * mean) * count:
        return float(count)
    neighbours = sum(map(mul, deviations, deviations[1:]))
    first = neighbours / variance
    time = max(_initial_positive(deviations, variance, neighbours), _first_order(first, count), 1.0)
    return max(1.0, count / time)


def _initial_positive(deviations: Sequence[float], variance: float, neighbours: float) -> float:
    """Return the integrated autocorrelation time by pairs of lags (2k, 2k + 1) while their sum is positive and falls.

    Args:
        variance: the sum of their squares, which is the product at lag 0.
        neighbours: the sum of the products at lag 1.
    """
    if len(deviations) < _LONGEST_LAG:
        return -1.0
    pairs = last = (variance + neighbours) / variance
    for lag in range(2, len(deviations) // _LONGEST_LAG, 2):
        pair = sum(sum(map(mul, deviations, deviations[shift:])) for shift in (lag, lag + 1)) / variance
        pair = min(pair, last)
        # Noise about zero ends the sum: a smaller sum cannot be distinguished from no correlation.
        if pair <= 2.0 / len(deviations) ** 0.5:
            break
        pairs, last = pairs + pair, pair
    return 2.0 * pairs - 1.0


def _first_order(first: float, count: int) -> float:
    """Return the integrated autocorrelation time of a first-order autoregressive process with this autocorrelation.

    Short series show their correlation too small; that is corrected (Kendall).
    """
    corrected = min(0.98, first + (1.0 + 3.0 * first) / count)
    return (1.0 + corrected) / (1.0 - corrected)
