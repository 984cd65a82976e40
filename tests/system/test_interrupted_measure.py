"""Ctrl-C and SIGKILL while a process measures: the same command goes on, and nothing is left behind."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.files import machines_on

MANIFEST = """\
schema: rarms/v1

application: { name: robot }
policy: { interference: busy-loop }

hosts:
  onboard: { logical_processors: 2, memory: 4 GiB }

components:
  vision:
    criticality: 30
    run: { command: [vision], until: { samples: 1500 }, samples: { from: per_run } }
    memory: 512 MiB
    processors: 2
    simulation: { work: 20 ms, varies: 2 % }
  audio:
    criticality: 40
    run: { command: [audio], until: { samples: 2 }, samples: { from: per_run } }
    memory: 512 MiB
    processors: 2
    simulation: { work: 20 ms, varies: 2 % }
"""
WORDS = [sys.executable, "-m", "rarms_iac.cli.main", "measure", "vision", "audio", "--from", "50%", "--to", "80%"]
ALL = [50, 60, 70, 80]


def log_of(folder: Path) -> Path:
    return folder / "measurements" / "onboard" / "vision" / "busy-loop.jsonl"


def ended_by(number: signal.Signals, folder: Path) -> tuple[int, str, str]:
    """Exit code and output of a measurement that got this signal once its first log was begun."""
    (folder / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    process = subprocess.Popen(WORDS, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    until = time.monotonic() + 120
    while not log_of(folder).exists() and process.poll() is None and time.monotonic() < until:
        time.sleep(0.02)
    process.send_signal(number)
    out, err = process.communicate(timeout=300)
    return process.returncode, out, err


def goes_on(folder: Path, known: int) -> None:
    """Run the same command again: it measures what is missing, and nothing that was recorded."""
    before = log_of(folder).read_bytes()
    again = subprocess.run(WORDS, cwd=folder, capture_output=True, text=True, timeout=300)
    assert again.returncode == 0, again.stderr
    assert log_of(folder).read_bytes().startswith(before[: before.rfind(b"\n") + 1])
    assert reserves(folder) == ALL
    earlier = f", {known} of them by an earlier run" if known else ""
    assert f" 8 settings{earlier}." in " ".join(again.stdout.split())
    assert machines_on(folder) == []


def reserves(folder: Path) -> list[int]:
    """What is recorded whole, in order; the first line is the header."""
    lines = log_of(folder).read_text(encoding="utf-8").split("\n")[1:-1]
    return [json.loads(line)["record"]["Recorded"]["setting"]["reserve"] for line in lines]


@pytest.mark.needs("posix")
def test_interrupted_measurement_goes_on(tmp_path: Path) -> None:
    code, out, err = ended_by(signal.SIGINT, tmp_path)

    assert code == 130, err
    assert "Run the same command to continue" in err
    assert [line.split()[0].rstrip(":") for line in out.splitlines() if "stopped" in line or "not begun" in line] == [
        "vision",
        "audio",
    ], "as they were named, and none left out"
    assert machines_on(tmp_path) == []
    recorded = reserves(tmp_path)
    assert recorded == ALL[: len(recorded)] != ALL
    goes_on(tmp_path, len(recorded))


@pytest.mark.needs("posix")
@pytest.mark.sample
def test_killed_measurement_repeats_no_finished_setting(tmp_path: Path) -> None:
    code, _, err = ended_by(signal.SIGKILL, tmp_path)

    assert code == -signal.SIGKILL, err
    recorded = reserves(tmp_path)
    assert recorded == ALL[: len(recorded)] != ALL, "it was killed while it measured"
    goes_on(tmp_path, len(recorded))
