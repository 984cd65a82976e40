"""Estimates: values by hand, and bounds that hold as often as they say."""

import random
from collections.abc import Callable
from dataclasses import replace
from math import inf, sqrt
from statistics import pstdev

import pytest

from rarms_iac.model.indexes import INDEXES
from rarms_iac.model.outcomes import Estimate, Met, NoEstimate, Unsteady, WithinNoise
from rarms_iac.model.series import Series
from rarms_iac.statistics.distributions import (
    LOOK_ERROR,
    PERIODIC_STARTS,
    beta_quantile,
    share_below,
    share_interval,
    student_quantile,
)
from rarms_iac.statistics.estimates import estimate, mean_estimate
from rarms_iac.statistics.samples import effective_samples
from rarms_iac.statistics.steady_state import find_steady_part
from rarms_iac.statistics.verdicts import judge_look
from tests.builders import a_run, at_most
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


def test_correlated_samples_count_for_less() -> None:
    free = found("mean_response_time", a_series(noisy(1, 100.0)))
    bound = found("mean_response_time", a_series(noisy(1, 100.0, correlation=0.5)))

    assert free.samples == bound.samples == 400
    assert 300 < free.effective_samples <= 400
    assert 80 < bound.effective_samples < 200


@pytest.mark.parametrize("starts", [(), tuple(range(100, 2000, 100))])
def test_compensating_jobs_are_known_by_batches(starts: tuple[int, ...]) -> None:
    """Nine of ten take 3 ms, and the tenth waits for the next window; a drawn order is worth no more than its jobs."""
    window = [*[3.0] * 9, 23.0]
    drawn = random.Random(1).sample(window * 200, k=2000)

    regular, independent = (
        found("mean_response_time", replace(a_series(times), starts=starts)) for times in (window * 200, drawn)
    )

    assert regular.lower < 5.0 < regular.upper
    assert regular.upper - regular.lower < (independent.upper - independent.lower) / 4
    assert regular.effective_samples == regular.samples


@pytest.mark.parametrize("starts", [(), tuple(range(100, 8000, 100))])
def test_compensating_percentile_is_known_by_batches(starts: tuple[int, ...]) -> None:
    """One of 21 waits for the next window, so that 95 % do not: by a drawn order 8,000 jobs do not tell."""
    window = [*[3.0] * 20, 23.0]
    times = (window * 381)[:8000]
    drawn = random.Random(1).sample(times, k=len(times))

    regular, independent = (
        found("p95_response_time", replace(a_series(each), starts=starts), error=LOOK_ERROR) for each in (times, drawn)
    )

    assert (regular.lower, regular.value, regular.upper) == (3.0, 3.0, 3.0)
    assert independent.upper == 23.0


@pytest.mark.parametrize(
    ("index", "bounds"),
    [
        ("mean_response_time", lambda times: sum(times) / len(times)),
        ("p90_response_time", lambda times: sorted(times)[round(0.9 * len(times))]),
        ("jitter", pstdev),
        ("deadline_miss_rate", lambda times: 100 * sum(time > 4.0 for time in times) / len(times)),
    ],
)
def test_few_starts_allow_for_worst_phase(index: str, bounds: Callable[[list[float]], float]) -> None:
    """All starts had phases with 3 ms; a share of starts that eight miss has one in which each job takes 50 ms."""
    periodic = a_run(every="100 ms", deadline="4 ms")
    missed = 1.0 - LOOK_ERROR ** (1 / 8)
    series = a_series([3.0 + 0.1 * (number % 3) for number in range(800)])
    series = replace(series, starts=tuple(range(100, 800, 100)))
    truth = bounds([3.1] * round(1000 * (1.0 - missed)) + [50.0] * round(1000 * missed))

    few = estimate(index, series, periodic)
    many = estimate(index, replace(series, starts=tuple(range(20, 20 * PERIODIC_STARTS, 20))), periodic)

    assert isinstance(few, Estimate)
    assert isinstance(many, Estimate)
    assert few.lower <= truth <= few.upper
    assert not many.lower <= truth <= many.upper


def test_few_starts_leave_harmless_threshold_met() -> None:
    periodic = a_run(every="7500 ms")
    series = replace(a_series([3.0] * 80), starts=tuple(range(10, 80, 10)))

    assert isinstance(judge_look(series, {"mean_response_time": at_most(100_000_000)}, periodic), Met)
    assert isinstance(judge_look(series, {"mean_response_time": at_most(4)}, periodic), WithinNoise)


