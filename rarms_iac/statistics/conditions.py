"""What a threshold that is met takes for granted of jobs that no sample showed.

No bound of a mean holds for every distribution: a slow job may be too rare to be in the samples, and yet weigh much.
So each kind of job is allowed for that so many samples may have missed with a probability of `ERROR`: ln(1 / ERROR)
of them in as many jobs as there were. A mean allows for slow ones, a share of jobs for runs of bad ones. Where the
threshold leaves no room for them, it is met on a condition.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import groupby
from math import ceil, log, sqrt
from typing import Final

from rarms_iac.model.indexes import percentile_of
from rarms_iac.model.outcomes import Condition, Estimate, JudgedIndex, NoEstimate, RareRuns, RareSlowJobs
from rarms_iac.model.run import Run
from rarms_iac.model.series import MOST_SAMPLES, Series
from rarms_iac.statistics.distributions import ERROR, LOOK_ERROR
from rarms_iac.statistics.estimates import share_estimate
from rarms_iac.statistics.samples import deadline_misses, response_times, successes

UNSEEN: Final = log(1.0 / ERROR)
"""Events, 4.6, that n jobs may have on average, and yet none in n jobs with a probability of `ERROR`."""

SHORTEST_RUN: Final = 5
"""Bad jobs in a row that are allowed for, however short the runs were that the samples showed."""


def conditions_of(
    judged: Iterable[JudgedIndex], series: Series, run: Run, slow_job: float, *, samples: float | None = None
) -> tuple[Condition, ...]:
    """Return the conditions on which thresholds are met.

    Args:
        judged: Indexes of one component that meet their thresholds.
        series: All samples that they were judged by.
        slow_job: How many times the mean a slow job takes at most; 1: nothing is allowed for.
        samples: What is to be expected with so many samples, no fewer than there are. None: as many as there are.

    Returns:
        At most one for each index, in their order; none where the samples leave room for what they did not show. An
        extreme has none: it is met so far (`Estimate.beyond`).
    """
    if slow_job <= 1.0:
        return ()
    found = (_condition(each, series, run, slow_job, samples or len(series.samples)) for each in judged)
    return tuple(condition for condition in found if condition is not None)


def more_samples_lift(
    judged: Iterable[JudgedIndex], series: Series, run: Run, slow_job: float, *, samples: float
) -> bool:
    """Return whether a threshold is met on a condition that it would not have with so many samples like these.

    Args:
        samples: As many as there may be in the end, no fewer than there are; no setting has over `MOST_SAMPLES`.
    """
    judged = tuple(judged)
    if not (now := conditions_of(judged, series, run, slow_job)):
        return False
    return len(conditions_of(judged, series, run, slow_job, samples=min(samples, MOST_SAMPLES))) < len(now)


def _condition(judged: JudgedIndex, series: Series, run: Run, slow_job: float, samples: float) -> Condition | None:
    estimate, limit, times = judged.estimate, float(judged.threshold.value), response_times(series.samples)
    seen = _expected(estimate, samples * estimate.samples / max(1, len(series.samples)))
    mean = sum(times) / max(1, len(times))
    if seen.beyond is not None:
        return None
    if (percentile := percentile_of(judged.index)) is not None:
        beyond = [float(time > limit) for time in times]
        return _of_share(series.component, judged.index, beyond, 1.0 - float(percentile) / 100, samples)
    match judged.index:
        case "success_rate":
            failed = [1.0 - success for success in successes(series.samples)]
            return _of_share(series.component, judged.index, failed, 1.0 - limit / 100, samples)
        case "deadline_miss_rate":
            missed = deadline_misses(series.samples, run)
            return _of_share(series.component, judged.index, missed, limit / 100, samples)
        case "jitter":
            weight, room = (slow_job * mean) ** 2, limit**2 - seen.upper**2
        case "throughput":
            weight, room = slow_job, seen.lower / limit - 1.0
        case _:
            weight, room = slow_job * mean, limit - seen.upper
    if UNSEEN * weight <= room * seen.samples:
        return None
    slowest = max(times, default=0.0)
    return RareSlowJobs(
        component=series.component, index=judged.index, slower_than_ms=slowest, once_in=_once_in(weight, room)
    )


def _of_share(component: str, index: str, bad: Sequence[float], most: float, samples: float) -> Condition | None:
    """Return the condition of a share of bad jobs, which is at most so much of all, 0..1."""
    seen = share_estimate(bad, LOOK_ERROR)
    if isinstance(seen, NoEstimate):
        return None
    room = most - _expected(seen, samples).upper / 100
    longest = max((len(list(jobs)) for is_bad, jobs in groupby(bad) if is_bad), default=0)
    length = max(SHORTEST_RUN, longest)
    if UNSEEN * length <= room * samples:
        return None
    return RareRuns(component=component, index=index, jobs=length, once_in=_once_in(length, room))


def _expected(seen: Estimate, samples: float) -> Estimate:
    """Return the estimate of so many samples that are like these: bounds shrink as the root of their number."""
    shrinks = sqrt(min(1.0, seen.samples / max(1.0, samples)))
    lower, upper = (seen.value + (bound - seen.value) * shrinks for bound in (seen.lower, seen.upper))
    return replace(seen, lower=lower, upper=upper, samples=max(seen.samples, int(samples)))


_MOST_JOBS: Final = 1_000_000_000
"""More than any component runs: stands for a threshold without room."""


def _once_in(weight: float, room: float) -> int:
    return ceil(min(_MOST_JOBS, weight / room)) if room > 0.0 else _MOST_JOBS
