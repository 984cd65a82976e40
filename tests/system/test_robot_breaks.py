"""Robots behind a real sshd whose commands break at each of their steps: the next command continues."""

import json
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from rarms_iac.app import install
from rarms_iac.app.install import _RobotSetup
from rarms_iac.app.install_there import RobotPlaces
from rarms_iac.model.version import __version__
from rarms_iac.providers.cgroups.provider import STATE_FOLDER
from rarms_iac.providers.channel import ProgramChannel
from rarms_iac.robot.experiments import WORK
from rarms_iac.storage.datalog.files import read_log
from rarms_iac.storage.writing import read_holder
from tests.contracts.benches import forget_host, groups_of, slice_of
from tests.contracts.test_measuring_contract import JOBS
from tests.remote import Ended, Remote, a_server, finish
from tests.robot_breaks import break_at, breakable
from tests.robot_install import install as install_robot
from tests.robot_install import on_robot, robot_rarms
from tests.robot_wheels import wheels_of
from tests.unit.cli.running import rarms

__all__ = ["robot_rarms"]

pytestmark = [pytest.mark.needs("ssh", "control-groups", "mounts"), pytest.mark.alone]

MANIFEST = """\
schema: rarms/v1
application: {{ name: cell }}
policy: {{ interference: busy-loop }}
hosts:
  onboard:
    provider: linux
    logical_processors: 2
    memory: 1 GiB
    keep_for_host: {{ processor: 80 %, memory: 256 MiB }}
    connect: {{ ssh: cell, folder: '{folder}' }}
    linux: {{ slice: {slice} }}
components:
  eyes:
    criticality: 20
    memory: 64 MiB
    processors: 1
    cpu: {{ reserve: 0.1 LP }}
    apt: {{ mean_response_time: {{ at_most: 5 s }} }}
    run:
      command: [python3, jobs.py, '0.001', '0.02', '1']
      until: {{ elapsed: 1 s }}
      samples: {{ from: json_lines, response_time: {{ field: ms, unit: ms }} }}
"""
"""Most of the processors is kept for the host, so that the load takes little of them."""

STEP, RESULT = '"step_started"', '"kind":"result"'
KINDS = ("here", "there", "connection")


@pytest.fixture(scope="module")
def server(robot_rarms: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Remote]:
    (packages,) = (robot_rarms / __version__).glob("lib/python3*/site-packages")
    folder = tmp_path_factory.mktemp("server")
    with breakable(packages, folder / "break"), a_server(folder, partial(on_robot, robot_rarms)) as remote:
        yield remote


@dataclass(frozen=True)
class Robot:
    """The manifest's folder here, its copy there, and the server between them."""

    here: Path
    there: Path
    server: Remote

    def run(self, *words: str) -> Ended:
        ran = rarms(*words, "-f", str(self.here))
        return Ended(ran.code, ran.out, ran.err)

    def breaks(self, kind: str, at: str, *words: str, nth: int = 1) -> bool:
        """Run a command that is to break at a line; return False if it ended well without such a line."""
        where = self.server.folder / "break"
        if kind == "here":
            process = self.server.start(*words, "-f", str(self.here))
            break_at(where, at, nth, process.pid)
            ended = finish(process)
        else:
            break_at(where, at, nth, kind)
            ended = self.run(*words)
        if where.exists():
            where.unlink()
            assert ended.code == 0, ended
            return False
        assert ended.code == (-9 if kind == "here" else 1), ended
        said = "" if kind == "here" else "Run the same command again to continue."
        assert said in " ".join(ended.err.split()), ended
        return True

    def breaks_at_each_step(self, kind: str, *words: str) -> int:
        """Run a command until it ends well, each time up to a later step; return how often it broke."""
        count = 0
        while self.breaks(kind, STEP, *words, nth=2 if count else 1):
            count += 1
        return count

    def assert_nothing_is_left(self, folder: Path, *groups: str) -> None:
        """Only these groups are there, and no process and no lock."""
        tree = groups_of(folder)
        assert tree.names() == tuple(tree.name_for(name) for name in groups)
        lock, until = STATE_FOLDER / slice_of(folder) / "lock", time.monotonic() + 20
        while any(left := (_processes_in(self.there), read_holder(lock))):
            assert time.monotonic() < until, left
            time.sleep(0.1)


def _processes_in(folder: Path) -> list[str]:
    """The processes whose current folder this is."""
    found = []
    for link in Path("/proc").glob("[0-9]*/cwd"):
        try:
            found += [link.parent.name] if link.readlink() == folder else []
        except OSError:
            continue  # it ended meanwhile
    return found


@pytest.fixture
def robot(server: Remote, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Robot]:
    yield a_robot(server, tmp_path, monkeypatch)
    forget_host(tmp_path)