def test_high_percentile_of_few_has_no_bound() -> None:
    few = found("p99_response_time", a_series([float(time) for time in range(50)]))

    assert (few.value, few.upper) == (49.0, inf)


@pytest.mark.parametrize(("count", "bounds"), [(9, (-inf, inf)), (10, (1.0, 9.0))])
def test_extremes_bound_a_median(count: int, bounds: tuple[float, float]) -> None:
    times = [float(number if number % 2 else count - 1 - number) for number in range(count)]  # neighbours on both sides

    median = found("p50_response_time", a_series(times), error=0.001)  # 0.5 ** 10 is less, and 0.5 ** 9 is more

    assert (median.lower, median.upper) == bounds


def test_maximum_says_the_possible_share() -> None:
    longest = found("maximum_response_time", a_series(noisy(3, 100.0, count=299)))

    assert longest.beyond is not None
    assert 0.9 < longest.beyond < 1.3  # the rule of three: about 3 / 299


def test_failureless_throughput_leaves_room() -> None:
    jobs = found("throughput", a_series([100.0] * 40), error=0.02)

    assert jobs.value == pytest.approx(10.0)
    assert jobs.lower < 10.0 * (0.02 / 3) ** (1 / 40)
    assert jobs.lower < 9.0, "one in ten may fail: 40 successes would be no wonder"


def test_clear_throughput_is_known_at_once() -> None:
    assert found("throughput", a_series(noisy(1, 32.0, count=40)), error=0.0006).lower > 16.0


def test_failed_throughput_has_an_upper_bound() -> None:
    none = found("throughput", a_series(noisy(1, 100.0, count=40), successful=False))

    assert (none.value, none.lower) == (0.0, 0.0)
    assert 0.5 < none.upper < 2.0


def test_counts_weigh_in_a_throughput() -> None:
    series = a_series(noisy(1, 100.0))
    frames = replace(series, samples=tuple(replace(sample, count=3.0) for sample in series.samples))

    assert found("throughput", frames).lower == pytest.approx(3 * found("throughput", series).lower, rel=0.03)


@pytest.mark.parametrize("seen", [0, 1, 2, 5, 10])
def test_mean_has_room_for_rare_slow_jobs(seen: int) -> None:
    """Garwood's bound of a Poisson count: of so many seen, so many more may have been meant, but for 1 %."""
    meant = {0: 4.61, 1: 6.64, 2: 8.41, 5: 13.11, 10: 20.14}[seen]
    bounds = found("mean_response_time", a_series(spread_out(seen, 400)), error=0.01)

    assert 100 * (1 + meant / 400) <= bounds.upper <= 100 * (1 + 1.25 * meant / 400)


def test_equal_times_have_room_for_zero() -> None:
    alike = found("mean_response_time", a_series([100.0] * 400), error=0.01)

    assert alike.lower == pytest.approx(200 - alike.upper)


def test_clock_too_coarse_for_jobs_gives_no_mean() -> None:
    assert isinstance(estimate("mean_response_time", a_series([0.0] * 400), RUN), NoEstimate)


def test_weak_samples_give_a_reason() -> None:
    answer = estimate("mean_response_time", a_series(noisy(1, 100.0, count=100, correlation=0.9)), RUN)

    assert isinstance(answer, NoEstimate)
    assert "samples are correlated" in answer.reason


def test_without_unseen_jobs_samples_decide() -> None:
    alike = estimate("mean_response_time", a_series([100.0] * 40), RUN, unseen=False)

    assert isinstance(alike, Estimate)
    assert (alike.lower, alike.upper) == (100.0, 100.0)


def test_guess_of_samples_alone_takes_their_variance_whole() -> None:
    """Student's t of two samples: their standard error is half their distance."""
    pair = estimate("mean_response_time", a_series([100.0, 102.0]), RUN, error=0.25, unseen=False)

    assert isinstance(pair, Estimate)
    assert (pair.lower, pair.upper) == pytest.approx((100.0, 102.0))


