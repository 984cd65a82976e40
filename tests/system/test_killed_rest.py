"""`rarms measure --stop-partitions`, ended without any clean-up: what it stopped is started by the next command."""

import subprocess
import sys
from itertools import cycle
from pathlib import Path

from rarms_iac.storage import disk
from tests.crashing import KILLED, CrashingDisk
from tests.effort import LONG
from tests.files import copy_files, machines_on
from tests.needs import CHECKOUT
from tests.robots import a_measured, a_robot_of
from tests.unit.cli import running
from tests.unit.cli.running import Ran

MANIFEST = a_robot_of(
    a_measured(until="samples: 20", reserve="45 %", processors=None),
    "  speech: { criticality: 5, memory: 512 MiB, cpu: { reserve: 20 % } }\n",
)
MEASURE = ("measure", "vision", "--from", "50%", "--to", "50%", "--stop-partitions")
NEXT = (MEASURE, ("start", "--auto-approve"), ("apply", "--auto-approve"))
TRIED = 5
"""Kills of a usual run, evenly over all effects."""


def killed(folder: Path, *words: str, at: int) -> int:
    """The exit code of a process of its own that was ended half-way through its effect of this number."""
    words = ("-m", "tests.crashing", str(at), "half", *words, "-f", str(folder))
    return subprocess.run([sys.executable, *words], cwd=CHECKOUT, capture_output=True, timeout=120).returncode


def rarms(folder: Path, *words: str) -> Ran:
    return running.rarms(*words, "-f", str(folder))


def machines(folder: Path) -> dict[str, tuple[str, bool]]:
    """What there is: its state by name, and whether its mark says that rarms stopped it."""
    found = machines_on(folder)
    return {
        machine["settings"]["name"]: (machine["state"], machine["notes"].endswith("measuring")) for machine in found
    }


def test_killed_anywhere_next_command_starts_what_was_stopped(tmp_path: Path) -> None:
    applied = tmp_path / "applied"
    applied.mkdir()
    (applied / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    assert rarms(applied, "apply", "--auto-approve").code == 0
    whole = copy_files(applied, tmp_path / "whole")
    counting = CrashingDisk(0)
    with disk.use(counting):
        assert rarms(whole, *MEASURE).code == 0
    effects = len(counting.effects)
    as_applied = {"speech": ("running", False), "vision": ("running", False)}
    assert machines(whole) == as_applied
    after, left_stopped = cycle(NEXT), 0

    for at in range(1, effects, 1 if LONG else max(1, effects // TRIED)):
        folder = copy_files(applied, tmp_path / f"killed-{at}")
        assert killed(folder, *MEASURE, at=at) == KILLED
        left_stopped += ("off", True) in machines(folder).values()
        words = next(after)

        again = rarms(folder, *words)

        assert again.code == 0, (at, words, again.err)
        if words is not MEASURE:  # P1 and P2 are not theirs to remove
            assert rarms(folder, *MEASURE).code == 0
        assert machines(folder) == as_applied, (at, words, again.err)
        assert rarms(folder, "drift").code == 0
    assert left_stopped > 1
