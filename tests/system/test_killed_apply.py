"""`rarms apply`, the command itself, killed at every effect on files: run again, it ends as if nothing had been.

In this process at every effect; as processes of their own, which really end, at some.
"""

import shutil
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import pytest

from rarms_iac.storage import disk
from tests.crashing import KILLED, Crash, CrashingDisk, When
from tests.needs import CHECKOUT
from tests.unit.cli.running import Ran, rarms

CHANGES = (
    ("reserve: 30 %", "reserve: 20 %"),  # gives back
    ("reserve: 20 %, limit: 60 %", "reserve: 30 %"),  # takes more
    ("components:\n", "components:\n  alarm: { criticality: 30, memory: 256 MiB, cpu: { reserve: 0.2 LP } }\n"),
)


def a_folder(folder: Path) -> Path:
    """A folder in which the manifest of `init` is applied and then changed: three partitions are concerned."""
    folder.mkdir()
    assert rarms("init", str(folder), "--name", "robot").code == 0
    manifest = folder / "rarms.yaml"
    assert rarms("apply", "-f", str(manifest), "--auto-approve").code == 0
    text = manifest.read_text(encoding="utf-8")
    for old, new in CHANGES:
        assert old in text
        text = text.replace(old, new, 1)
    manifest.write_text(text, encoding="utf-8", newline="\n")
    return manifest


def files_of(folder: Path) -> Mapping[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def copy_of(files: Mapping[str, bytes], folder: Path) -> Path:
    """The manifest of a folder that holds these files and no others. The path is part of a plan's id."""
    if folder.exists():
        shutil.rmtree(folder)
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    return folder / "rarms.yaml"


def the_host(manifest: Path) -> str:
    """What the host looks like: machines with ids and marks, task classes, serials."""
    return rarms("snapshot", "-f", str(manifest)).out


def was_begun(manifest: Path) -> bool:
    """Whether a run is unfinished: no plan is made then."""
    return rarms("plan", "-f", str(manifest)).code == 3


def run_again(manifest: Path) -> Ran:
    """The same command, without a terminal; what was begun wants no approval either."""
    approval = () if was_begun(manifest) else ("--auto-approve",)
    return rarms("apply", "-f", str(manifest), *approval)


@pytest.fixture
def start(tmp_path: Path) -> Mapping[str, bytes]:
    """The files of the changed manifest and its host."""
    return files_of(a_folder(tmp_path / "start").parent)


def undisturbed(start: Mapping[str, bytes], tmp_path: Path) -> tuple[str, int]:
    """How the host looks after an apply that nobody disturbs, and how many effects on files that has."""
    manifest = copy_of(start, tmp_path / "robot")
    counting = CrashingDisk(0)
    with disk.use(counting):
        assert rarms("apply", "-f", str(manifest), "--auto-approve").code == 0
    return the_host(manifest), len(counting.effects)


@pytest.mark.parametrize("when", [When.HALF, When.AFTER])
def test_a_killed_apply_is_finished_by_the_next_at_every_effect(
    tmp_path: Path, start: Mapping[str, bytes], when: When
) -> None:
    end, effects = undisturbed(start, tmp_path)
    begun = 0

    for at in range(1, effects + 1):
        manifest = copy_of(start, tmp_path / "robot")
        with disk.use(CrashingDisk(at, when)), suppress(Crash):
            rarms("apply", "-f", str(manifest), "--auto-approve")
        begun += was_begun(manifest)
        with disk.use(CrashingDisk(0)):
            again = run_again(manifest)

        assert again.code == 0, (at, again.err)
        assert "Do this?" not in again.err
        assert the_host(manifest) == end, at
        assert rarms("plan", "-f", str(manifest)).code == 0
    assert effects > 50
    assert begun > effects // 2


def test_a_process_that_really_ends_leaves_the_host_free_and_the_run_to_be_finished(
    tmp_path: Path, start: Mapping[str, bytes]
) -> None:
    end, effects = undisturbed(start, tmp_path)

    for at in (1, 3, effects // 3, effects // 2, effects - 1):
        manifest = copy_of(start, tmp_path / "robot")
        words = [sys.executable, "-m", "tests.crashing", str(at), "half", "apply", "-f", str(manifest)]
        killed = subprocess.run([*words, "--auto-approve"], cwd=CHECKOUT, capture_output=True, timeout=60)
        assert killed.returncode == KILLED, killed.stderr.decode()

        approval = () if was_begun(manifest) else ("--auto-approve",)
        again = subprocess.run(
            [sys.executable, "-m", "rarms_iac.cli.main", "apply", "-f", str(manifest), *approval],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=60,
        )

        assert again.returncode == 0, again.stderr.decode()
        assert the_host(manifest) == end, at
