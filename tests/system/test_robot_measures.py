"""Measuring, running and proving on a robot behind a real sshd, which is this machine, with components of its own."""

import json
import os
import signal
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from rarms_iac.providers.cgroups.provider import STATE_FOLDER
from rarms_iac.robot.__main__ import SETTINGS_FILE
from rarms_iac.storage.datalog.files import read_log
from rarms_iac.storage.writing import hold
from tests.contracts.benches import forget_host, slice_of
from tests.contracts.test_measuring_contract import JOBS
from tests.remote import Remote, a_server, descendants
from tests.robot_install import on_robot, robot_rarms
from tests.system.test_linux_measured import MANIFEST
from tests.unit.cli.running import Ran, rarms

__all__ = ["robot_rarms"]

MEASURE = (
    "measure",
    "eyes",
    "--from",
    "60%",
    "--to",
    "80%",
    "--step",
    "20%",
    "--samples",
    "30",
    "--weak-load",
    "--json",
)

pytestmark = [pytest.mark.needs("ssh", "control-groups", "mounts"), pytest.mark.alone]


@pytest.fixture(scope="module")
def server(robot_rarms: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Remote]:
    """A robot with a variable of its own."""
    settings = tmp_path_factory.mktemp("settings")
    (settings / "environment").write_text("CAMERA_TOKEN=token of the robot\n", encoding="utf-8")
    mount = f"mkdir -p {SETTINGS_FILE.parent} && mount --bind {settings} {SETTINGS_FILE.parent}"
    with a_server(tmp_path_factory.mktemp("server"), lambda words: on_robot(robot_rarms, words, mount)) as remote:
        yield remote


@dataclass(frozen=True)
class Robot:
    """The manifest's folder here, and its copy there."""

    here: Path
    there: Path

    def run(self, command: str, *words: str) -> Ran:
        return rarms(command, *words, "-f", str(self.here))


@pytest.fixture
def robot(server: Remote, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Robot]:
    robot = Robot(tmp_path / "here", tmp_path / "there")
    connect = f"linux\n    connect: {{ ssh: cell, folder: '{robot.there}' }}\n"
    text = MANIFEST.format(processors=2, slice=slice_of(tmp_path)).replace("linux\n", connect).replace("25 ms", "1 s")
    for folder in (robot.here, robot.there):
        folder.mkdir()
        (folder / "jobs.py").write_text(JOBS, encoding="utf-8")
    (robot.here / "rarms.yaml").write_text(text, encoding="utf-8")
    monkeypatch.setenv("PATH", server.environment["PATH"])
    yield robot
    forget_host(tmp_path)


def test_measure_plan_apply_prove_over_ssh(robot: Robot) -> None:
    ran = robot.run("run", "eyes", "--host", "here", "--samples", "20")
    assert ran.code == 0, ran.err
    measured = robot.run(*MEASURE)
    assert measured.code == 0, measured.err
    assert "eyes with busy-loop on here: 2 to 3 settings" in " ".join(measured.err.split()), "progress of the robot"
    (experiment,) = json.loads(measured.out)["experiments"]
    log = read_log(Path(experiment["log"]))
    assert Path(experiment["log"]).is_relative_to(robot.here)
    assert log is not None
    assert len(log.recorded) >= experiment["new"] == 2
    assert not (robot.there / "measurements").exists()

    for folder in (robot.here, robot.there):
        (folder / "jobs.py").write_text(f"{JOBS}# another\n", encoding="utf-8")
    other: Any = json.loads(robot.run(*MEASURE).out)
    assert [each["new"] for each in other["experiments"]] == [2], "the log of another program is a new one"
    again: Any = json.loads(robot.run(*MEASURE).out)
    assert [each["new"] for each in again["experiments"]] == [0]
    tuned = robot.run("tune", "--json")
    assert json.loads(tuned.out)["run"]["ending"] == "nothing_to_do", tuned.err
    assert robot.run("apply", "--auto-approve").code == 0
    proven = robot.run("prove", "--load-host", "--samples", "30", "--json")
    assert json.loads(proven.out)["proofs"][0]["host"] == "here", proven.err
    assert (robot.here / "measurements/here/eyes.configuration.jsonl").exists()


def test_from_env_is_read_on_the_robot(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CAMERA_TOKEN", "token of this side")
    manifest = robot.here / "rarms.yaml"
    text = manifest.read_text(encoding="utf-8")
    of_camera = "      environment: { TOKEN: { from_env: CAMERA_TOKEN } }\n      until:"
    manifest.write_text(text.replace("      until:", of_camera), encoding="utf-8")
    for folder in (robot.here, robot.there):
        (folder / "jobs.py").write_text(
            f"import os\nassert os.environ['TOKEN'] == 'token of the robot'\n{JOBS}", "utf-8"
        )

    ran = robot.run("run", "eyes", "--samples", "5")
    manifest.write_text(manifest.read_text(encoding="utf-8").replace("CAMERA_TOKEN", "HOME"), encoding="utf-8")
    refused = robot.run("run", "eyes", "--samples", "5")

    assert ran.code == 0, ran.err
    assert refused.code == 1, "rarms starts there with an empty environment"
    assert "Set HOME in the environment of rarms; on a Linux host over ssh, in /etc/rarms/environment." in " ".join(
        refused.err.split()
    )


def test_file_that_differs_on_robot_is_named(robot: Robot) -> None:
    (robot.there / "jobs.py").write_text(f"{JOBS}# another\n", encoding="utf-8")

    measured = robot.run("measure", "eyes")

    assert measured.code == 3
    assert "jobs.py differs in" in " ".join(measured.err.split())


@pytest.mark.parametrize(
    ("command", "advice"),
    [
        (("measure", "eyes"), "rarms was interrupted. Results are saved; run the same command to continue."),
        (("apply", "--auto-approve", "PLAN"), "Stopped. "),
    ],
    ids=["measure", "apply"],
)
def test_ctrl_c_while_robot_waits_is_usual_end(
    robot: Robot, server: Remote, tmp_path: Path, command: tuple[str, ...], advice: str
) -> None:
    plan = tmp_path / "plan.json"
    text = (robot.here / "rarms.yaml").read_text(encoding="utf-8").replace("measured", "0.5 LP")
    (robot.here / "fixed.yaml").write_text(text, encoding="utf-8")
    assert rarms("plan", "-f", str(robot.here / "fixed.yaml"), "--out", str(plan)).code == 0
    lock = STATE_FOLDER / slice_of(tmp_path) / "lock"

    def interrupt() -> None:
        while not any(_waits_for(process, lock) for process in descendants(server.pid)):
            time.sleep(0.02)
        os.kill(os.getpid(), signal.SIGINT)

    lock.parent.mkdir(mode=0o700, parents=True)
    with hold(lock, "a test", 0):
        interrupting = Thread(target=interrupt)
        interrupting.start()
        words = [str(plan) if word == "PLAN" else word for word in command]
        ended = robot.run(*words, "--lock-timeout", "60s")
        interrupting.join()

    assert ended.code == 130, ended
    assert advice in " ".join(ended.err.split())
    assert "error" not in ended.err


def _waits_for(process: int, lock: Path) -> bool:
    """Whether a process has opened a lock to hold it; who only looks at it opens it to read."""
    with suppress(OSError):
        for link in Path(f"/proc/{process}/fd").iterdir():
            if link.readlink() == lock:
                flags = Path(f"/proc/{process}/fdinfo/{link.name}").read_text(encoding="ascii").split()[3]
                return int(flags, 8) & os.O_RDWR != 0
    return False
