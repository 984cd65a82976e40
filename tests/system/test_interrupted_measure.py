"""Ctrl-C while a real process measures: it says that the same command goes on, and leaves nothing behind."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

MANIFEST = """\
schema: rarms/v1

application: { name: robot }

hosts:
  onboard: { logical_processors: 2, memory: 4 GiB }

components:
  vision:
    criticality: 30
    run: { command: [vision], until: { samples: 1500 }, samples: { from: per_run } }
    memory: 512 MiB
    simulation: { work: 20 ms, varies: 2 % }
  audio:
    criticality: 40
    run: { command: [audio], until: { samples: 2 }, samples: { from: per_run } }
    memory: 512 MiB
    simulation: { work: 20 ms, varies: 2 % }
"""
WORDS = [
    sys.executable,
    "-m",
    "rarms_iac.cli.main",
    "measure",
    "vision",
    "audio",
    "--from",
    "50%",
    "--to",
    "80%",
]


@pytest.mark.needs("posix")
def test_ctrl_c_ends_a_measurement_that_the_same_command_goes_on_with(tmp_path: Path) -> None:
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    log = tmp_path / "measurements" / "onboard" / "vision" / "busy-loop.jsonl"
    process = subprocess.Popen(WORDS, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    until = time.monotonic() + 60
    while not log.exists() and process.poll() is None and time.monotonic() < until:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)

    assert process.returncode == 130, err
    assert "the same command goes on" in err
    assert [line.split()[0] for line in out.splitlines() if "stopped" in line or "not begun" in line] == [
        "vision",
        "audio",
    ], "as they were named, and none left out"
    host = json.loads((tmp_path / ".rarms" / "hosts" / "onboard.json").read_text(encoding="utf-8"))
    assert host["content"]["machines"] == {}
    before = log.read_bytes()
    recorded = reserves(log)
    assert recorded == [50, 60, 70, 80][: len(recorded)]
    assert len(recorded) < 4
    again = subprocess.run(WORDS, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert again.returncode == 0, again.stderr
    assert log.read_bytes().startswith(before), "nothing that was recorded was run again"
    assert reserves(log) == [50, 60, 70, 80]
    assert f"by 8 settings, {8 - len(recorded)} of them new" in again.stdout


def reserves(log: Path) -> list[int]:
    """What is recorded, in order; the first line is the header."""
    return [json.loads(line)["reserve"] for line in log.read_text(encoding="utf-8").splitlines()[1:]]
