"""Two branches that both measured: their data logs, merged by git, plan like one log."""

import json
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path
from typing import Any

import pytest

from tests.fluid import without_scheduler
from tests.measuring import the_log
from tests.robots import a_measured, a_robot_of
from tests.unit.cli.running import rarms

pytestmark = pytest.mark.needs("git")

MANIFEST = a_robot_of(a_measured(at_most="60 ms", until="samples: 5")).replace("[vision]", "[python3, vision.py]")
LOG = Path("measurements", "onboard", "vision", "busy-loop.jsonl")
PROGRAM = Path("vision.py")


def git(*words: str, fails: bool = False) -> str:
    command = ["git", "-c", "user.name=a", "-c", "user.email=a@b", "-c", "merge.conflictStyle=diff3", *words]
    ran = subprocess.run(command, check=not fails, capture_output=True, text=True)
    assert not fails or ran.returncode
    return ran.stdout


def commit(message: str) -> None:
    git("add", "--all")
    git("commit", "--quiet", "--message", message)


def measure(first: int, last: int) -> int:
    """Measure from one reserve to another in steps of 10 %; return how many settings were new."""
    ran = rarms("measure", "--from", f"{first}%", "--to", f"{last}%", "--json")
    assert ran.code == 0, ran.err
    return sum(experiment["new"] for experiment in json.loads(ran.out)["experiments"])


def branch(name: str, first: int, last: int, *, program: str = "") -> None:
    """Measure on a branch, maybe another program, and commit."""
    git("checkout", "--quiet", "-b", name, "main")
    if program:
        PROGRAM.write_text(program, encoding="utf-8")
    measure(first, last)
    commit(name)


def planned() -> Any:
    """What a plan reserves and its findings, without what is new in each plan and the count of unused settings."""
    ran = rarms("plan", "--json")
    assert ran.code == 0, ran.err
    plan = json.loads(ran.out)
    findings = [finding for finding in plan["findings"] if finding["code"] != "RARMS104"]
    return findings, [host["changes"] for host in plan["hosts"]]


def planned_by_one_log(*ranges: tuple[int, int]) -> Any:
    """What is planned where these were measured in one log, with the present files."""
    kept = LOG.read_bytes()
    shutil.rmtree("measurements")
    try:
        for first, last in ranges:
            measure(first, last)
        return planned()
    finally:
        LOG.write_bytes(kept)


@pytest.fixture
def repository(tmp_path: Path) -> Iterator[Path]:
    """A repository as `rarms init` makes it, in which `main` has measured one setting; that is where we are."""
    with chdir(tmp_path), without_scheduler():
        git("init", "--quiet", "--initial-branch=main")
        assert rarms("init").code == 0
        Path("rarms.yaml").write_text(MANIFEST, encoding="utf-8")
        PROGRAM.write_text("print(1)\n", encoding="utf-8")
        measure(30, 30)
        commit("start")
        yield tmp_path


@pytest.mark.usefixtures("repository")
@pytest.mark.parametrize(("ours", "theirs"), [("left", "right"), ("right", "left")])
def test_both_branches_count(ours: str, theirs: str) -> None:
    branch("left", 40, 60)
    branch("right", 50, 80)
    git("checkout", "--quiet", ours)
    git("merge", "--quiet", "--message", "both", theirs)

    assert {setting.reserve for setting in the_log(LOG).settings} == {30, 40, 50, 60, 70, 80}
    assert planned() == planned_by_one_log((30, 30), (40, 60), (50, 80))
    assert measure(30, 80) == 0, "nothing is measured again"


@pytest.mark.usefixtures("repository")
@pytest.mark.parametrize("ours", ["left", "right"])
def test_only_the_present_program_counts(ours: str) -> None:
    branch("left", 40, 60, program="print(2)\n")
    branch("right", 50, 80)
    git("checkout", "--quiet", "left")
    git("merge", "--quiet", "--message", "both", "right")
    PROGRAM.write_text("print(2)\n" if ours == "left" else "print(1)\n", encoding="utf-8")

    expected = [(40, 60)] if ours == "left" else [(30, 30), (50, 80)]
    assert planned() == planned_by_one_log(*expected)
    assert "from other conditions" in " ".join(rarms("explain", "vision").out.split())
    unused = {"left": 5, "right": 3}[ours]
    said = " ".join(rarms("plan", "-v").out.split())
    assert f"busy-loop.jsonl has {unused} settings that were measured under other conditions" in said


@pytest.mark.usefixtures("repository")
def test_logs_that_two_branches_began_are_merged() -> None:
    git("rm", "--quiet", "-r", "measurements")
    commit("nothing measured")
    branch("left", 40, 60)
    branch("right", 50, 80)
    git("merge", "--quiet", "--message", "both", "left")

    assert planned() == planned_by_one_log((50, 80), (40, 60))


@pytest.mark.usefixtures("repository")
def test_conflict_marks_are_named_and_deletable() -> None:
    Path(".gitattributes").unlink()
    commit("no union")
    branch("left", 40, 60)
    branch("right", 50, 80)
    git("merge", "left", fails=True)

    refused = rarms("plan")
    assert refused.code == 4
    assert "it contains the markers of a merge conflict" in " ".join(refused.err.split())
    assert "Delete the lines that begin with <<<<<<<" in " ".join(refused.err.split())
    assert "Delete the lines that begin with <<<<<<<" in " ".join(rarms("measure").err.split())
    lines = LOG.read_bytes().splitlines(keepends=True)
    assert any(line.startswith(b"|||||||") for line in lines)
    LOG.write_bytes(b"".join(line for line in lines if line.startswith(b"{")))
    assert planned() == planned_by_one_log((30, 30), (50, 80), (40, 60))


@pytest.mark.usefixtures("repository")
def test_blank_lines_and_missing_last_end_are_accepted() -> None:
    lines = LOG.read_bytes()
    LOG.write_bytes(b"\n\r\n" + lines.replace(b"\n", b"\n\n").rstrip(b"\n"))

    measure(40, 80)

    assert planned() == planned_by_one_log((30, 30), (40, 80))
    assert len(LOG.read_bytes().split()) == len(lines.split()) + 5
