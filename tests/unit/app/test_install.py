"""Installing versions of rarms on a robot: this machine, whose places lie in a folder that root owns."""

import hashlib
import json
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from rarms_iac.app import install, install_wheels
from rarms_iac.app.install import _Done, _RobotSetup
from rarms_iac.app.install_there import RobotPlaces
from rarms_iac.app.install_wheels import LOCK, RobotPython, Wheel, build_name, pins_for, wheels_for
from rarms_iac.app.use_case_errors import UseCaseError
from rarms_iac.providers.channel import ProgramChannel
from rarms_iac.providers.interface import HostFailed, HostLocked, HostRefused
from rarms_iac.storage.shipped import shipped_module, shipped_text
from rarms_iac.storage.writing import hold
from tests.effort import every_few
from tests.robot_wheels import wheels_of

KILLED = 137
KILL = """\
import os, sys
effects, counter = 0, os.open({counter!r}, os.O_WRONLY | os.O_CREAT)
def at_effect(event, arguments):
    global effects
    writes = event == "open" and isinstance(arguments[1], str) and set(arguments[1]) & set("wax")
    if writes or event in ("os.mkdir", "os.rename", "os.symlink", "os.remove", "os.rmdir", "subprocess.Popen"):
        effects += 1
        os.pwrite(counter, b"%d" % effects, 0)
        if effects == {number}:
            os._exit({code})
sys.addaudithook(at_effect)
"""
"""Ends the robot's program at one of its effects."""


@dataclass(frozen=True, slots=True)
class Robot:
    """A robot that is asked by the program's own command."""

    places: RobotPlaces
    setup: _RobotSetup

    def install(self, version: str, wheels: Sequence[Wheel] | None = None, *, needed: int = 0) -> _Done:
        sent = wheels_of(version, self.places.state) if wheels is None else wheels
        digests = {wheel.name: wheel.digest for wheel in wheels_of(version, self.places.state)}
        facts = {"version": version, "build": f"{version}-1", "pip": "pip-0-py3-none-any.whl", "bytes": needed}
        return self.setup.ask({"action": "install", "wheels": digests, **facts}, sent)

    def remove(self) -> _Done:
        return self.setup.ask({"action": "remove"}, ())

    @property
    def versions(self) -> Path:
        return Path(self.places.versions)

    def works(self, name: str = "current") -> str:
        """The version that a link leads to, as its program says."""
        python = str(self.versions / name / "bin" / "python")
        words = [python, "-I", "-m", "rarms_iac"]
        return subprocess.run(words, capture_output=True, text=True, check=True, env={}).stdout.strip()

    def begin(self, version: str, plan: str = "p-1") -> Path:
        """Leave a run that this version began and did not finish."""
        journal = Path(self.places.state, "rarms", "journal.jsonl")
        journal.parent.mkdir(parents=True, exist_ok=True)
        journal.write_text(json.dumps({"kind": "run_started", "plan": plan, "rarms": version}) + "\n", encoding="ascii")
        return journal


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch) -> Iterator[Robot]:
    with tempfile.TemporaryDirectory(prefix="rarms-test-", dir="/opt") as folder:
        Path(folder).chmod(0o755)
        Path(folder, "cron").mkdir()
        names = ("versions", "state", "units", "systemd", "cron")
        places = RobotPlaces(**{name: str(Path(folder, name)) for name in names})
        monkeypatch.setattr(install, "PLACES", places)
        yield Robot(places, _RobotSetup("onboard", ProgramChannel(host="onboard", target="it", words=("sh", "-c"))))


@pytest.mark.needs("linux", "root")
def test_a_newer_version_keeps_the_one_before(robot: Robot) -> None:
    for version in ("1.0", "2.0"):
        robot.install(version)
    done = robot.install("3.0")

    assert done.removed == ("1.0",)
    assert (robot.works(), robot.works("2.0")) == ("3.0", "2.0")
    start, watch = Path(done.boot).read_text().splitlines()
    assert start == f"@reboot root {robot.versions}/current/bin/rarms start --boot"
    assert f"{robot.versions}/current/bin/python -I -m rarms_iac.running.thread_watcher" in watch
    assert sorted(path.name for path in robot.places.builds.iterdir()) == ["2.0-1", "3.0-1"]


