"""The benchmark of layouts, small: what is drawn, what it says, and that a run that was killed goes on."""

from pathlib import Path

import pytest

from benchmarks import layouts
from benchmarks.layouts import Outcome, commit_of, draw_layout, figures, outcomes_of


def test_layouts_are_drawn_from_the_commit() -> None:
    drawn = [draw_layout("abc", number) for number in range(4)]

    assert drawn == [draw_layout("abc", number) for number in range(4)]
    assert drawn != [draw_layout("abd", number) for number in range(4)]


def test_too_many_missed_layouts_face_the_limit() -> None:
    held = [Outcome(number=n, lps=2, planned=True, reserved_lp=1.1, one_partition_lp=1.0) for n in range(8)]
    missed = Outcome(number=8, lps=2, planned=True, missed_long=("c0 p90 with busy-loop",))

    by_name = {row.name: row for row in figures([*held, missed, Outcome(number=9, lps=2, planned=False)])}

    assert by_name["missed"].value == pytest.approx(100 / 9)
    assert by_name["missed"].at_most == layouts.MOST_MISSED
    assert by_name["without a plan"].value == 1
    assert by_name["more than with loads in one partition"].value == pytest.approx(10)


def test_a_run_goes_on_where_it_was_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(layouts, "LONG_PROOF", "1 min")
    monkeypatch.setattr(layouts, "SETTING", "20 s")
    first = outcomes_of(tmp_path, 1)
    written = (tmp_path / "layouts.jsonl").read_text(encoding="utf-8")

    assert outcomes_of(tmp_path, 1) == first
    assert (tmp_path / "layouts.jsonl").read_text(encoding="utf-8") == written
    assert len(commit_of(tmp_path)) == 40