def a_robot(server: Remote, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Robot:
    """Write the files of a robot behind a server."""
    robot = Robot(tmp_path / "here", tmp_path / "there", server)
    for folder in (robot.here, robot.there):
        folder.mkdir()
        (folder / "jobs.py").write_text(JOBS, encoding="utf-8")
    text = MANIFEST.format(folder=robot.there, slice=slice_of(tmp_path))
    (robot.here / "rarms.yaml").write_text(text, encoding="utf-8")
    monkeypatch.setenv("PATH", server.environment["PATH"])
    return robot


@pytest.mark.parametrize("kind", KINDS)
def test_apply_drift_and_undo_continue_after_each_step(robot: Robot, tmp_path: Path, kind: str) -> None:
    run = ("--auto-approve", "--lock-timeout", "60s")
    assert robot.breaks_at_each_step(kind, "apply", *run) >= 3
    assert robot.breaks(kind, RESULT, "drift")
    assert robot.run("drift").code == 0
    robot.assert_nothing_is_left(tmp_path, "eyes")

    assert robot.breaks_at_each_step(kind, "undo", *run) >= 1
    robot.assert_nothing_is_left(tmp_path)


def test_measure_and_prove_continue_after_each_report(robot: Robot, tmp_path: Path) -> None:
    text = (robot.here / "rarms.yaml").read_text(encoding="utf-8")
    measure = ("measure", "--from", "5%", "--to", "10%", "--step", "5%", "--samples", "5", "--weak-load")
    for at in ('"experiment_started"', '"setting_started"'):
        for kind in KINDS:
            assert robot.breaks(kind, at, *measure, "--lock-timeout", "60s")
    assert robot.breaks("there", '"setting_ended"', *measure, "--lock-timeout", "60s")
    assert robot.breaks("connection", '"setting_started"', *measure, "--lock-timeout", "60s", nth=2)
    assert robot.breaks("here", '"experiment_ended"', *measure, "--lock-timeout", "60s")
    for kind in KINDS:
        assert robot.breaks(kind, RESULT, *measure, "--lock-timeout", "60s")
    measured = robot.run(*measure, "--json", "--lock-timeout", "60s")
    (experiment,) = json.loads(measured.out)["experiments"]
    log = read_log(Path(experiment["log"]))
    assert log is not None
    assert (measured.code, experiment["new"], len(log.recorded)) == (0, 0, 2), measured
    assert all(read_holder(request / "lock") for request in WORK.glob("*/")), "killed ones left no files"
    robot.assert_nothing_is_left(tmp_path)

    (robot.here / "rarms.yaml").write_text(text.replace("0.1 LP", "measured"), encoding="utf-8")
    assert robot.run("apply", "--auto-approve").code == 0
    prove = ("prove", "--without-load", "--load-host", "--samples", "20")
    for kind in KINDS:
        assert robot.breaks(kind, '"message"', *prove, "--lock-timeout", "60s")
    assert robot.run("drift").code == 0
    robot.assert_nothing_is_left(tmp_path, "eyes")
    assert robot.run("destroy", "--auto-approve", "--lock-timeout", "60s").code == 0
    robot.assert_nothing_is_left(tmp_path)


def test_other_version_leaves_run_to_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The installation of a newer version over ssh; `0.1.0` and its finish are the real ones."""
    with TemporaryDirectory(prefix="rarms-test-", dir="/opt") as name:
        root, build = Path(name), f"{__version__}-1"
        root.chmod(0o755)
        for folder in ("versions/.builds", "state", "server"):
            (root / folder).mkdir(parents=True, mode=0o755)
        packages = install_robot(root / "versions" / ".builds", build)
        (root / "versions" / __version__).symlink_to(f".builds/{build}")
        (root / "versions" / "current").symlink_to(__version__)
        state = f"mkdir -p {STATE_FOLDER} && mount --bind {root / 'state'} {STATE_FOLDER}"
        places = RobotPlaces(units=f"{root}/units", systemd=f"{root}/systemd", cron=f"{root}/cron")
        monkeypatch.setattr(install, "PLACES", places)
        wrap = partial(on_robot, root / "versions")
        with (
            breakable(packages, root / "server" / "break"),
            a_server(root / "server", lambda words: wrap(words, state)) as server,
        ):
            robot = a_robot(server, tmp_path, monkeypatch)
            assert robot.breaks("there", STEP, "apply", "--auto-approve", nth=2)
            words = (str(server.folder / "here" / "ssh"), "cell")
            setup = _RobotSetup("onboard", ProgramChannel(host="onboard", target="cell", words=words))
            sent = wheels_of("9.9", str(STATE_FOLDER))
            request = {"action": "install", "version": "9.9", "build": "9.9-1", "pip": sent[0].name, "bytes": 0}

            done = setup.ask({**request, "wheels": {wheel.name: wheel.digest for wheel in sent}}, sent)

            assert [(run.version, run.slice) for run in done.finished] == [(__version__, slice_of(tmp_path))]
            assert done.still_open == ()
            assert robot.run("drift").code == 0
            robot.assert_nothing_is_left(tmp_path, "eyes")
        forget_host(tmp_path)
