"""Verdicts: which there is, and how sequential looks end a setting early."""

from collections.abc import Mapping
from dataclasses import replace

import pytest

from rarms_iac.model.outcomes import (
    Estimate,
    Met,
    Missed,
    TooFewSamples,
    TooManyFailures,
    Unsteady,
    Verdict,
    WithinNoise,
)
from rarms_iac.model.run import Run, SampleCount
from rarms_iac.model.series import MOST_SAMPLES, Sample, Series
from rarms_iac.model.system import Threshold
from rarms_iac.statistics.distributions import ERROR, FIRST_LOOK, next_look, samples_needed
from rarms_iac.statistics.estimates import estimate
from rarms_iac.statistics.verdicts import judge, judge_early, judge_look, samples_to_clear
from tests.builders import a_run, at_least, at_most, milliseconds
from tests.measured import a_series, noisy

RUN = replace(a_run(until=SampleCount(samples=400)), deadline=None)
SERIES = a_series(noisy(1, 100.0, count=400))


def the_early(series: Series, apt: Mapping[str, Threshold], run: Run) -> Verdict | None:
    """Of a setting that has 400 samples at its end."""
    return judge_early(series, apt, run, done=len(series.samples) / 400)


@pytest.mark.parametrize(
    ("limit", "kind"), [("110", Met), ("90", Missed), (str(sum(noisy(1, 100.0, count=400)) / 400), WithinNoise)]
)
def test_a_mean_against_its_threshold(limit: str, kind: type) -> None:
    assert isinstance(judge(SERIES, {"mean_response_time": at_most(limit)}, RUN), kind)


def test_one_missed_index_misses_the_apt() -> None:
    apt: dict[str, Threshold] = {"mean_response_time": at_most(110), "success_rate": at_least(95)}

    assert isinstance(judge(SERIES, apt, RUN), Met)
    assert isinstance(judge(a_series(noisy(1, 100.0), successful=False), apt, RUN), Missed)


def test_a_warm_up_is_left_out() -> None:
    verdict = judge(a_series([500.0] * 20 + noisy(4, 100.0, count=380)), {"mean_response_time": at_most(103)}, RUN)

    assert isinstance(verdict, Met)
    assert 20 <= verdict.warm_up <= 30


def test_more_failures_than_allowed_end_without_a_verdict() -> None:
    broken = replace(
        SERIES,
        samples=(*SERIES.samples, Sample(began_ms=1.0, response_ms=None, successful=False, failure="killed")),
    )

    assert judge(broken, {"mean_response_time": at_most(110)}, RUN) == TooManyFailures(
        component=SERIES.component, failures=("killed",), allowed=0
    )


def test_nothing_measured_gets_no_verdict() -> None:
    assert isinstance(judge(a_series([]), {"mean_response_time": at_most(110)}, RUN), TooFewSamples)


def test_close_setting_goes_on() -> None:
    early = a_series(noisy(1, 100.0, count=FIRST_LOOK))

    assert isinstance(the_early(early, {"mean_response_time": at_most(200)}, RUN), Met)
    assert isinstance(the_early(early, {"mean_response_time": at_most(50)}, RUN), Missed)
    assert the_early(early, {"mean_response_time": at_most(101)}, RUN) is None
    assert the_early(early, {"mean_response_time": at_most(110)}, RUN) is None, "slow jobs may not have been seen"


def test_hopeless_setting_ends_within_noise() -> None:
    half = a_series(noisy(1, 100.0, count=226))
    at_the_mean = {"mean_response_time": at_most(str(sum(noisy(1, 100.0, count=226)) / 226))}

    assert isinstance(the_early(half, at_the_mean, RUN), WithinNoise)
    assert the_early(half, {"mean_response_time": at_most(103)}, RUN) is None


def test_fragile_extreme_is_not_settled() -> None:
    early = a_series(noisy(1, 100.0, count=FIRST_LOOK))

    assert the_early(early, {"maximum_response_time": at_most(200)}, RUN) is None
    assert isinstance(the_early(early, {"maximum_response_time": at_most(100)}, RUN), Missed)
    assert the_early(early, {"minimum_response_time": at_most(50)}, RUN) is None
    assert isinstance(the_early(early, {"minimum_response_time": at_most(99)}, RUN), Met)
    assert isinstance(the_early(SERIES, {"maximum_response_time": at_most(200)}, RUN), Met)


def test_a_setting_that_is_over_has_a_verdict() -> None:
    assert the_early(SERIES, {"mean_response_time": at_most(100)}, RUN) is not None


def test_unsettled_host_gives_no_verdict() -> None:
    unsettled = replace(SERIES, unsettled="it still consumed 1 LP")

    assert judge(unsettled, {"mean_response_time": at_most(200)}, RUN) == Unsteady(reason="it still consumed 1 LP")


SLOWER = [*noisy(1, 100.0, count=130), *noisy(2, 140.0, count=140), *noisy(3, 110.0, count=130)]
"""Jobs of a machine that was slower for a while."""


def wandering(times: list[float]) -> Series:
    return replace(a_series(times), wanders=True)


@pytest.mark.parametrize(("limit", "kind"), [("300", Met), ("40", Missed), ("120", WithinNoise)])
def test_temporary_slowness_allows_clear_verdicts(limit: str, kind: type) -> None:
    apt: dict[str, Threshold] = {"mean_response_time": at_most(limit)}

    assert not isinstance(judge(a_series(SLOWER), apt, RUN), Met | Missed)
    assert isinstance(judge(wandering(SLOWER), apt, RUN), kind)


def test_rate_of_slow_machine_covers_quarters() -> None:
    verdict = judge(wandering(SLOWER), {"throughput": at_least(1)}, RUN)

    assert isinstance(verdict, Met)
    assert verdict.judged[0].estimate.value == pytest.approx(1000 / 116, rel=0.05)


