"""`--json` where a command ends before it has an answer: the findings are the answer, and there is only one."""

import json
from pathlib import Path

import pytest

from tests.unit.cli.running import Ran, rarms
from tests.unit.views.test_json import check

BROKEN = """\
schema: rarms/v1
application: robot
hosts:
  here: { provider: simulated, logical_processors: 2, memory: 8 }
"""
READING = ("plan", "drift", "doctor", "graph", "apply", "undo", "destroy")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a good manifest."""
    assert rarms("init", str(tmp_path), "--name", "robot").code == 0
    return tmp_path


def codes(ran: Ran) -> list[str]:
    """The findings of the document that was printed, which is the only one."""
    document = json.loads(ran.out)
    check(ran.out)
    assert list(document)[:2] == ["format_version", "kind"]
    assert document["kind"] == "findings"
    return [finding["code"] for finding in document["findings"]]


@pytest.mark.parametrize("command", READING)
def test_errors_of_manifest_are_document_and_text(tmp_path: Path, command: str) -> None:
    manifest = tmp_path / "rarms.yaml"
    manifest.write_text(BROKEN, encoding="utf-8", newline="\n")

    ran = rarms(command, "-f", str(manifest), "--json")

    assert ran.code == 4
    assert codes(ran)
    assert "error[RARMS" in ran.err


def test_output_json_is_the_same_as_json(tmp_path: Path) -> None:
    manifest = tmp_path / "rarms.yaml"
    manifest.write_text(BROKEN, encoding="utf-8", newline="\n")

    assert codes(rarms("doctor", "-f", str(manifest), "--output", "json"))


@pytest.mark.parametrize("command", ["show", "apply"])
def test_plan_that_was_edited_is_refused_in_json(folder: Path, command: str) -> None:
    plan = folder / "robot.plan"
    assert rarms("plan", "-f", str(folder), "--out", str(plan)).code == 0
    plan.write_text(plan.read_text(encoding="utf-8").replace("robot", "tobor"), encoding="utf-8", newline="\n")

    ran = rarms(command, str(plan), "--json")

    assert ran.code == 3
    assert codes(ran)


@pytest.mark.parametrize(
    "words", [("apply",), ("plan", "--host", "nowhere"), ("explain", "RARMS998"), ("plan", "--max-disruption", "all")]
)
def test_wrong_words_are_a_finding_with_usage(folder: Path, words: tuple[str, ...]) -> None:
    manifest = () if words[0] == "explain" else ("-f", str(folder))

    ran = rarms(words[0], *manifest, *words[1:], "--json")

    assert ran.code == 64
    assert codes(ran) == ["RARMS179"]
    assert ran.err.startswith(f"Usage: rarms {words[0]}")


def test_answer_that_was_given_stays_only_one(folder: Path) -> None:
    ran = rarms("plan", "-f", str(folder), "--json", "--out", str(folder / "no" / "such" / "robot.plan"))

    assert ran.code == 1
    assert json.loads(ran.out)["kind"] == "plan"
    assert "RARMS177" in ran.err


def test_without_json_standard_output_stays_empty(folder: Path) -> None:
    ran = rarms("plan", "-f", str(folder), "--host", "nowhere")

    assert (ran.code, ran.out) == (64, "")


def test_run_streams_steps_and_ends_with_report(folder: Path) -> None:
    applied = rarms("apply", "-f", str(folder), "--auto-approve", "--json").out
    undone = rarms("undo", "-f", str(folder), "--auto-approve", "--json").out

    for text in (applied, undone):
        *steps, report = map(json.loads, text.splitlines())
        for line in text.splitlines():
            check(line)
        assert [step["number"] for step in steps] == list(range(1, steps[0]["total"] + 1))
        assert {step["kind"] for step in steps} == {"step"}
        assert {step["status"] for step in steps} == {"changed"}
        assert (report["kind"], report["ending"]) == ("run", "done")
