"""What is asked at a terminal is a no where there is none, unless the question's own flag says yes."""

import ast
from pathlib import Path

import pytest

import rarms_iac
from tests.unit.cli.running import rarms

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
    ("tune", "--interactive"): (64, "Leave --interactive out"),
    ("prove",): (64, "--load-host"),
}
"""How a command ends that asks and has no terminal, and what it names for a yes."""

ASKED_BY: dict[str, set[tuple[str, ...]]] = {
    "ask": {("apply",), ("undo",), ("destroy",), ("stop", "vision"), ("release", "vision")},
    "stop_question": {("measure",)},
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
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            asked.add(node.targets[0].id)

    assert asked | {"ask"} == ASKED_BY.keys()
    assert {words for commands in ASKED_BY.values() for words in commands} | {("prove",)} == BATCH.keys()


def ends_in_question(function: ast.FunctionDef) -> bool:
    return isinstance(function.returns, ast.Name) and function.returns.id == "Question"
