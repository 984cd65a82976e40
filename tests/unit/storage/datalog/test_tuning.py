"""The log of tuning: a run comes back as it was written, is not written twice, and damage is told."""

from dataclasses import replace
from pathlib import Path

from rarms_iac.storage.datalog.decisions import append_run, read_runs, tuning_path
from tests.builders_measured import TUNED


def test_runs_come_back_in_order(tmp_path: Path) -> None:
    path, later = tuning_path(tmp_path, "two-core"), replace(TUNED, after=180)
    assert read_runs(path) == ()
    append_run(path, TUNED)
    append_run(path, later)

    assert path == tmp_path / "measurements" / "two-core" / "tuning.jsonl"
    assert read_runs(path) == (TUNED, later)


def test_repeated_run_is_not_written(tmp_path: Path) -> None:
    path = tuning_path(tmp_path, "two-core")
    append_run(path, TUNED)
    append_run(path, replace(TUNED, when="2026-11-22T12:00:00Z", rarms_version="2"))

    assert read_runs(path) == (TUNED,)
