"""The sentence below a table whose thresholds are met on a condition."""

import pytest

from rarms_iac.model.outcomes import Condition, RareRuns, RareSlowJobs
from rarms_iac.views.verdicts import describe_conditions


def slow(once_in: int, *, slower_than_ms: float = 112.8) -> Condition:
    return RareSlowJobs(component="vision", index="mean_response_time", slower_than_ms=slower_than_ms, once_in=once_in)


def runs(once_in: int) -> Condition:
    return RareRuns(component="voice", index="success_rate", jobs=5, once_in=once_in)


@pytest.mark.parametrize(
    ("condition", "words"),
    [
        pytest.param(slow(1_191), "vision: at most 1 job in 1,191 slower than 112.8 ms.", id="slow"),
        pytest.param(slow(1_000_000_000), "vision: no job slower than 112.8 ms.", id="never slow"),
        pytest.param(runs(367), "voice: at most 1 run of 5 bad jobs in 367 jobs.", id="runs"),
        pytest.param(runs(1_000_000_000), "voice: no run of 5 bad jobs.", id="no run"),
    ],
)
def test_condition_says_how_rare(condition: Condition, words: str) -> None:
    assert describe_conditions([condition]) == f"* Met if unseen slow jobs are rare. {words}"


def test_no_condition_has_no_sentence() -> None:
    assert describe_conditions([]) == ""


def test_strictest_condition_of_each_kind_is_said() -> None:
    said = describe_conditions([slow(116), runs(367), slow(1_191, slower_than_ms=140.0), runs(90)])

    parts = "vision: at most 1 job in 1,191 slower than 112.8 ms; voice: at most 1 run of 5 bad jobs in 367 jobs."
    assert said.endswith(parts)
