"""`rarms install` over a real sshd, as a user with sudo, with wheels that the real pip downloads."""

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from rarms_iac.app import install
from rarms_iac.app.install_there import RobotPlaces
from rarms_iac.app.install_wheels import LOCK, RobotPython, own_wheel, pins_for, wheels_for
from rarms_iac.model.version import __version__
from rarms_iac.providers import robot as providers_robot
from rarms_iac.storage.shipped import shipped_text
from tests.remote import a_server
from tests.unit.cli.running import Ran, rarms

MANIFEST = """\
schema: rarms/v1
application: { name: cell }
hosts:
  onboard: { provider: linux, logical_processors: 2, memory: 1 GiB, connect: { ssh: USER@cell } }
  model: { provider: simulated, logical_processors: 2, memory: 1 GiB }
components: { vision: { criticality: 1, memory: 64 MiB, cpu: { reserve: 0.1 LP }, hosts: [onboard] } }
"""

pytestmark = [pytest.mark.needs("ssh", "root", "linux", "network", "sudo", "control-groups")]


EVERYTHING = "ALL"
REQUESTS = "/usr/bin/env -i {versions}/{version}/bin/python -I -m rarms_iac.robot"
"""The line of docs/linux.md for a user who sends requests to an installed rarms."""


@dataclass(frozen=True, slots=True)
class Robot:
    """A robot behind sshd whose rarms lies in a folder of the test."""

    folder: Path  # of the operator
    places: RobotPlaces
    user: str

    def allow(self, *programs: str) -> None:
        """Let the user start these by sudo without a password, and nothing else."""
        file = Path("/etc/sudoers.d", self.user)
        names = (program.format(versions=self.places.versions, version=__version__) for program in programs)
        file.write_text("".join(f"{self.user} ALL=(root) NOPASSWD: {name}\n" for name in names), encoding="ascii")
        file.chmod(0o440)

    def install(self, *words: str) -> Ran:
        return rarms("install", *words, "-f", str(self.folder), "--wheels", str(self.folder / "wheels"))

    def there(self, *words: str) -> subprocess.CompletedProcess[str]:
        """The robot's own rarms."""
        program = Path(self.places.versions, "current", "bin", "rarms")
        return subprocess.run([program, *words], capture_output=True, text=True, env={}, cwd="/")


@pytest.fixture(scope="module")
def user() -> Iterator[str]:
    """A user of this machine without rights."""
    name = f"rarms-test-{os.getpid()}"
    subprocess.run(["useradd", "--system", "-M", "-d", "/", "-s", "/bin/sh", "-p", "*", name], check=True)
    yield name
    Path("/etc/sudoers.d", name).unlink(missing_ok=True)
    subprocess.run(["userdel", name], check=True)