def test_equal_quarters_are_no_surer() -> None:
    series, apt = wandering(SLOWER), {"success_rate": at_least(1)}
    whole = estimate("success_rate", series, RUN, error=ERROR)

    verdict = judge(series, apt, RUN)

    assert isinstance(whole, Estimate)
    assert isinstance(verdict, Met)
    assert verdict.judged[0].estimate.lower == whole.lower < 100


def test_maximum_covers_the_whole_series() -> None:
    apt: dict[str, Threshold] = {"maximum_response_time": at_most(300)}

    assert judge(wandering(SLOWER), apt, RUN) == judge(a_series(SLOWER), apt, RUN)


def test_doubling_trend_has_no_verdict() -> None:
    rising = [time * (1 + number / 100) for number, time in enumerate(noisy(1, 100.0))]
    apt: dict[str, Threshold] = {"mean_response_time": at_most("100000")}

    assert isinstance(judge(wandering(rising), apt, RUN), Unsteady)


def test_slight_trend_has_wide_bounds() -> None:
    rising = [time * (1 + number / 800) for number, time in enumerate(noisy(1, 100.0, count=400))]

    near, far = ({"mean_response_time": at_most(limit)} for limit in (150, 300))

    assert isinstance(judge(a_series(rising), far, RUN), Unsteady)
    assert isinstance(judge(wandering(rising), near, RUN), WithinNoise)
    assert isinstance(judge(wandering(rising), far, RUN), Met)


def test_few_samples_have_no_quarters() -> None:
    few = [100.0] * 20 + [140.0] * 15
    apt: dict[str, Threshold] = {"mean_response_time": at_most("200")}

    assert judge(wandering(few), apt, RUN) == judge(a_series(few), apt, RUN)
    assert judge(replace(SERIES, wanders=True), apt, RUN) == judge(SERIES, apt, RUN)


def test_one_miss_needs_more_evidence() -> None:
    times = noisy(1, 100.0, count=400)
    alone = {"mean_response_time": at_most("99")}
    while not isinstance(judge(a_series(times), alone, RUN), Missed):
        times = [time + 0.05 for time in times]
    with_others: dict[str, Threshold] = {**alone, "success_rate": at_least(1), "p50_response_time": at_most(1000)}

    assert isinstance(judge(a_series(times), with_others, RUN), WithinNoise)


def test_looks_grow_apart() -> None:
    looks = [next_look(0)]
    while len(looks) < 5:
        looks.append(next_look(looks[-1]))

    assert looks == [40, 57, 80, 113, 160]


@pytest.mark.parametrize(
    ("index", "threshold", "needed"),
    [
        ("p99_response_time", at_most(100), 833),
        ("success_rate", at_least(99), 833),
        ("deadline_miss_rate", at_most(5), 164),
        ("mean_response_time", at_most(100), FIRST_LOOK),
        ("p50_response_time", at_most(100), FIRST_LOOK),
    ],
)
def test_needed_samples_if_every_job_is_good(index: str, threshold: Threshold, needed: int) -> None:
    def verdict(count: int) -> Verdict:
        return judge_look(a_series([50.0] * count), {index: threshold}, replace(RUN, deadline=milliseconds("1 s")))

    assert samples_needed(index, threshold) == needed
    assert isinstance(verdict(needed), Met)
    if needed > FIRST_LOOK:
        assert not isinstance(verdict(needed - 1), Met)


def test_success_rate_of_all_jobs_is_never_shown() -> None:
    assert samples_needed("success_rate", at_least(100)) > MOST_SAMPLES


def test_impossible_number_of_good_samples_ends() -> None:
    apt: dict[str, Threshold] = {"p99_response_time": at_most(400)}
    series = a_series(noisy(3, 100.0, variation=0.1, correlation=0.0, count=200))
    verdict = judge_look(series, apt, RUN)

    assert isinstance(verdict, WithinNoise)
    assert samples_to_clear(verdict.judged[0], series) == pytest.approx(833)
    assert judge_early(series, apt, RUN, done=0.1, most_samples=832) == verdict
    assert judge_early(series, apt, RUN, done=0.1, most_samples=833) is None


@pytest.mark.parametrize(("index", "limit"), [("mean_response_time", 102), ("p90_response_time", 122)])
def test_predicted_samples_make_it_clear(index: str, limit: int) -> None:
    apt: dict[str, Threshold] = {index: at_most(limit)}
    times = noisy(5, 100.0, variation=0.15, correlation=0.0, count=20_000)
    few = a_series(times[:400])
    verdict = judge_look(few, apt, RUN)

    assert isinstance(verdict, WithinNoise)
    count = samples_to_clear(verdict.judged[0], few)
    assert count is not None
    assert 400 < count < 10_000
    assert isinstance(judge_look(a_series(times[: int(2 * count)]), apt, RUN), Met)


@pytest.mark.parametrize(
    ("apt", "count"),
    [
        ({"p99_response_time": at_most(200)}, samples_needed("p99_response_time", at_most(200))),
        ({"success_rate": at_least(99)}, samples_needed("success_rate", at_least(99))),
        ({"p50_response_time": at_most(90), "p99_response_time": at_most(200)}, None),
    ],
)
def test_too_few_good_samples_say_how_many(apt: dict[str, Threshold], count: int | None) -> None:
    few = a_series(noisy(5, 100.0, variation=0.05, correlation=0.0, count=300))
    verdict = judge_look(few, apt, RUN)

    if count is None:
        assert isinstance(verdict, Missed)
        return
    assert isinstance(verdict, WithinNoise)
    assert samples_to_clear(verdict.judged[0], few) == pytest.approx(count, rel=0.3)