@pytest.mark.needs("linux", "root")
def test_the_version_that_began_a_run_finishes_it(robot: Robot) -> None:
    robot.install("1.0")
    journal = robot.begin("1.0")

    done = robot.install("2.0")

    assert [(run.plan, run.version) for run in done.finished] == [("p-1", "1.0")]
    assert json.loads(journal.read_text().splitlines()[-1])["by"] == "1.0"
    assert done.still_open == ()


@pytest.mark.needs("linux", "root")
def test_run_that_no_version_can_finish_is_reported(robot: Robot) -> None:
    robot.install("1.0")
    robot.begin("1.0", plan="stuck")
    (stuck,) = robot.install("2.0").still_open
    assert (stuck.version, stuck.said.strip()) == ("1.0", "RARMS186: the disk says no")
    assert robot.works("1.0") == "1.0", "it is needed still"

    robot.begin("0.9")
    (unknown,) = robot.install("2.0").still_open
    assert (unknown.version, unknown.said) == ("0.9", "")
    assert install._still_open("onboard", unknown).code == "RARMS417"
    assert (
        "rarms 0.9 began the run of plan p-1 and did not finish it. rarms 0.9 is not installed there."
        in install._still_open("onboard", unknown).detail
    )


@pytest.mark.needs("linux", "root")
def test_kill_at_any_effect_leaves_version_that_works(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    robot.install("1.0")
    saved = robot.versions.with_name("saved")
    shutil.copytree(robot.versions, saved, symlinks=True)
    program = shipped_module("app/install_there.py")

    def install_killed(number: int) -> str:
        """Install 2.0 beside 1.0, up to the effect of this number; 0: to the end."""
        shutil.rmtree(robot.versions)
        shutil.copytree(saved, robot.versions, symlinks=True)
        counter = robot.versions.with_name("effects")
        killing = KILL.format(number=number, counter=str(counter), code=KILLED)
        with monkeypatch.context() as patch:
            patch.setattr(install, "shipped_module", lambda _path: f"{killing}\n{program}")
            if number == 0:
                robot.install("2.0")
            else:
                with pytest.raises(HostFailed) as failed:
                    robot.install("2.0")
                assert f"exit code {KILLED}" in failed.value.message
        return counter.read_text()

    total = int(install_killed(0))
    assert total > 10
    for number in every_few(total, 5, first=total):
        install_killed(number + 1)
        assert robot.works() in {"1.0", "2.0"}, number
        robot.install("2.0")
        assert robot.works() == "2.0", number
        assert {path.name for path in robot.versions.iterdir()} == {".builds", ".lock", "1.0", "2.0", "current"}
        assert {path.name for path in robot.places.builds.iterdir()} == {"1.0-1", "2.0-1"}


@pytest.mark.needs("linux", "root")
def test_wheels_that_changed_on_the_way_are_refused(robot: Robot) -> None:
    robot.install("1.0")
    pip, rarms = wheels_of("2.0", robot.places.state)
    damaged = Wheel(name=rarms.name, digest=rarms.digest, content=rarms.content[:-1] + b"?")

    for wheels, message in (((pip, damaged), "and arrived with"), ((pip,), "ended early: torn")):
        with pytest.raises(HostRefused) as refused:
            robot.install("2.0", wheels)
        assert message in refused.value.message
    assert robot.works() == "1.0"
    assert not robot.places.wheels.exists()


@pytest.mark.needs("linux", "root")
def test_a_full_disk_changes_nothing(robot: Robot) -> None:
    robot.install("1.0")

    with pytest.raises(HostRefused) as refused:
        robot.install("2.0", needed=10**18)

    assert "1000000000000 MB are needed" in refused.value.message
    assert robot.works() == "1.0"
    robot.install("2.0")
    assert robot.works() == "2.0", "the command that was recommended"


@pytest.mark.needs("linux", "root")
def test_host_that_run_holds_is_left_alone(robot: Robot) -> None:
    lock = robot.begin("1.0").with_name("lock")
    lock.write_text("robot@cell, process 7")
    with hold(lock, "robot@cell, process 7"), pytest.raises(HostLocked) as refused:
        robot.install("1.0")

    assert refused.value.owner == "robot@cell, process 7"
    assert not (robot.versions / "current").exists()


@pytest.mark.needs("linux", "root")
def test_a_folder_that_others_can_write_is_refused(robot: Robot) -> None:
    robot.install("1.0")
    robot.versions.chmod(0o775)

    with pytest.raises(HostRefused) as refused:
        robot.install("2.0")

    assert f"users other than root can change {robot.versions}" in refused.value.message


@pytest.mark.needs("linux", "root")
def test_nothing_is_removed_below_run_or_partition(robot: Robot) -> None:
    robot.install("1.0")
    journal = robot.begin("1.0")
    with pytest.raises(HostRefused, match="a run is unfinished there: plan p-1 of rarms"):
        robot.remove()

    journal.unlink()
    partition = journal.with_name("1.json")
    partition.write_text("{}")
    with pytest.raises(HostRefused, match="the host still has partitions of rarms, in rarms"):
        robot.remove()

    partition.unlink()
    assert robot.remove().removed == ("1.0",)
    assert not robot.versions.exists()
    assert robot.remove().removed == ()


JETSON = RobotPython(version="3.12.3", machine="aarch64", glibc=(2, 39))
DEBIAN = RobotPython(version="3.11.2", machine="x86_64", glibc=(2, 36))


def name_of(robot: RobotPython, platform: str) -> str:
    python = f"cp{robot.short_version.replace('.', '')}"
    return f"solver-1.0-{python}-{python}-{platform}_{robot.machine}.whl"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Wheels of one package for two robots, old and new; the lock has all of them."""
    digests = []
    for robot in (JETSON, DEBIAN):
        for platform in ("manylinux2014", "manylinux_2_28", "manylinux_2_99"):
            content = f"{robot.machine} {platform}".encode()
            (tmp_path / name_of(robot, platform)).write_bytes(content)
            digests.append(hashlib.sha256(content).hexdigest())
    hashes = "".join(f" --hash=sha256:{digest}" for digest in digests)
    lock = f"solver==1.0 ; python_full_version >= '3.11'{hashes}\nold==2.0 ; python_full_version < '3.11'{hashes}\n"
    monkeypatch.setattr(install_wheels, "shipped_text", lambda _path: lock)
    return tmp_path


@pytest.mark.parametrize("robot", [JETSON, DEBIAN], ids=["aarch64", "x86_64"])
def test_newest_wheel_that_runs_on_robot_is_taken(robot: RobotPython, folder: Path) -> None:
    own, solver = wheels_for(robot, folder)

    assert own.name.startswith("rarms_iac-")
    assert (solver.name, solver.content) == (
        name_of(robot, "manylinux_2_28"),
        f"{robot.machine} manylinux_2_28".encode(),
    )


def test_wheel_without_hash_of_lock_is_refused(folder: Path) -> None:
    damaged = folder / name_of(JETSON, "manylinux_2_28")
    damaged.write_bytes(b"replaced")

    with pytest.raises(UseCaseError) as refused:
        wheels_for(JETSON, folder)

    (finding,) = refused.value.findings
    assert finding.code == "RARMS415"
    assert f"The SHA-256 of {damaged} is" in finding.detail


def test_lock_has_one_version_of_each_package() -> None:
    lock = shipped_text(LOCK)
    for version in ("3.11.2", "3.12.3", "3.13.0", "3.14.0"):
        names = [pin.name for pin in pins_for(lock, RobotPython(version=version, machine="aarch64", glibc=(2, 36)))]
        assert len(names) == len(set(names)), version
        assert {"pip", "numpy", "highspy", "pydantic", "pyyaml"} <= set(names)
        assert "hatchling" not in names


def test_builds_of_different_robots_have_different_names() -> None:
    assert build_name(JETSON) == build_name(JETSON)
    assert build_name(JETSON) != build_name(DEBIAN)
