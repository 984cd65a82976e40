"""A Linux host behind a real sshd, which is this machine: the operator's way over it, and connections that break."""

import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event
from typing import Any

import pytest

from rarms_iac.app.applying import apply as apply_plan
from rarms_iac.app.control import Control, NeverStop, SilentAppReporter
from rarms_iac.app.hosts import Hosts, load
from rarms_iac.app.planning import plan
from rarms_iac.applying.run_report import ReportedStep, RunEnding, RunReport, RunReporter
from rarms_iac.model.version import __version__
from rarms_iac.providers.cgroups.provider import STATE_FOLDER
from rarms_iac.providers.robot import INSTALLED, LINE_LIMIT, READY, entry_command
from tests.contracts.benches import forget_host, groups_of, slice_of
from tests.needs import CHECKOUT, ROBOT_PYTHON
from tests.remote import Remote, a_server
from tests.robot_install import on_robot, robot_rarms
from tests.system.test_linux_walk import MANIFEST
from tests.unit.cli.running import Ran, rarms

__all__ = ["robot_rarms"]

pytestmark = [pytest.mark.needs("ssh", "control-groups", "mounts", "sudo"), pytest.mark.alone]


SUDOERS = f"robot ALL=(root) NOPASSWD: /usr/bin/env -i {INSTALLED}/{__version__}/bin/python -I -m rarms_iac.robot\n"
OVERLAY = """\
hosts: {{ onboard: {{ connect: {{ ssh: cell, folder: '{folder}' }}, linux: {{ slice: {slice} }} }} }}
components:
  face-detection: {{ cpu: {{ reserve: 0.6 LP }} }}
  speech-recognition: {{ cpu: {{ reserve: 0.3 LP }} }}
  path-planning: {{ cpu: {{ reserve: 0.2 LP }} }}
  video-streaming: {{ cpu: {{ reserve: 0.2 LP }} }}
"""
"""The delivery robot without its measurements."""


@pytest.fixture(scope="module")
def server(robot_rarms: Path) -> Iterator[Remote]:
    """A robot with the user `robot`, who may start rarms by sudo."""
    with TemporaryDirectory(prefix="rarms-test-", dir="/opt") as name:
        folder = Path(name)
        folder.chmod(0o755)  # sshd reads the key as that user
        with a_server(folder, lambda words: on_robot(robot_rarms, words, *_user_robot(folder))) as remote:
            yield remote


def _user_robot(folder: Path) -> Iterator[str]:
    """Commands that give a program alone a machine with this user."""
    (folder / "key.pub").chmod(0o644)
    lines = {"passwd": "robot:x:4242:4242::/:/bin/sh\n", "shadow": "robot:*:19000::::::\n", "sudoers": SUDOERS}
    for name, line in lines.items():
        own = Path("/etc", name)
        text = own.read_text(encoding="utf-8") if own.exists() and name != "sudoers" else ""
        (folder / name).write_text(text + line, encoding="utf-8")
        (folder / name).chmod(0o440 if name == "sudoers" else 0o644)
        yield f"mount --bind {folder / name} {own}"