def test_a_guess_of_jitter_takes_the_samples_alone() -> None:
    """Their squared deviations are 1 and 9 ms, so these vary by 16 around 5."""
    even = estimate("jitter", a_series([97.0, 99.0, 103.0, 101.0] * 2), RUN, error=0.25, unseen=False)

    assert isinstance(even, Estimate)
    worth = even.effective_samples
    half_width = student_quantile(0.75, int(worth) - 1.0) * sqrt(16 / (worth - 1.0))
    assert even.lower**2 == pytest.approx(5 - half_width)


def test_jitter_of_rare_jobs_is_uncertain() -> None:
    """Their number is Poisson's: one seen may be 5.6, or hardly any."""
    rare = found("jitter", a_series([*[100.0] * 199, 200.0, *[100.0] * 200]))

    assert rare.lower == 0.0
    assert rare.upper > 2.1 * rare.value


def spread_out(slow: int, count: int) -> list[float]:
    """Jobs of 100 ms, so many of them twice as slow, evenly far from one another."""
    places = {round((at + 0.5) * count / slow) for at in range(slow)} if slow else set()
    return [200.0 if number in places else 100.0 for number in range(count)]


def test_mean_has_room_towards_its_tail() -> None:
    rare = found("mean_response_time", a_series([*[100.0] * 30, 200.0, *[100.0] * 30]))

    assert rare.upper - rare.value > 1.2 * (rare.value - rare.lower)


def starts_at(levels: list[float], each: int) -> tuple[list[float], list[int]]:
    """Starts of so many jobs, each at its level, give or take a thousandth; and where they begin."""
    times = [time for number, level in enumerate(levels) for time in noisy(number, level, variation=0.001, count=each)]
    return times, [each * number for number in range(1, len(levels))]


def test_starts_that_differ_are_the_samples() -> None:
    """A component that locks into one phase of its load for a start shows as many samples as there are starts."""
    locked, starts = starts_at([100.0, 110.0] * 20, each=50)
    alike, _ = starts_at([100.0] * 40, each=50)

    assert effective_samples(alike, starts) == pytest.approx(2000, rel=0.2)
    assert 20 < effective_samples(locked, starts) <= 40


def test_few_starts_that_differ_give_no_bound() -> None:
    locked, starts = starts_at([100.0, 110.0, 100.0, 105.0, 110.0, 100.0, 105.0, 110.0], each=100)

    assert isinstance(mean_estimate(locked, 0.001, starts=starts), NoEstimate)
    assert isinstance(mean_estimate(locked[:100], 0.001), Estimate)


@pytest.mark.parametrize(
    ("probability", "freedom", "value"),
    [(0.975, 1, 12.706), (0.975, 10, 2.228), (0.995, 30, 2.750), (0.95, 120, 1.658), (0.025, 10, -2.228)],
)
def test_student(probability: float, freedom: float, value: float) -> None:
    assert student_quantile(probability, freedom) == pytest.approx(value, abs=0.001)


def test_student_without_freedom_knows_nothing() -> None:
    assert student_quantile(0.975, 0.0) == inf


def test_beta_is_uniform_with_ones() -> None:
    assert share_below(0.3, 1.0, 1.0) == pytest.approx(0.3)
    assert beta_quantile(0.3, 1.0, 1.0) == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("successes", "trials", "bounds"), [(0, 10, (0.0, 0.3085)), (5, 10, (0.1871, 0.8129)), (10, 10, (0.6915, 1.0))]
)
def test_clopper_and_pearson(successes: float, trials: float, bounds: tuple[float, float]) -> None:
    assert share_interval(successes, trials, error=0.05) == pytest.approx(bounds, abs=0.0001)


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_steady_series_are_hardly_ever_refused(correlation: float) -> None:
    tries = examples(100)
    refused = sum(
        isinstance(find_steady_part(noisy(seed, 100.0, variation=0.15, correlation=correlation, count=400)), Unsteady)
        for seed in range(tries)
    )

    assert refused <= 0.02 * tries + 3 * (0.02 * 0.98 * tries) ** 0.5


def test_a_warm_up_is_cut_off() -> None:
    found = find_steady_part([300.0] * 30 + noisy(4, 100.0, count=970))

    assert isinstance(found, int)
    assert 30 <= found <= 60


def test_a_series_that_never_varies_is_steady() -> None:
    assert find_steady_part([7.0] * 500) == 0
