"""`rarms tune`, the command itself, killed in the middle of a setting: run again, it ends as if nothing had been."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import chdir
from pathlib import Path

import pytest

from tests.files import copy_files
from tests.needs import CHECKOUT
from tests.unit.cli.running import rarms

MANIFEST = """\
schema: rarms/v1

application: { name: robot }

hosts:
  onboard: { logical_processors: 2, memory: 4 GiB }

components:
  vision:
    criticality: 30
    apt: { mean_response_time: { at_most: 25 ms } }
    memory: 512 MiB
    cpu: { reserve: measured }
    simulation: { work: 20 ms, varies: 2 % }

  paths:
    criticality: 20
    apt: { mean_response_time: { at_most: 65 ms } }
    memory: 512 MiB
    cpu: { reserve: measured }
    simulation: { work: 20 ms, varies: 2 % }

  video:
    criticality: 10
    apt: { mean_response_time: { at_most: 75 ms } }
    memory: 512 MiB
    cpu: { reserve: measured }
    simulation: { work: 20 ms, varies: 2 % }
"""
SAMPLES = "400"
TOGETHER = Path("measurements", "onboard", "paths+video", "busy-loop.jsonl")


def tune(folder: Path) -> subprocess.Popen[str]:
    """In a process of its own."""
    words = ["tune", "-f", str(folder), "--samples", SAMPLES, "--trail", str(folder / "trail.csv")]
    return subprocess.Popen(
        [sys.executable, "-m", "rarms_iac.cli.main", *words],
        cwd=CHECKOUT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        encoding="utf-8",
    )


def to_the_end(folder: Path) -> str:
    process = tune(folder)
    told = process.communicate(timeout=120)[1]
    assert process.returncode == 0, told
    return told


def settings(folder: Path) -> list[dict[str, object]]:
    """What is recorded of both together, without the time."""
    found = [json.loads(line) for line in (folder / TOGETHER).read_text(encoding="utf-8").splitlines()[1:]]
    return [{key: one[key] for key in ("reserve", "beside", "seed", "series")} for one in found]


def trail(folder: Path) -> list[list[str]]:
    """What was asked for, with what came of it, without the time."""
    with (folder / "trail.csv").open(encoding="utf-8", newline="") as rows:
        return [[*row[:1], *row[2:]] for row in csv.reader(rows)]


def machines(folder: Path) -> dict[str, object]:
    """Read the partitions that the simulated host has."""
    host = json.loads((folder / ".rarms" / "hosts" / "onboard.json").read_text(encoding="utf-8"))
    found: dict[str, object] = host["content"]["machines"]
    return found


def killed_after_a_setting(folder: Path) -> None:
    """By SIGKILL, once a setting is recorded."""
    process, log = tune(folder), folder / TOGETHER
    until = time.monotonic() + 120
    while (not log.exists() or log.read_bytes().count(b"\n") < 2) and process.poll() is None:
        assert time.monotonic() < until, "no setting was recorded"
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate(timeout=60)
    assert process.returncode == -signal.SIGKILL, "it was killed while it tuned"


@pytest.mark.needs("posix")
def test_killed_in_the_middle_the_same_command_finds_the_same_and_measures_nothing_twice(tmp_path: Path) -> None:
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    whole.mkdir()
    (whole / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    with chdir(whole):
        assert rarms("measure", "--samples", "60").code == 0
    copy_files(whole, killed)
    to_the_end(whole)
    killed_after_a_setting(killed)
    before = (killed / TOGETHER).read_bytes()
    left_behind = machines(killed)
    assert (killed / "rarms.yaml").read_text(encoding="utf-8") == MANIFEST, "it had not ended"
    told = to_the_end(killed)

    assert (killed / "rarms.yaml").read_bytes() == (whole / "rarms.yaml").read_bytes()
    assert trail(killed) == trail(whole)
    assert settings(killed) == settings(whole)
    reserves = [setting["reserve"] for setting in settings(killed)]
    assert len(set(reserves)) == len(reserves), "none was measured twice"
    assert (killed / TOGETHER).read_bytes().startswith(before[: before.rfind(b"\n") + 1])
    # NOTE: between two settings there is no P1 or P2 that a killed run could leave.
    assert ("RARMS261" in told) == bool(left_behind), "what the killed run left is removed, and said so"
    assert not machines(killed), "P1 and P2 are gone"
