"""The evaluation on a real Linux: what it works out of runs, and that its page says what was seen."""

from dataclasses import replace
from fractions import Fraction
from math import inf

import pytest

from rarms_iac.model.measurement import Sample, Series
from rarms_iac.model.system import AtLeast, AtMost
from scripts.linux_evaluation import FDP, LOADS, MEASURED, PPP, RESERVES, SRP, VSP, Findings, Trial, page
from scripts.linux_experiments import meets, percentile, value_of, values_of
from tests.builders import a_component

COMPONENT = replace(
    a_component("vision"),
    apt={"p95_response_time": AtMost(value=Fraction(19)), "throughput": AtLeast(value=Fraction(9))},
)
SERIES = Series(
    component="vision",
    elapsed_ms=2000,
    samples=(
        *(Sample(began_ms=100 * number, response_ms=number + 1, successful=True) for number in range(19)),
        Sample(began_ms=1900, response_ms=None, successful=False),
    ),
)


@pytest.mark.parametrize(
    ("index", "value"),
    [("mean_response_time", 10), ("p95_response_time", 19), ("success_rate", 95), ("throughput", 9.5)],
)
def test_an_index_is_what_the_jobs_showed(index: str, value: float) -> None:
    assert value_of(index, SERIES) == value


def test_where_no_job_answered_a_response_time_is_endless_and_an_unknown_index_is_refused() -> None:
    silent = replace(SERIES, samples=SERIES.samples[-1:])

    assert value_of("mean_response_time", silent) == value_of("p95_response_time", silent) == inf
    with pytest.raises(ValueError, match="jitter"):
        value_of("jitter", silent)


def test_an_apt_is_met_where_every_index_is() -> None:
    assert meets(COMPONENT, values_of(COMPONENT, SERIES))
    assert not meets(COMPONENT, {"p95_response_time": 19.1, "throughput": 10})
    assert not meets(COMPONENT, {"p95_response_time": 1, "throughput": 8.9})


def test_a_percentile_is_a_value_that_was_seen() -> None:
    assert [percentile((3, 1, 2, 4), percent) for percent in (1, 25, 50, 99, 100)] == [1, 1, 2, 4, 4]


def test_the_page_adds_up_what_each_rule_missed_and_reserved_too_much() -> None:
    found = [
        Findings(
            component=replace(COMPONENT, name=name),
            curve={reserve: {"p95_response_time": 1000 / reserve, "throughput": inf} for reserve in RESERVES},
            needed=20,
            loaded=dict.fromkeys(LOADS, 12.34),
            trials={MEASURED: Trial(reserve=22.5, missed=0), "even split": Trial(reserve=15, missed=2)},
        )
        for name in (FDP, SRP, PPP, VSP)
    ]

    lines = page(found)

    assert "| 50 % | 20.0 | none | 20.0 | none | 20.0 | none | 20.0 | none |" in lines
    assert "| 100 % | 12.3 | 12.3 | 12.3 | 12.3 |" in lines
    assert f"| {FDP} | 20 % | even split | 15.0 % | 2 of 3 | 0.0 |" in lines
    assert f"| {MEASURED} | 0 of 12 | 90.0 | 10.0 |" in lines
    assert "| even split | 8 of 12 | 60.0 | 0.0 |" in lines
