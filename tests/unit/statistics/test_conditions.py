"""Conditions: what a met threshold takes for granted of jobs that no sample showed."""

import pytest

from rarms_iac.model.outcomes import Met, RareRuns, RareSlowJobs
from rarms_iac.model.run import Run
from rarms_iac.model.series import Series
from rarms_iac.model.system import Threshold
from rarms_iac.statistics.conditions import conditions_of, more_samples_lift
from rarms_iac.statistics.verdicts import judge_look
from tests.builders import a_run, at_least, at_most
from tests.measured import a_series

RUN = a_run(deadline="20 ms")


def met(series: Series, apt: dict[str, Threshold], run: Run = RUN) -> Met:
    verdict = judge_look(series, apt, run)
    assert isinstance(verdict, Met)
    return verdict


def times(count: int) -> list[float]:
    """Jobs of 9 to 11 ms, 10 on average."""
    return [(9.0, 11.0, 10.0)[number % 3] for number in range(count)]


def test_mean_without_room_names_slow_jobs() -> None:
    series = a_series(times(400))
    verdict = met(series, {"mean_response_time": at_most(11)})

    (condition,) = conditions_of(verdict.judged, series, RUN, 20.0)

    assert isinstance(condition, RareSlowJobs)
    assert condition.slower_than_ms == 11.0
    room = 11.0 - verdict.judged[0].estimate.upper
    assert condition.once_in * room == pytest.approx(200.0, rel=0.01), "jobs of 200 ms so often use up the room"


def test_many_samples_leave_no_condition() -> None:
    series = a_series(times(4000))
    verdict = met(series, {"mean_response_time": at_most(11)})

    assert conditions_of(verdict.judged, series, RUN, 20.0) == ()


def test_expected_samples_tell_whether_condition_goes() -> None:
    series = a_series(times(400))
    verdict = met(series, {"mean_response_time": at_most(11)})

    assert more_samples_lift(verdict.judged, series, RUN, 20.0, samples=4000)
    assert not more_samples_lift(verdict.judged, series, RUN, 20.0, samples=500)
    assert not more_samples_lift(verdict.judged, series, RUN, 1.0, samples=4000), "there is none"


@pytest.mark.parametrize(
    "apt",
    [
        {"success_rate": at_least(90)},
        {"deadline_miss_rate": at_most(10)},
        {"p90_response_time": at_most(20)},
    ],
    ids=lambda apt: next(iter(apt)),
)
def test_share_without_room_names_longest_run(apt: dict[str, Threshold]) -> None:
    series = a_series(times(150))
    verdict = met(series, apt)

    (condition,) = conditions_of(verdict.judged, series, RUN, 20.0)

    assert isinstance(condition, RareRuns)
    assert condition.jobs == 5
    assert conditions_of(verdict.judged, series, RUN, 20.0, samples=1000) == ()


def test_longer_runs_seen_count_for_unseen_ones() -> None:
    series = a_series([30.0 if number % 300 < 8 else 10.0 for number in range(900)])
    verdict = met(series, {"deadline_miss_rate": at_most(18)})

    (condition,) = conditions_of(verdict.judged, series, RUN, 20.0)

    assert isinstance(condition, RareRuns)
    assert condition.jobs == 8


def test_slow_job_of_one_gives_no_condition() -> None:
    series = a_series(times(150))
    apt: dict[str, Threshold] = {"mean_response_time": at_most(11), "success_rate": at_least(90), "jitter": at_most(4)}

    assert conditions_of(met(series, apt).judged, series, RUN, 1.0) == ()
    assert len(conditions_of(met(series, apt).judged, series, RUN, 20.0)) == 3


def test_extreme_has_no_condition() -> None:
    series = a_series(times(150))
    verdict = met(series, {"maximum_response_time": at_most(12)})

    assert conditions_of(verdict.judged, series, RUN, 20.0) == ()
