"""What a command says and asks after one that was killed; that the same command goes on is in test_disturbed.py."""

import json
from collections.abc import Sequence
from contextlib import chdir
from pathlib import Path

import pytest

from rarms_iac.applying import refusals
from rarms_iac.model.version import __version__
from rarms_iac.storage import disk
from tests.crashing import Crash, CrashingDisk, When
from tests.files import machines_on
from tests.unit.cli.running import rarms

MANIFEST = """\
schema: rarms/v1
application: { name: robot }
hosts:
  left: { logical_processors: 2, memory: 4 GiB }
  right: { logical_processors: 2, memory: 4 GiB }
components:
  vision: { criticality: 9, memory: 512 MiB, cpu: { reserve: 40 % }, hosts: [left] }
  speech: { criticality: 5, memory: 512 MiB, cpu: { reserve: 20 % }, hosts: [right] }
"""


def prepared(folder: Path, before: Sequence[Sequence[str]]) -> Path:
    """A folder with a manifest, in which these commands ran."""
    folder.mkdir()
    (folder / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    with chdir(folder):
        for words in before:
            assert rarms(*words, "--auto-approve").code == 0
    return folder


def test_killed_command_answers_a_program_once(tmp_path: Path) -> None:
    start = prepared(tmp_path / "start", [["apply"]])
    with chdir(start):
        with disk.use(CrashingDisk(12)), pytest.raises(Crash):
            rarms("destroy", "--auto-approve")

        again = rarms("destroy", "--auto-approve", "--json")

    lines = [json.loads(line) for line in again.lines]
    (run,) = [line for line in lines if line["kind"] == "run"]
    assert run is lines[-1]
    assert run["ending"] == "done"
    assert [(host["host"], host["resumed"]) for host in run["hosts"]] == [("left", True), ("right", False)]


def test_killed_undo_is_not_applied_again_unasked(tmp_path: Path) -> None:
    start = prepared(tmp_path / "start", [["apply"]])
    with chdir(start):
        with disk.use(CrashingDisk(12)), pytest.raises(Crash):
            rarms("undo", "--auto-approve")

        refused = rarms("plan")
        applied = rarms("apply")

    assert "Otherwise run `rarms undo` to finish the run" in " ".join(refused.err.split())
    assert (refused.code, applied.code) == (3, 64), "it finishes the undo, and then there is no terminal to ask at"
    assert [len(machines_on(start, host)) for host in ("left", "right")] == [0, 1]


def test_destroyed_target_may_be_destroyed_again(tmp_path: Path) -> None:
    start = prepared(tmp_path / "start", [["apply"]])
    line = next(line for line in MANIFEST.splitlines(keepends=True) if "speech" in line)
    (start / "rarms.yaml").write_text(MANIFEST.replace(line, ""), encoding="utf-8", newline="\n")
    with chdir(start):
        first, again = (rarms("destroy", "--target", "partition/speech", "--auto-approve") for _ in range(2))
        misspelt = rarms("destroy", "--target", "partition/speach", "--auto-approve")

    assert (first.code, again.code, misspelt.code) == (0, 0, 4)
    assert 'Did you mean "partition/speech"?' in " ".join(misspelt.err.split())


def test_run_of_another_version_is_closed_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    start = prepared(tmp_path / "start", [])
    with chdir(start):
        with disk.use(CrashingDisk(12)), pytest.raises(Crash):
            rarms("apply", "--auto-approve")
        monkeypatch.setattr(refusals, "__version__", "9.9")

        for words in ("apply", "undo", "destroy", "plan"):
            refused = rarms(words, *([] if words == "plan" else ["--auto-approve"]))
            said = " ".join(refused.err.split())
            assert refused.code == 3, words
            assert f"started by rarms {__version__}, is unfinished. This is rarms 9.9." in said, words
            assert "run `rarms install --host left`" in said, words

        assert rarms("apply", "--abandon").code == 0
        monkeypatch.undo()
        assert rarms("apply", "--auto-approve").code == 0


def test_killed_init_is_run_again(tmp_path: Path) -> None:
    counting = CrashingDisk(0)
    with disk.use(counting):
        assert rarms("init", str(tmp_path / "whole")).code == 0

    for at in range(1, len(counting.effects) + 1):
        folder = tmp_path / str(at)
        with disk.use(CrashingDisk(at, When.HALF)), pytest.raises(Crash):
            rarms("init", str(folder))

        if not (folder / "rarms.yaml").exists():
            assert rarms("init", str(folder)).code == 0

        left = {file.name for file in folder.iterdir() if not file.name.endswith(".new")}
        assert left == {".gitattributes", "rarms.yaml", "rarms.schema.json"}, at
