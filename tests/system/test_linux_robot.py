"""The real components of the Linux delivery robot: each does a few jobs, and says them as its manifest reads them."""

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.needs import CHECKOUT, ROBOT_PYTHON, require

ROBOT = CHECKOUT / "manifests" / "delivery-robot-linux"


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the robot with what its camera sees and its microphone hears."""
    require("robot")
    folder = tmp_path_factory.mktemp("robot")
    subprocess.run([CHECKOUT / "scripts" / "make-robot", folder], check=True, timeout=300)
    return folder


def output(robot: Path, *words: str) -> list[str]:
    command = [str(ROBOT_PYTHON), *words]
    done = subprocess.run(command, cwd=robot, capture_output=True, text=True, encoding="utf-8", timeout=120, check=True)
    return done.stdout.splitlines()


def test_faces_are_found_in_most_frames(robot: Path) -> None:
    samples: list[Any] = [json.loads(line) for line in output(robot, "components/face_detection.py", "12")]

    assert len(samples) == 12
    assert sum(sample["found"] for sample in samples) >= 11
    assert all(sample["response"] > 0 for sample in samples)


def test_every_spoken_command_is_understood(robot: Path) -> None:
    lines = output(robot, "components/speech_recognition.py", "7")
    heard = [re.fullmatch(r"heard (.+) ok=1 ms=([0-9.]+)", line) for line in lines]

    assert None not in heard, lines
    assert len({match[1] for match in heard if match}) == 7


def test_command_waits_for_its_period(robot: Path) -> None:
    lines = output(robot, "components/speech_recognition.py", "--period-ms", "1", "7")
    waited = [float(line.rpartition("=")[2]) for line in lines]

    assert waited[-1] > waited[0], "commands that come faster than they are understood wait longer and longer"


def test_frames_arrive_as_plausible_jpeg(robot: Path) -> None:
    frames: list[Any] = [json.loads(line) for line in output(robot, "components/video_streaming.py", "5")]

    assert [frame["frames"] for frame in frames] == [1] * 5
    assert all(20_000 < frame["bytes"] < 1920 * 1080 for frame in frames)
    assert all(frame["response"] > 0 for frame in frames)


def test_ways_are_cheapest_around_furniture_and_turns() -> None:
    code = (
        "from components.path_planning import SIZE, cheapest, plan\n"
        "goal = (SIZE - 1, SIZE - 1)\n"
        "assert cheapest(frozenset(), (0, 0), goal) == 2 * (SIZE - 1) + 2, 'straight, a turn, straight'\n"
        "assert cheapest(frozenset({(1, 0), (0, 1)}), (0, 0), goal) is None, 'walled in'\n"
        "ways = [plan() for _ in range(5)]\n"
        "assert all(way is None or way > 2 * (SIZE - 1) for way in ways) and any(ways), ways\n"
    )

    done = subprocess.run([sys.executable, "-B", "-c", code], cwd=ROBOT, capture_output=True, text=True, timeout=60)

    assert (done.returncode, done.stderr) == (0, "")
