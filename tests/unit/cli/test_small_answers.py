"""Answers that every command gives alike: missing files, renamed applications, `q`, and notes told once."""

from contextlib import chdir
from pathlib import Path

import pytest

from rarms_iac.cli.ending import ExitCode
from rarms_iac.storage.shipped import shipped
from tests.unit.cli.running import rarms


@pytest.mark.parametrize(
    "words",
    [
        ("validate", "nosuch.yaml"),
        ("validate", "-f", "nosuch.yaml"),
        ("validate", "rarms.yaml", "--overlay", "nosuch.yaml"),
        ("fmt", "nosuch.yaml"),
        ("plan", "-f", "nosuch.yaml"),
        ("plan", "--overlay", "nosuch.yaml"),
        ("status", "-f", "nosuch.yaml"),
        ("show", "nosuch.plan"),
        ("show", "--check", "nosuch.ps1"),
        ("apply", "nosuch.plan"),
        ("plan", "--snapshot", "onboard=nosuch.json"),
    ],
)
def test_a_missing_file_is_a_wrong_request(tmp_path: Path, words: tuple[str, ...]) -> None:
    assert rarms("init", str(tmp_path), "--name", "robot").code == 0
    with chdir(tmp_path):
        answer = rarms(*words)

    assert answer.code == ExitCode.USAGE
    assert "nosuch" in answer.err + answer.out


def test_a_plan_of_a_renamed_application_is_refused(tmp_path: Path) -> None:
    assert rarms("init", str(tmp_path), "--name", "robot").code == 0
    manifest = tmp_path / "rarms.yaml"
    with chdir(tmp_path):
        assert rarms("plan", "--out", "change.plan").code == 0
        text = manifest.read_text(encoding="utf-8")
        assert "name: robot" in text
        manifest.write_text(text.replace("name: robot", "name: rover"), encoding="utf-8")
        refused = rarms("apply", "change.plan")
        overlay = tmp_path / "as-planned.yaml"
        overlay.write_text("application: { name: robot }\n", encoding="utf-8")
        with_overlay = rarms("apply", "change.plan", "--overlay", "as-planned.yaml")

    assert (refused.code, with_overlay.code) == (ExitCode.REFUSED, ExitCode.DONE)
    assert 'of the application "robot"; rarms.yaml is that of "rover"' in " ".join(refused.err.split())


def test_unknown_name_is_refused_before_missing_terminal(tmp_path: Path) -> None:
    assert rarms("init", str(tmp_path), "--name", "robot").code == 0
    with chdir(tmp_path):
        answers = [rarms(*words) for words in (("destroy", "--target", "nosuch"), ("release", "nosuch"))]

    assert [answer.code for answer in answers] == [ExitCode.NO, ExitCode.NO]
    assert all("nosuch" in answer.err and "terminal" not in answer.err for answer in answers)


@pytest.mark.parametrize(("command", "advice"), [("measure", "rarms select COMPONENT"), ("tune", "measured unasked")])
def test_without_terminal_interactive_says_what_to_do_instead(tmp_path: Path, command: str, advice: str) -> None:
    assert rarms("init", str(tmp_path), "--name", "robot").code == 0
    with chdir(tmp_path):
        refused = rarms(command, "--interactive")

    assert refused.code == ExitCode.USAGE
    assert advice in " ".join(refused.err.split())


def test_the_answer_q_ends_with_0(tmp_path: Path) -> None:
    assert rarms("init", str(tmp_path), "--name", "robot").code == 0
    with chdir(tmp_path):
        assert rarms("apply", "--auto-approve").code == 0
        answer = rarms("measure", stdin="q\n", at_a_terminal=True)

    assert answer.code == ExitCode.DONE
    assert "Stopped." in answer.err


def test_unused_load_is_told_by_validate_and_plan(tmp_path: Path) -> None:
    assert rarms("init", str(tmp_path), "--name", "robot").code == 0
    (tmp_path / "more.yaml").write_text("interference: { spare: { kind: busy_loop, threads: 2 } }\n", encoding="utf-8")
    with chdir(tmp_path):
        told = {
            words: "RARMS086" in (answer := rarms(*words.split(), "--overlay", "more.yaml")).out + answer.err
            for words in ("validate", "plan", "apply --auto-approve", "stop --auto-approve", "status", "doctor")
        }

    assert [words for words, is_told in told.items() if is_told] == ["validate", "plan"]


def test_rounded_reserve_is_told_where_reserves_are_planned(tmp_path: Path) -> None:
    manifest = shipped("tests/cases/findings/reserve-rounded-up/rarms.yaml")
    (tmp_path / "rarms.yaml").write_bytes(manifest.read_bytes())
    with chdir(tmp_path):
        told = {
            words: "RARMS367" in (answer := rarms(*words.split())).out + answer.err
            for words in ("validate", "plan", "apply --auto-approve", "stop --auto-approve", "start --auto-approve")
        }

    assert [words for words, is_told in told.items() if is_told] == ["validate", "plan", "apply --auto-approve"]


def test_needed_samples_are_told_by_validate_only(tmp_path: Path) -> None:
    assert rarms("init", str(tmp_path), "--name", "robot").code == 0
    few = (
        "components: { control: { cpu: { reserve: measured }, run: { command: [control], until: { samples: 20 } } } }\n"
    )
    (tmp_path / "more.yaml").write_text(few, encoding="utf-8")
    with chdir(tmp_path):
        told = {
            words: "RARMS074" in (answer := rarms(*words.split(), "--overlay", "more.yaml")).out + answer.err
            for words in ("validate", "plan", "apply --auto-approve")
        }

    assert told == {"validate": True, "plan": False, "apply --auto-approve": False}


def test_help_lists_what_is_for_simulated_hosts_last() -> None:
    before, _, after = rarms("--help").out.partition("On simulated hosts:")

    assert ("  simulate  " in before, "  simulate  " in after) == (False, True)
