"""Overload: a periodic component that falls behind misses by arithmetic, and one that keeps up never does."""

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

import pytest

from rarms_iac.model.outcomes import Estimate, Met, Missed, NoEstimate, Overload, Unsteady
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.run import Periodic, SampleCount
from rarms_iac.model.series import Sample, Series
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import Threshold
from rarms_iac.statistics.curves import curve_of, highest_missed
from rarms_iac.statistics.distributions import ERROR, LOOK_ERROR
from rarms_iac.statistics.overload import describe_overload, estimate_of_setting, find_overload, more_processors_help
from rarms_iac.statistics.verdicts import judge, judge_early
from tests.builders import a_run, at_least, at_most
from tests.measured import noisy

PERIOD = 50.0
RUN = replace(a_run(until=SampleCount(samples=400)), arrival=Periodic(period=Milliseconds(Fraction(50))), deadline=None)
SLOW = {"p95_response_time": at_most(10_000)}


def served(times: Sequence[float], *, cpu_ms: float | None = None, period: float = PERIOD) -> Series:
    """Jobs that are due every period, each begun when the one before it has ended, each of which takes so long."""
    samples, now = list[Sample](), 0.0
    for number, time in enumerate(times):
        now = max(now, number * period) + time
        samples.append(Sample(began_ms=number * period, response_ms=now - number * period, successful=True))
    return Series(component="a", samples=tuple(samples), elapsed_ms=now, cpu_ms=cpu_ms)


def test_falling_behind_misses_before_late_jobs() -> None:
    behind = served(noisy(1, 60.0, count=100), cpu_ms=100 * 30.0)

    verdict = judge(behind, SLOW, RUN)

    assert isinstance(verdict, Missed)
    assert verdict.overload is not None
    assert verdict.overload.needed_lp == pytest.approx(0.6)
    assert verdict.overload.received_lp == pytest.approx(0.5, rel=0.02)
    assert describe_overload(verdict.overload).startswith("overloaded: needs 0.6 LP, has 0.5")
    assert judge_early(behind, SLOW, RUN, done=0.5) is not None, "nothing can turn it"


@pytest.mark.parametrize("mean", [30.0, 49.0])
def test_steady_component_is_judged_by_samples(mean: float) -> None:
    series = served(noisy(1, mean, count=400))

    assert find_overload(series, RUN, error=ERROR) is None
    assert not (isinstance(verdict := judge(series, SLOW, RUN), Missed) and verdict.overload)


def test_at_threshold_of_overload_it_is_rarely_said() -> None:
    said = sum(
        find_overload(served(noisy(seed, PERIOD, count=400)), RUN, error=ERROR) is not None for seed in range(300)
    )

    assert said <= 6, f"{said} of 300, where 1.5 are expected at most"


def test_sequential_jobs_are_never_behind() -> None:
    assert find_overload(served(noisy(1, 60.0, count=400)), a_run(), error=ERROR) is None


def test_a_component_that_leaves_jobs_out_keeps_up() -> None:
    samples = [
        Sample(began_ms=2 * number * PERIOD, response_ms=60.0 + number % 3, successful=True) for number in range(200)
    ]
    series = Series(component="a", samples=samples, elapsed_ms=400 * PERIOD)
    sometimes = [
        Sample(began_ms=(number + number // 5) * PERIOD, response_ms=60.0 + 10 * (number % 5), successful=True)
        for number in range(200)
    ]

    assert find_overload(series, RUN, error=ERROR) is None
    assert find_overload(replace(series, samples=sometimes), RUN, error=ERROR) is None


@pytest.mark.parametrize(
    ("apt", "kind"),
    [
        ({"throughput": at_least(15)}, Met),
        ({"throughput": at_least(18)}, Missed),
        ({"success_rate": at_least(90)}, Met),
        ({"minimum_response_time": at_most(70)}, Unsteady),
        ({"throughput": at_least(15), "mean_response_time": at_most(10_000)}, Missed),
    ],
)
def test_constant_backlog_is_judged_by_samples(apt: dict[str, Threshold], kind: type) -> None:
    assert isinstance(judge(served(noisy(1, 60.0, count=400)), apt, RUN), kind)


def test_timed_successes_miss_and_told_ones_wait() -> None:
    apt = {"success_rate": at_least(90)}
    series = served(noisy(1, 60.0, count=400))
    limited = replace(RUN, success_within=Milliseconds(Fraction(100_000)))

    assert isinstance(judge(series, apt, limited), Missed)
    assert not isinstance(judge(replace(series, wanders=True), apt, RUN), Met)


def test_a_machine_whose_speed_wanders_widens_the_bound() -> None:
    level = [70.0 if (number // 100) % 2 else 40.0 for number in range(400)]
    series = served([time + noise - 1.0 for time, noise in zip(level, noisy(1, 1.0, count=400), strict=True)])

    assert find_overload(replace(series, wanders=True), RUN, error=LOOK_ERROR) is None


def test_growing_value_is_missed_on_the_curve() -> None:
    series = served(noisy(1, 60.0, count=400))
    enough = Setting(reserve=80, series=(served(noisy(1, 30.0, count=400)),))
    settings = (Setting(reserve=60, series=(series,)), enough)
    curve = curve_of(settings, "a", "mean_response_time", RUN)

    assert (curve.overloaded, curve.inconclusive) == ((60,), ())
    assert [point.reserve for point in curve.points] == [80]
    assert highest_missed([(curve, at_most(1_000_000))]) == 60

    assert isinstance(estimate_of_setting("mean_response_time", series, RUN), NoEstimate)
    assert isinstance(estimate_of_setting("throughput", series, RUN), Estimate)


@pytest.mark.parametrize(
    ("between", "cpu", "share", "processors", "helps"),
    [
        (80.0, 40.0, 0.5, 1, True),  # computes all the time
        (60.0, 5.0, 1.0, 1, False),  # waits for 55 ms
        (60.0, 20.0, 0.5, 1, True),  # waits for 20 ms at least, and computes for 20
        (60.0, 12.0, 0.5, 1, True),  # waits for 36 ms at least
        (70.0, 12.0, 0.5, 1, False),  # waits for 46 ms at least
        (51.0, 50.0, 1.0, 1, True),  # computes all the time, but for what interrupts take
    ],
)
def test_more_cpu_helps_unless_jobs_waited(
    between: float, cpu: float, share: float, processors: int, helps: bool
) -> None:
    overload = Overload(period_ms=PERIOD, between_ms=between, job_cpu_ms=cpu)

    assert more_processors_help(overload, share, processors) is helps


def test_skipped_start_jobs_are_not_caught_up() -> None:
    starts, jobs, behind_ms = 60, 16, 0.06 * PERIOD
    samples, since = list[Sample](), 0.0
    for _ in range(starts):
        ends = [since + PERIOD * number + behind_ms * number for number in range(1, jobs + 1)]
        begins = [since - 4 * PERIOD + PERIOD * number for number in range(1, jobs + 1)]
        samples += [
            Sample(began_ms=began, response_ms=ended - began, successful=True)
            for began, ended in zip(begins, ends, strict=True)
        ]
        since = ends[-1]  # the time in which the load settled is left out, and with it the jobs that ended there
    series = replace(served([PERIOD]), samples=tuple(samples), elapsed_ms=since)
    begun = replace(series, starts=tuple(jobs * number for number in range(1, starts)))

    assert isinstance(find_overload(begun, RUN, error=LOOK_ERROR), Overload)
