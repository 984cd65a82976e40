"""The benchmark of layouts, small: what is drawn, what is told apart, and that a run that was killed goes on."""

from pathlib import Path

import pytest

from benchmarks import layouts
from benchmarks.layouts import Outcome, comparison, draw, figures, has_short_period, outcomes_of
from rarms_iac.model.loads import BUSY_LOOP

BUSY = (BUSY_LOOP,)
BURSTS = (BUSY_LOOP, "bursts-20")


def outcome(seed: int, family: tuple[str, ...], ending: str, *, tails: bool = False) -> Outcome:
    return Outcome(seed=seed, family="+".join(family), ending=ending, tails=tails, reserved_lp=float(len(family)))


def test_a_third_of_layouts_has_a_short_period() -> None:
    drawn = [draw(seed) for seed in range(80)]

    assert sum(has_short_period(each.seed) for each in drawn) >= 80 / 3
    assert {len(each.components) for each in drawn} == {2, 3, 4, 5, 6}
    for half in (drawn[::2], drawn[1::2]):
        assert any(each.logical_processors == 1 and len(each.components) == 2 for each in half)


def test_families_are_compared_on_common_plans() -> None:
    rows = comparison(
        {
            BUSY: [outcome(0, BUSY, "missed"), outcome(2, BUSY, "missed", tails=True), outcome(4, BUSY, "missed")],
            BURSTS: [
                outcome(0, BURSTS, "held"),
                outcome(2, BURSTS, "missed", tails=True),
                outcome(4, BURSTS, "no plan"),
            ],
        },
        "unseen",
    )

    assert [row.value for row in rows] == [1.0, 1, 1, 2.0, 0, 1]
    assert rows[-1].at_most == pytest.approx(1 / 3)


def test_unseen_misses_without_tails_face_the_limit() -> None:
    missed = [outcome(seed, BUSY, "missed", tails=seed < 10) for seed in range(1, 21, 2)]

    by_name = {row.name: row for row in figures(missed, "unseen")}

    assert by_name["  5 layouts, missed"].value == 100.0
    limits = [row.at_most for row in figures(missed, "unseen") if row.at_most is not None]
    assert limits == [layouts.MOST_MISSED]


def test_a_run_goes_on_where_it_was_killed(tmp_path: Path) -> None:
    first = outcomes_of([BUSY], tmp_path, "development", 1)
    written = (tmp_path / "layouts.jsonl").read_text(encoding="utf-8")

    again = outcomes_of([BUSY], tmp_path, "development", 1)

    assert first == again
    assert {each.ending for each in first[BUSY]} & {"held", "missed"}
    assert (tmp_path / "layouts.jsonl").read_text(encoding="utf-8") == written
