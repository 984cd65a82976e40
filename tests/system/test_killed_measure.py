"""`rarms measure`, the command itself, ended without any clean-up: run again, it ends as if nothing had been.

As processes that really end, at effects on files (all of them with RARMS_LONG=1) and by SIGKILL at no matter what.
"""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

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
    run: { command: [vision], until: { samples: SAMPLES }, samples: { from: per_run } }
    cpu: { reserve: measured }
    memory: 512 MiB
    simulation: { work: 20 ms, varies: 2 % }
"""
TRIED = 4
"""Kills of a usual run, evenly over all effects."""


def a_folder(folder: Path, samples: int = 20) -> Path:
    folder.mkdir()
    text = MANIFEST.replace("SAMPLES", str(samples))
    (folder / "rarms.yaml").write_text(text, encoding="utf-8", newline="\n")
    return folder


def measure(folder: Path, at: int = 0, *, last: str = "60%") -> subprocess.CompletedProcess[str]:
    """In a process of its own, ended half-way through its effect of this number (0: not at all)."""
    words = ["measure", "-f", str(folder), "--from", "50%", "--to", last, "--step", "10%"]
    return subprocess.run(
        [sys.executable, "-m", "tests.crashing", str(at), "half", *words],
        cwd=CHECKOUT,
        capture_output=True,
        encoding="utf-8",
        timeout=120,
    )


def settings(folder: Path) -> list[dict[str, object]]:
    """What is recorded, without the time."""
    log = folder / "measurements" / "onboard" / "vision" / "busy-loop.jsonl"
    whole = [line for line in log.read_text(encoding="utf-8").split("\n")[1:-1] if line.endswith("}")]
    found = [json.loads(line) for line in whole]
    return [{key: setting[key] for key in ("reserve", "beside", "seed", "series")} for setting in found]


def machines(folder: Path) -> dict[str, object]:
    host = json.loads((folder / ".rarms" / "hosts" / "onboard.json").read_text(encoding="utf-8"))
    found = host["content"]["machines"]
    assert isinstance(found, dict)
    return found


def leftovers(folder: Path) -> Iterator[Path]:
    return folder.rglob("*.new")


def test_killed_at_a_write_the_same_command_goes_on_and_leaves_nothing_behind(tmp_path: Path) -> None:
    whole = a_folder(tmp_path / "whole")
    effects = int(measure(whole).stderr.rpartition("effects: ")[2])
    left_machines = left_files = 0

    for at in range(1, effects, 1 if LONG else effects // TRIED):
        folder = a_folder(tmp_path / f"killed-{at}")
        killed = measure(folder, at)
        assert killed.returncode == KILLED, killed.stderr
        state = folder / ".rarms" / "hosts" / "onboard.json"
        left_machines += state.exists() and bool(machines(folder))
        left_files += any(leftovers(folder))
        again = measure(folder)

        assert again.returncode == 0, (at, again.stderr)
        assert settings(folder) == settings(whole), at
        assert machines(folder) == {}, at
        assert not list(leftovers(folder)), at
    assert left_machines, "a kill leaves P1 and P2 behind, which the next run removes"
    assert left_files or not LONG


@pytest.mark.needs("posix")
def test_killed_at_no_matter_what_a_finished_setting_is_not_run_again(tmp_path: Path) -> None:
    folder = a_folder(tmp_path / "robot", samples=1500)
    log = folder / "measurements" / "onboard" / "vision" / "busy-loop.jsonl"
    words = [sys.executable, "-m", "rarms_iac.cli.main", "measure", "-f", str(folder), "--from", "50%"]
    process = subprocess.Popen([*words, "--to", "80%"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    until = time.monotonic() + 60
    while not log.exists() and process.poll() is None and time.monotonic() < until:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    assert process.wait(timeout=60) == -signal.SIGKILL, "it was killed while it measured"
    before = log.read_bytes()
    known = len(settings(folder))
    again = measure(folder, last="80%")

    assert again.returncode == 0, again.stderr
    assert known < 4
    assert [setting["reserve"] for setting in settings(folder)] == [50, 60, 70, 80]
    assert log.read_bytes().startswith(before[: before.rfind(b"\n") + 1])
    assert f"{4 - known} of them new" in again.stdout
    assert machines(folder) == {}
