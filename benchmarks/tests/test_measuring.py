"""The benchmark of measured answers, small: what is drawn, what counts as wrong, and one component from end to end."""

from dataclasses import replace
from pathlib import Path

import pytest

import rarms_iac as rarms
from benchmarks import measuring
from benchmarks.measuring import COMPONENTS, INDEXES, Answer, Drawn, answers, draw, figures

FOUND = Answer(
    strategy="default",
    component="c0",
    index="mean_response_time",
    ending="found",
    processors=2,
    reserve=42,
    truth=40,
    highest=100,
    is_wrong=False,
    is_conditional=False,
    needs=200,
    is_short=False,
    settings=5,
    seconds=600.0,
    measuring_s=2.0,
    whole_host_lp=1.6,
    computed_s=36.0,
    run_as="",
)


def test_draw_has_all_kinds_and_valid_manifests(tmp_path: Path) -> None:
    drawn = [draw(seed) for seed in range(COMPONENTS)]

    assert {each.logical_processors for each in drawn} == set(range(1, 9))
    assert {each.threads for each in drawn} == {1, 2, 3, 4}
    assert {each.index for each in drawn} == set(INDEXES)
    assert {each.kept_percent for each in drawn} == {0, 10, 20}
    assert 0.4 < sum(each.every_ms > 0 for each in drawn) / COMPONENTS < 0.6
    assert all(0.5 <= each.work_ms <= 500 for each in drawn)
    assert sum(each.work_ms < 16 for each in drawn) / COMPONENTS == pytest.approx(0.5, abs=0.1), "log-uniform"
    for each in [next(each for each in drawn if each.index == index) for index in INDEXES]:
        (tmp_path / "rarms.yaml").write_text(each.manifest(limit=20.0), encoding="utf-8")
        assert rarms.load(str(tmp_path / "rarms.yaml")).system.components[each.name].apt.keys() == {each.index}


def test_short_budgets_are_counted_apart() -> None:
    found = [
        FOUND,
        replace(FOUND, component="c1", reserve=39, is_wrong=True),
        replace(FOUND, component="c2", reserve=0, ending="not_resolved"),
        replace(FOUND, component="c3", reserve=0, truth=98),
        replace(FOUND, component="c4", reserve=90, needs=50_000, is_short=True),
    ]

    rows = list(figures(found))
    by_name = {row.name: row.value for row in rows}

    assert by_name["default: 4 components, wrong"] == 25
    assert by_name["  no answer, of 3 that have one"] == pytest.approx(100 / 3)
    assert (rows[4].value, rows[5].value) == (1, 2), "points too high, one that is too low counts as none"
    assert [row.value for row in rows[6:8]] == [pytest.approx(2.5), 5], "in per cent of the truth"
    assert rows[9].value == 20
    assert [row.value for row in rows[12:15]] == [pytest.approx(0.81), pytest.approx(0.8), pytest.approx(1.6)]
    assert by_name["  of 400 such components"] == pytest.approx(4)


def test_component_is_measured_from_draw_to_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    short = Drawn(
        name="c0",
        logical_processors=2,
        kept_percent=10,
        threads=1,
        work_ms=8.0,
        blocked_ms=0.0,
        varies=10.0,
        every_ms=0.0,
        index="mean_response_time",
        reserve=40,
        within=0.5,
    )
    monkeypatch.setattr(measuring, "draw", lambda _seed: short)
    monkeypatch.setattr(measuring, "JOBS", 2000)
    monkeypatch.setattr(measuring, "BUDGET", "10 min")

    found = answers(0)

    assert [(each.strategy, each.processors, each.truth) for each in found] == [
        ("default", 1, 40),
        ("slow_job 1", 1, 40),
        ("bisection", 1, 40),
    ]
    # NOTE: Long runs tell the truth to about a point; so does `is_wrong`.
    assert all(not each.is_wrong and 39 <= each.reserve <= 46 for each in found), found
    assert all(each.whole_host_lp >= 0.4 and each.settings > 2 and each.seconds > 9 for each in found)
