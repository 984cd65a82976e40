"""Commands that meet another version of rarms on a Linux host: both versions, and the command that helps."""

import ast
import os
from contextlib import chdir
from pathlib import Path

import pytest

import rarms_iac
from rarms_iac.cli.ending import ExitCode
from rarms_iac.model.version import __version__
from rarms_iac.storage.shipped import shipped
from tests.remote import write_script
from tests.unit.cli.running import rarms

CELL = """\
schema: rarms/v1
application: { name: cell }
hosts:
  onboard:
    provider: linux
    logical_processors: 2
    memory: 1 GiB
    connect: { ssh: cell, folder: /opt/robot }
components:
  vision:
    criticality: 1
    memory: 64 MiB
    cpu: { reserve: 0.1 LP }
    apt: { mean_response_time: { at_most: 60 ms } }
    run:
      command: [vision]
      until: { samples: 20 }
      samples: { from: json_lines, response_time: { field: r, unit: ms } }
"""
COMMANDS = (
    "doctor",
    "plan",
    "drift",
    "status",
    "history",
    "snapshot --out snapshot.json",
    "apply --auto-approve",
    "destroy --auto-approve",
    "stop --auto-approve",
    "start --auto-approve",
    "undo --auto-approve",
    "measure vision",
    "prove --load-host",
    "run vision",
)


@pytest.mark.needs("posix")
@pytest.mark.parametrize("words", COMMANDS)
def test_both_versions_and_the_command_that_helps(words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_script(tmp_path / "bin" / "ssh", 'echo "rarms: installed 0.0.8 0.0.9 current"; exit 69')
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")
    (tmp_path / "rarms.yaml").write_text(CELL, encoding="utf-8")
    monkeypatch.chdir(tmp_path)

    ended = rarms(*words.split())

    said = " ".join((ended.out + ended.err).split())
    assert ended.code != 0
    assert f"it has rarms 0.0.8, 0.0.9; this is rarms {__version__}" in said
    assert "rarms install --host onboard" in said


MANIFEST = """schema: rarms/v1
application: { name: robot }
policy: { interference: busy-loop }
hosts:
  onboard: { logical_processors: 2, memory: 4 GiB }
components:
  vision:
    criticality: 9
    memory: 512 MiB
    apt: { mean_response_time: { at_most: 100 ms } }
    cpu: { reserve: 40 % }
    simulation: { work: 5 ms }
"""
APPROVED = "--auto-approve"
BATCH: dict[tuple[str, ...], tuple[int, str]] = {
    ("apply",): (64, APPROVED),
    ("undo",): (64, APPROVED),
    ("destroy",): (64, APPROVED),
    ("stop", "vision"): (64, APPROVED),
    ("release", "vision"): (64, APPROVED),
    ("measure",): (3, "--stop-partitions"),
    ("measure", "--interactive"): (64, "rarms select COMPONENT --at LEVEL"),
    ("tune", "--interactive"): (64, "Omit --interactive"),
    ("prove",): (64, "--load-host"),
}
"""How a command ends that asks and has no terminal, and what it names for a yes."""

ASKED_BY: dict[str, set[tuple[str, ...]]] = {
    "ask": {("apply",), ("undo",), ("destroy",), ("stop", "vision"), ("release", "vision")},
    "stop_question": {("measure",)},
    "attach_question": set(),  # on Linux alone: tests/system/test_attached.py
    "level_question": {("measure", "--interactive")},
    "WRITE_LEVEL": {("measure", "--interactive")},
    "refine_question": {("measure", "--interactive")},
    "extend_question": {("measure", "--interactive")},
    "combine_question": {("measure", "--interactive")},
    "WRITE_PARTITIONS": {("measure", "--interactive")},
    "combination_question": {("measure", "--interactive"), ("tune", "--interactive")},
}
"""The commands of `BATCH` that ask each question."""


def state() -> dict[str, bytes]:
    """What a yes would change: manifest, hosts and data logs, without the locks that a look takes."""
    files = [path for path in Path().rglob("*") if path.is_file() and "lock" not in path.name]
    return {path.as_posix(): path.read_bytes() for path in files}


@pytest.fixture
def applied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, bytes]:
    monkeypatch.chdir(tmp_path)
    Path("rarms.yaml").write_text(MANIFEST, encoding="utf-8")
    assert rarms("apply", APPROVED).code == 0
    Path("rarms.yaml").write_text(MANIFEST.replace("40 %", "30 %"), encoding="utf-8")
    return state()


@pytest.mark.parametrize("words", BATCH, ids=" ".join)
def test_without_a_terminal_the_answer_is_no(words: tuple[str, ...], applied: dict[str, bytes]) -> None:
    ran = rarms(*words, stdin="yes\ny\ny\n")

    code, way = BATCH[words]
    assert ran.code == code, ran.err
    assert way in " ".join(ran.err.split())
    assert state() == applied


def test_every_question_is_in_the_table() -> None:
    module = Path(rarms_iac.__file__).parent / "views" / "questions.py"
    tree = ast.parse(module.read_text(encoding="utf-8"))
    asked = {node.name for node in tree.body if isinstance(node, ast.FunctionDef) and ends_in_question(node)}
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and isinstance(node.value, ast.Call):
            asked.add(node.targets[0].id)

    assert asked | {"ask"} == ASKED_BY.keys()
    assert {words for commands in ASKED_BY.values() for words in commands} | {("prove",)} == BATCH.keys()


def ends_in_question(function: ast.FunctionDef) -> bool:
    return isinstance(function.returns, ast.Name) and function.returns.id == "Question"


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
    assert 'for the application "robot", but rarms.yaml describes "rover"' in " ".join(refused.err.split())


def test_unknown_name_is_refused_before_missing_terminal(tmp_path: Path) -> None:
    assert rarms("init", str(tmp_path), "--name", "robot").code == 0
    with chdir(tmp_path):
        answers = [rarms(*words) for words in (("destroy", "--target", "nosuch"), ("release", "nosuch"))]

    assert [answer.code for answer in answers] == [ExitCode.NO, ExitCode.USAGE]
    assert all("nosuch" in answer.err and "terminal" not in answer.err for answer in answers)


@pytest.mark.parametrize(("command", "advice"), [("measure", "rarms select COMPONENT"), ("tune", "without asking")])
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
