"""Estimates: values by hand, and bounds that hold as often as they say."""

from dataclasses import replace
from math import inf

import pytest

from rarms_iac.model.indexes import INDEXES
from rarms_iac.model.measurement import Series
from rarms_iac.statistics.estimates import Estimate, NoEstimate, estimate
from tests.builders import a_run
from tests.effort import examples
from tests.measured import a_series, noisy

RUN = replace(a_run(), deadline=None)


def found(index: str, series: Series, error: float = 0.05) -> Estimate:
    answer = estimate(index, series, RUN, error=error)
    assert isinstance(answer, Estimate)
    return answer


@pytest.mark.parametrize(
    ("index", "value"),
    [
        ("mean_response_time", 25.0),
        ("minimum_response_time", 10.0),
        ("maximum_response_time", 40.0),
        ("p50_response_time", 20.0),
        ("p75_response_time", 30.0),
        ("success_rate", 80.0),
        ("deadline_miss_rate", 20.0),
        ("throughput", 4 / 101 * 1000),
    ],
)
def test_five_jobs_one_of_them_without_an_answer(index: str, value: float) -> None:
    assert found(index, a_series([10.0, 20.0, None, 30.0, 40.0])).value == pytest.approx(value)


def test_jitter_is_the_standard_deviation() -> None:
    assert found("jitter", a_series([1.0, 2.0, 3.0, 4.0])).value == pytest.approx(1.2909944)


@pytest.mark.parametrize("index", [*INDEXES, "p95_response_time"])
def test_nothing_measured_gives_no_estimate(index: str) -> None:
    assert isinstance(estimate(index, a_series([]), RUN), NoEstimate)


@pytest.mark.parametrize("correlation", [0.0, 0.5])
def test_bounds_of_a_mean_are_wrong_no_more_often_than_they_say(correlation: float) -> None:
    tries = examples(300)
    wrong = 0
    for seed in range(tries):
        bounds = found("mean_response_time", a_series(noisy(seed, 100.0, variation=0.15, correlation=correlation)))
        wrong += not bounds.lower <= 100.0 <= bounds.upper

    assert wrong <= 0.05 * tries + 3 * (0.05 * 0.95 * tries) ** 0.5


def test_correlated_samples_count_for_less() -> None:
    free = found("mean_response_time", a_series(noisy(1, 100.0)))
    bound = found("mean_response_time", a_series(noisy(1, 100.0, correlation=0.5)))

    assert free.samples == bound.samples == 400
    assert 300 < free.effective_samples <= 400
    assert 80 < bound.effective_samples < 200


def test_a_high_percentile_of_few_samples_has_no_upper_bound() -> None:
    few = found("p99_response_time", a_series([float(time) for time in range(50)]))

    assert (few.value, few.upper) == (49.0, inf)


def test_a_maximum_says_which_share_of_jobs_may_be_longer() -> None:
    longest = found("maximum_response_time", a_series(noisy(3, 100.0, count=299)))

    assert longest.beyond is not None
    assert 0.9 < longest.beyond < 1.3  # the rule of three: about 3 / 299