@pytest.fixture
def folder(server: Remote, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A manifest whose host is reached over ssh; its control groups are gone after the test."""
    text = MANIFEST.format(slice=slice_of(tmp_path)).replace("linux\n", "linux\n    connect: { ssh: cell }\n")
    (tmp_path / "rarms.yaml").write_text(text, encoding="utf-8")
    monkeypatch.setenv("PATH", server.environment["PATH"])
    yield tmp_path
    forget_host(tmp_path)


def run(folder: Path, command: str, *words: str) -> Ran:
    return rarms(command, *words, "-f", str(folder))


def apply(folder: Path) -> Ran:
    return run(folder, "apply", "--auto-approve")


def partitions(folder: Path) -> list[dict[str, Any]]:
    """Those of a snapshot."""
    assert run(folder, "snapshot", "--out", str(folder / "snapshot.json")).code == 0
    document: Any = json.loads((folder / "snapshot.json").read_text(encoding="utf-8"))
    return list(document["state"]["partitions"])


def test_plan_apply_drift_undo_and_destroy(folder: Path) -> None:
    assert run(folder, "plan").code == 0
    assert apply(folder).code == 0
    assert run(folder, "plan").code == 0
    (folder / "here").mkdir()
    text = (folder / "rarms.yaml").read_text(encoding="utf-8").replace("connect: { ssh: cell }", "")
    (folder / "here" / "rarms.yaml").write_text(text, encoding="utf-8")
    assert run(folder / "here", "plan").code == 0, "rarms on the host sees the same"
    tree = groups_of(folder)
    vision, speech = tree.name_for("face-detection"), tree.name_for("speech")
    assert tree.names() == tuple(sorted((vision, speech)))
    assert tree.read(vision).quota_percent == pytest.approx(80, abs=0.1)
    assert tree.read("").quota_percent == 180

    assert run(folder, "doctor").code == 0
    for command, is_running in (("stop", False), ("start", True)):
        assert run(folder, command, "speech", "--auto-approve").code == 0
        (status,) = json.loads(run(folder, "status", "--json").out)["hosts"]
        assert {each["name"]: each["running"] for each in status["partitions"]}["speech"] is is_running
    assert run(folder, "history").out.count("done") >= 3
    assert run(folder, "release", "speech", "--auto-approve").code == 0
    (released,) = (found for found in partitions(folder) if found["mark"] is None)
    assert run(folder, "import", "speech", "--id", released["id"], "--auto-approve").code == 0
    assert run(folder, "plan").code == 0

    tree._write_quota(vision, 120, 100_000)
    assert run(folder, "drift").code == 2
    assert apply(folder).code == 0
    assert tree.read(vision).quota_percent == pytest.approx(80, abs=0.1)

    kept = run(folder, "undo", "--keep", "--auto-approve")
    assert re.search("partition/face-detection +stays as applied", kept.err)
    assert tree.read(vision).quota_percent == pytest.approx(80, abs=0.1)
    undone = run(folder, "undo", "--auto-approve")
    assert (kept.code, undone.code) == (0, 0)
    assert "rarms did not set limit 1.2 LP; the last apply set 0.8 LP." in " ".join(undone.err.split())
    assert tree.read(vision).quota_percent == pytest.approx(120, abs=0.1)
    assert run(folder, "destroy", "--auto-approve").code == 0
    assert tree.names() == ()


def test_a_user_starts_rarms_by_sudo_alone(folder: Path) -> None:
    manifest = folder / "rarms.yaml"
    manifest.write_text(manifest.read_text(encoding="utf-8").replace("ssh: cell", "ssh: robot@cell"), encoding="utf-8")

    assert apply(folder).code == 0
    assert len(groups_of(folder).names()) == 2


def test_writable_code_and_other_versions_are_refused(folder: Path, robot_rarms: Path) -> None:
    place = robot_rarms / __version__
    place.chmod(0o757)
    writable = run(folder, "plan")
    place.chmod(0o755)
    assert writable.code == 1
    assert f"users other than root may write to {INSTALLED}/{__version__}" in " ".join(writable.err.split())

    place.rename(robot_rarms / "0.0.9")
    others = [run(folder, command) for command in ("plan", "doctor")]
    (robot_rarms / "0.0.9").rename(place)
    for other in others:
        said = " ".join((other.out + other.err).split())
        assert other.code == 1
        assert "RARMS410" in said
        assert f"it has rarms 0.0.9; this is rarms {__version__}" in said
        assert "rarms install --host onboard" in said


def test_garbage_over_ssh_is_not_a_request(server: Remote) -> None:
    words = [str(server.folder / "here" / "ssh"), "cell", entry_command()]
    for sent in (b"", b"GET / HTTP/1.1\n", b"\xff" * 100, b"x" * (LINE_LIMIT + 1)):
        ended = subprocess.run(words, input=sent + b"\n", capture_output=True, timeout=60)

        ready, answer = ended.stdout.decode("ascii").splitlines()
        assert (ended.returncode, ready) == (1, READY)
        assert "the request cannot be read" in json.loads(answer)["findings"][0]["detail"]


def test_robot_with_key_refuses_unsigned_plans_and_runs(
    folder: Path, robot_rarms: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    key = "0123456789abcdef"
    (folder / "etc").mkdir()
    (folder / "etc" / "environment").write_text("RARMS_PLAN_KEY_FILE=/etc/rarms/key\n", encoding="ascii")
    (folder / "etc" / "key").write_text(key, encoding="ascii")
    (folder / "etc" / "key").chmod(0o600)
    (folder / "keyed").mkdir()
    mount = f"mkdir -p /etc/rarms && mount --bind {folder / 'etc'} /etc/rarms"
    assert stopped_at(2, load(folder)).ending is RunEnding.INTERRUPTED
    with a_server(folder / "keyed", lambda words: on_robot(robot_rarms, words, mount)) as keyed:
        monkeypatch.setenv("PATH", keyed.environment["PATH"])

        unfinished = apply(folder)
        assert run(folder, "apply", "--abandon", "--auto-approve").code == 0
        refused = apply(folder)
        monkeypatch.setenv("RARMS_PLAN_KEY", key)
        signed = apply(folder)

    for each in (unfinished, refused):
        assert each.code == 3
        assert "RARMS341" in each.err
    assert signed.code == 0


def test_full_disk_of_robot_is_reported(folder: Path, robot_rarms: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    small = f"mkdir -p {STATE_FOLDER} && mount -t tmpfs -o size=4k,mode=700 none {STATE_FOLDER}"
    (folder / "full").mkdir()
    with a_server(folder / "full", lambda words: on_robot(robot_rarms, words, small)) as full:
        monkeypatch.setenv("PATH", full.environment["PATH"])

        failed = apply(folder)

    assert failed.code == 1
    assert "No space left on device" in " ".join(failed.err.split())
    assert groups_of(folder).names() == ()


def stopped_at(step: int, hosts: Hosts) -> RunReport:
    """Apply until a step has begun."""
    stop, reporter = Event(), SilentAppReporter()
    reporter.steps = StopsAt(step, stop)
    return apply_plan(plan(hosts), control=Control(reporter=reporter, stop=StopsOn(stop)))


@dataclass
class StopsAt(RunReporter):
    """Asks for an end when a step begins."""

    step: int
    stop: Event

    def step_started(self, host: str, number: int, total: int, step: ReportedStep) -> None:
        if number == self.step:
            self.stop.set()


def test_stopped_sample_is_finished_undone_and_measured(
    server: Remote, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = tmp_path / "robot"
    shutil.copytree(CHECKOUT / "manifests" / "delivery-robot-linux", robot)
    (robot / "here.yaml").write_text(OVERLAY.format(slice=slice_of(tmp_path), folder=robot), encoding="utf-8")
    monkeypatch.setenv("PATH", server.environment["PATH"])
    hosts, overlay = load(robot, overlays=[robot / "here.yaml"]), ("--overlay", str(robot / "here.yaml"))
    try:
        report = stopped_at(4, hosts)
        assert report.ending is RunEnding.INTERRUPTED, report

        finished = run(robot, "apply", "--auto-approve", "--lock-timeout", "60s", *overlay)
        assert finished.code == 0, finished.err
        assert run(robot, "drift", *overlay).code == 0
        assert run(robot, "undo", "--auto-approve", *overlay).code == 0
        assert groups_of(tmp_path).names() == ()
        few = ("--from", "40%", "--to", "50%", "--step", "10%", "--samples", "5", "--weak-load", "--json")
        measured = run(robot, "measure", "path-planning", *few, *overlay)
        assert [each["new"] for each in json.loads(measured.out)["experiments"]] == [2], measured
    finally:
        forget_host(tmp_path)


WITH_ITS_PROGRAMS = """\
  face-detection: {{ cpu: {{ reserve: 0.6 LP }}, run: {{ command: [{python}, components/face_detection.py] }} }}
  speech-recognition:
    cpu: {{ reserve: 0.3 LP }}
    run: {{ command: [{python}, components/speech_recognition.py, --period-ms, '150'] }}
  path-planning: {{ cpu: {{ reserve: 0.2 LP }} }}
  video-streaming:
    cpu: {{ reserve: 0.2 LP }}
    run: {{ command: [{python}, components/video_streaming.py, --period-ms, '33'] }}
policy: {{ measuring: {{ proof: 1 min }} }}
"""


@pytest.mark.alone
@pytest.mark.needs("robot")
def test_the_sample_is_proven_with_its_own_programs(
    server: Remote, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = tmp_path / "robot"
    subprocess.run([CHECKOUT / "scripts" / "make-robot", robot], check=True, timeout=300)
    there = OVERLAY.partition("  face")[0].format(slice=slice_of(tmp_path), folder=robot)
    (robot / "here.yaml").write_text(there + WITH_ITS_PROGRAMS.format(python=ROBOT_PYTHON), encoding="utf-8")
    monkeypatch.setenv("PATH", server.environment["PATH"])
    overlay = ("--overlay", str(robot / "here.yaml"))
    try:
        assert run(robot, "apply", "--auto-approve", *overlay).code == 0
        proven = run(robot, "prove", "--without-load", "--json", *overlay)
        verdicts = json.loads(proven.out)["proofs"][0]["verdicts"]
        shown = {each["measured"]["component"] for each in verdicts if each["measured"]["estimate"]}
        assert shown == {"face-detection", "speech-recognition", "path-planning", "video-streaming"}, proven
        assert run(robot, "destroy", "--auto-approve", *overlay).code == 0
    finally:
        forget_host(tmp_path)


@dataclass(frozen=True)
class StopsOn(NeverStop):
    """A `StopSignal` that a test gives."""

    event: Event

    def should_stop(self) -> bool:
        return self.event.is_set()


def test_a_host_with_another_key_is_not_trusted(folder: Path, server: Remote) -> None:
    known = server.folder / "known"
    run(folder, "plan")
    original = known.read_text(encoding="ascii")
    host, kind, _ = original.split(maxsplit=2)
    key = (server.folder / "key.pub").read_text(encoding="ascii").split()[1]
    known.write_text(f"{host} {kind} {key}\n", encoding="ascii")

    refused = run(folder, "plan")

    known.write_text(original, encoding="ascii")
    assert refused.code == 1
    assert "Host key verification failed" in " ".join(refused.err.split())
    assert "ssh -o BatchMode=yes cell" in " ".join(refused.err.split())
