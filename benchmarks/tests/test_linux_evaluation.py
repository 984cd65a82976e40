"""The evaluation on a real Linux: what it works out of runs, and that its page says what was seen."""

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from math import inf
from pathlib import Path

import pytest

from benchmarks.linux.evaluation import (
    BROWSERS,
    FDP,
    LOADS,
    MEASURED,
    PPP,
    RESERVES,
    SRP,
    VSP,
    bracket,
    next_experiment,
    rules,
)
from benchmarks.linux.experiments import PAIRS, Experiment, Log, Record, meets, percentile, value_of, values_of
from benchmarks.linux.page import Findings, Trial, page
from rarms_iac.model.series import Sample, Series
from rarms_iac.model.system import AtLeast, AtMost, Component
from tests.builders import a_component, at_most

COMPONENT = replace(
    a_component("vision"),
    apt={"p95_response_time": AtMost(value=Fraction(19)), "throughput": AtLeast(value=Fraction(9))},
)
MACHINE = {
    **dict.fromkeys(("model", "processors", "linux", "groups", "python", "today", "commit", "experiments"), "any"),
    "memory_gib": 8,
    "others": 3,
}
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


def test_no_answers_make_time_endless() -> None:
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


def recorded(experiment: Experiment) -> Record:
    """What a machine shows on which a job takes 1000 ms over the reservation, give or take a little."""
    times = [
        1000 / max(1, experiment.setting) * (1 + 0.01 * ((number * 7 + experiment.repeat) % 5)) for number in range(60)
    ]
    samples = [(100.0 * number, time, True, 1.0) for number, time in enumerate(times)]
    return {
        "series": {"elapsed_ms": 6000.0, "samples": samples},
        "consumed": [(0, 0, 0), (1000, 200, 1700), (2000, 600, 3200)],
        "reserve": 23,
    }


def evaluated(path: Path) -> tuple[Log, Mapping[str, Component]]:
    """A log of all that is to be done, and the components."""
    component = replace(a_component(FDP), apt={"mean_response_time": at_most("47")})
    log, components = Log(path=path), {FDP: component}
    while (experiment := next_experiment(log, components, 2)) is not None:
        log.add(experiment, recorded(experiment))
    return log, components


def test_experiments_run_once_and_resume(tmp_path: Path) -> None:
    log, components = evaluated(tmp_path / "log.jsonl")
    lines = (tmp_path / "log.jsonl").read_text(encoding="utf-8").splitlines()
    (tmp_path / "log.jsonl").write_text("\n".join(lines[:20]) + "\n", encoding="utf-8")

    again = Log(path=tmp_path / "log.jsonl")

    assert len(lines) == len(log.records)
    assert len(again.records) == 20
    assert next_experiment(again, components, 2) == list(log.records)[20]


def test_halving_and_rules_give_whole_percent(tmp_path: Path) -> None:
    log, components = evaluated(tmp_path / "log.jsonl")

    assert bracket(log, components[FDP]) == (21, 22)
    assert rules(log, components[FDP], 2, 4) == {
        MEASURED: 23,
        "95th percentile of use": 20,
        "99th percentile of use": 20,
        "mean of use and 20 %": 18,
        "even split": 25,
    }


def test_page_sums_what_rules_missed() -> None:
    found = [
        Findings(
            component=replace(COMPONENT, name=name),
            curve={reserve: {"p95_response_time": 1000 / reserve, "throughput": inf} for reserve in RESERVES},
            too_little=19,
            needed=20,
            measured=22,
            loaded=dict.fromkeys(LOADS, 12.34),
            work={20: [7.0, 8.5], 22: [9.5]},
            trials={
                MEASURED: Trial(reserve=22, missed=0, runs=3, too_much=2),
                "even split": Trial(reserve=15, missed=2, runs=3, too_much=0),
            },
        )
        for name in (FDP, SRP, PPP, VSP)
    ]

    browsers = {pair: [100.0 + pair[0]] * len(BROWSERS) for pair in PAIRS}

    lines = page(found, browsers, MACHINE).splitlines()

    assert "| 50 % | 20.0 | none | 20.0 | none | 20.0 | none | 20.0 | none |" in lines
    assert "| 100 % | 12.3 | 12.3 | 12.3 | 12.3 |" in lines
    assert f"| {FDP} | 20 % | even split | 15 % | 2 of 3 | 0 |" in lines
    assert f"| {MEASURED} | 0 of 12 | 88 | 8 |" in lines
    assert "| even split | 8 of 12 | 60 | 0 |" in lines
    apt = "p95 response time at most 19 ms, throughput at least 9 /s"
    assert f"| {FDP} | {apt} | 20 % | 22 % | +2 points |" in lines
    assert f"| {FDP} | 7.0 | 9.5 | 7.0, 8.5 | 9.5 |" in lines
    assert "| 10 | 150.0 | 175.0 | 175.0 |" in lines
    assert not any("Not measured" in line for line in lines)

    early = [replace(findings, too_little=15, measured=None, loaded={}, trials={}) for findings in found]
    lines = page(early, {}, MACHINE).splitlines()

    assert f"| {FDP} | {apt} | 16 to 20 % | none |  |" in lines
    assert lines[-5:-2] == [
        "- Fig. 3 (robotic classes under load)",
        "- Fig. 4 (browsers)",
        "- the comparison with other methods",
    ]
    assert not any(line.startswith("## Fig. 3") for line in lines)