@pytest.fixture(scope="module")
def robot(user: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """It has the folders of a robot with cron and without systemd; no rarms is there."""
    folder = tmp_path_factory.mktemp("operator")
    (folder / "rarms.yaml").write_text(MANIFEST.replace("USER", user), encoding="utf-8")
    with tempfile.TemporaryDirectory(prefix="rarms-test-", dir="/opt") as there, pytest.MonkeyPatch.context() as patch:
        root = Path(there)
        root.chmod(0o755)
        for name in ("cron", "server"):
            (root / name).mkdir()
        names = ("versions", "state", "units", "systemd", "cron")
        places = RobotPlaces(**{name: str(root / name) for name in names})
        patch.setattr(install, "PLACES", places)
        patch.setattr(providers_robot, "INSTALLED", places.versions)
        with a_server(root / "server") as server:
            patch.setenv("PATH", server.environment["PATH"])
            robot = Robot(folder, places, user)
            robot.allow(EVERYTHING)
            yield robot


def test_a_robot_without_rarms_gets_it_over_ssh(robot: Robot) -> None:
    installed = robot.install("--host", "onboard", "--json")

    assert installed.code == 0, installed.err
    assert re.search(r"onboard: sending \d+ wheels, \d+ MB, and installing them there\.", installed.err)
    (host,) = json.loads(installed.out)["hosts"]
    assert (host["before"], host["version"], host["changed"]) == ("", __version__, True)
    assert host["sent_bytes"] > 10_000_000
    version = robot.there("--version")
    assert version.stdout == f"rarms {__version__}\n", version.stderr
    assert json.loads(robot.there("schema").stdout)["$schema"]
    solver = "import highspy, re2, tree_sitter_powershell, yaml, rarms_iac; print(rarms_iac.__file__)"
    python = Path(robot.places.versions, __version__, "bin", "python")
    loaded = subprocess.run([python, "-I", "-c", solver], capture_output=True, text=True, env={})
    assert loaded.stdout.startswith(robot.places.versions), loaded.stderr
    assert not list(Path(robot.places.versions).rglob("hatchling")), "what builds rarms stays here"


def test_sudoers_user_asks_the_installed_rarms(robot: Robot) -> None:
    robot.install("--host", "onboard")
    robot.allow(REQUESTS)

    snapshot = rarms("snapshot", "--host", "onboard", "-f", str(robot.folder), "--out", str(robot.folder / "it.json"))
    refused = robot.install("--host", "onboard")

    robot.allow(EVERYTHING)
    assert snapshot.code == 0, snapshot.err
    assert refused.code == 1
    assert "Connect as root, or let this user run `sudo -n python3` there" in " ".join(refused.err.split())


def test_an_installed_robot_is_left_as_it_is(robot: Robot) -> None:
    robot.install("--host", "onboard")
    inode = Path(robot.places.versions, "current").lstat().st_ino

    again = robot.install()

    assert again.code == 0, again.err
    assert f"onboard  rarms {__version__} is already installed" in again.out
    assert Path(robot.places.versions, "current").lstat().st_ino == inode


def test_what_was_installed_can_install_another_robot(robot: Robot) -> None:
    robot.install("--host", "onboard")
    wheel = "from rarms_iac.app.install_wheels import own_wheel; print(own_wheel().digest)"
    python = Path(robot.places.versions, __version__, "bin", "python")

    there = subprocess.run([python, "-I", "-c", wheel], capture_output=True, text=True, env={})

    assert there.stdout.strip() == own_wheel().digest, there.stderr


def test_removal_leaves_nothing_of_rarms(robot: Robot) -> None:
    robot.install("--host", "onboard")

    removed = robot.install("--host", "onboard", "--remove")

    assert removed.code == 0, removed.err
    assert f"rarms {__version__} removed" in removed.out
    assert not Path(robot.places.versions).exists()
    assert list(Path(robot.places.cron).iterdir()) == []


def test_a_simulated_host_needs_no_rarms(robot: Robot) -> None:
    refused = robot.install("--host", "model")

    assert refused.code == 64
    assert "Not a Linux host: model." in refused.err


def test_pip_finds_every_wheel_for_another_processor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    jetson = RobotPython(version="3.12.3", machine="aarch64", glibc=(2, 39))
    downloaded = wheels_for(jetson, tmp_path)
    monkeypatch.setattr(sys, "executable", "/bin/false")  # there is no pip, and no internet

    from_folder = wheels_for(jetson, tmp_path)

    assert from_folder == downloaded
    known = {digest for pin in pins_for(shipped_text(LOCK), jetson) for digest in pin.digests}
    assert {wheel.digest for wheel in downloaded} - {own_wheel().digest} <= known
    built = {wheel.name.partition("-")[0] for wheel in downloaded if wheel.name.endswith("_aarch64.whl")}
    assert {"highspy", "pydantic_core", "pyyaml"} <= built
    assert all(wheel.name.endswith(("-any.whl", "_aarch64.whl")) for wheel in downloaded)
