"""The benchmarks' own arithmetic."""

import sys

import pytest

from benchmarks.timing import Figure, command, interleaved, median_ratio, report, table


def test_tasks_run_in_turn_after_warming_up() -> None:
    ran: list[str] = []

    times = interleaved({"a": lambda: ran.append("a"), "b": lambda: ran.append("b")}, rounds=2)

    assert ran == ["a", "b", "a", "b", "b", "a"]
    assert {name: len(values) for name, values in times.items()} == {"a": 2, "b": 2}


def test_slow_minute_of_machine_does_not_move_ratio() -> None:
    assert median_ratio([2.0, 20.0, 2.0], to=[1.0, 10.0, 1.0]) == 2.0


def test_missed_goal_is_said_and_is_exit_code(capsys: pytest.CaptureFixture[str]) -> None:
    code = report([Figure(name="start", value=3.0, at_most=2), Figure(name="told", value=9.0, unit="ms")])

    assert code == 1
    assert "MISSED" in capsys.readouterr().out


def test_a_reached_goal_is_no_failure() -> None:
    assert report([Figure(name="start", value=2.0, at_most=2)]) == 0
    assert "MISSED" not in table([Figure(name="start", value=2.0, at_most=2)])


def test_failing_command_is_not_timed() -> None:
    with pytest.raises(RuntimeError, match="exit code 3 instead of 0"):
        command([sys.executable, "-c", "raise SystemExit(3)"])()

    command([sys.executable, "-c", "raise SystemExit(3)"], expect=3)()
