"""`rarms measure --stop-partitions`, ended without any clean-up: what it stopped is started by whatever comes next."""

import json
import subprocess
import sys
from itertools import cycle
from pathlib import Path

from tests.crashing import KILLED
from tests.effort import LONG
from tests.needs import CHECKOUT

MANIFEST = """\
schema: rarms/v1
application: { name: robot }
hosts:
  onboard: { logical_processors: 2, memory: 4 GiB }
components:
  vision:
    criticality: 30
    apt: { mean_response_time: { at_most: 50 ms } }
    run: { command: [vision], until: { samples: 20 }, samples: { from: per_run } }
    cpu: { reserve: 45 % }
    memory: 512 MiB
    simulation: { work: 20 ms, varies: 2 % }
  speech: { criticality: 5, memory: 512 MiB, cpu: { reserve: 20 % } }
"""
MEASURE = ("measure", "vision", "--from", "50%", "--to", "50%", "--stop-partitions")
NEXT = (MEASURE, ("start", "--auto-approve"), ("apply", "--auto-approve"))
TRIED = 5
"""Kills of a usual run, evenly over all effects."""


def rarms(folder: Path, *words: str, at: int = 0) -> subprocess.CompletedProcess[str]:
    """In a process of its own, ended half-way through its effect of this number (0: not at all)."""
    return subprocess.run(
        [sys.executable, "-m", "tests.crashing", str(at), "half", *words, "-f", str(folder)],
        cwd=CHECKOUT,
        capture_output=True,
        encoding="utf-8",
        timeout=120,
    )


def applied(folder: Path) -> Path:
    folder.mkdir()
    (folder / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    assert rarms(folder, "apply", "--auto-approve").returncode == 0
    return folder


def machines(folder: Path) -> dict[str, tuple[str, bool]]:
    """What there is: its state by name, and whether its mark says that rarms stopped it."""
    host = json.loads((folder / ".rarms" / "hosts" / "onboard.json").read_text(encoding="utf-8"))
    found = host["content"]["machines"].values()
    return {
        machine["settings"]["name"]: (machine["state"], machine["notes"].endswith("measuring")) for machine in found
    }


def test_killed_anywhere_the_next_command_starts_what_was_stopped(tmp_path: Path) -> None:
    whole = applied(tmp_path / "whole")
    ran = rarms(whole, *MEASURE)
    assert ran.returncode == 0, ran.stderr
    effects = int(ran.stderr.rpartition("effects: ")[2])
    as_applied = {"speech": ("running", False), "vision": ("running", False)}
    assert machines(whole) == as_applied
    after, left_stopped = cycle(NEXT), 0

    for at in range(1, effects, 1 if LONG else max(1, effects // TRIED)):
        folder = applied(tmp_path / f"killed-{at}")
        assert rarms(folder, *MEASURE, at=at).returncode == KILLED
        left_stopped += ("off", True) in machines(folder).values()
        words = next(after)

        again = rarms(folder, *words)
        if words is not MEASURE and "earlier" in again.stderr:  # that finished the stop or start; nothing else was done
            again = rarms(folder, *words)

        assert again.returncode == 0, (at, words, again.stderr)
        if words is not MEASURE:  # P1 and P2 are not theirs to remove
            assert rarms(folder, *MEASURE).returncode == 0
        assert machines(folder) == as_applied, (at, words, again.stderr)
        assert rarms(folder, "drift").returncode == 0
    assert left_stopped > 1
