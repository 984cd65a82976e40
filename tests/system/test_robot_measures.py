"""Measuring, running and proving on a robot behind a real sshd, which is this machine, with components of its own."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from rarms_iac.storage.datalog.files import read_log
from tests.contracts.benches import forget_host, slice_of
from tests.contracts.test_measuring_contract import JOBS
from tests.remote import Remote, a_server
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
    with a_server(tmp_path_factory.mktemp("server"), partial(on_robot, robot_rarms)) as remote:
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
    (experiment,) = json.loads(measured.out)["experiments"]
    log = read_log(Path(experiment["log"]))
    assert Path(experiment["log"]).is_relative_to(robot.here)
    assert log is not None
    assert len(log.recorded) >= experiment["new"] == 2
    assert not (robot.there / "measurements").exists()

    for folder in (robot.here, robot.there):
        (folder / "jobs.py").write_text(f"{JOBS}# another\n", encoding="utf-8")
    other: Any = json.loads(robot.run(*MEASURE).out)
    assert [each["new"] for each in other["experiments"]] == [2], "the log of another program is begun anew"
    again: Any = json.loads(robot.run(*MEASURE).out)
    assert [each["new"] for each in again["experiments"]] == [0]
    tuned = robot.run("tune", "--json")
    assert json.loads(tuned.out)["run"]["ending"] == "nothing_to_do", tuned.err
    assert robot.run("apply", "--auto-approve").code == 0
    proven = robot.run("prove", "--load-host", "--samples", "30", "--json")
    assert json.loads(proven.out)["proofs"][0]["host"] == "here", proven.err
    assert (robot.here / "measurements/here/eyes.configuration.jsonl").exists()


def test_another_file_there_is_named(robot: Robot) -> None:
    (robot.there / "jobs.py").write_text(f"{JOBS}# another\n", encoding="utf-8")

    measured = robot.run("measure", "eyes")

    assert measured.code == 3
    assert "jobs.py differs in" in " ".join(measured.err.split())
