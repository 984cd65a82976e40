"""Components that run already, in a real container: held while they are measured, and given back after any end."""

import os
import shutil
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from pathlib import Path

import pytest

from rarms_iac.measuring.partitions import remove_test_partitions
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.loads import BusyLoop
from rarms_iac.model.run import AttachedContainer, AttachedService, Run, SampleCount, Samples, TimeField
from rarms_iac.model.setting import P1, P2
from rarms_iac.model.system import Component
from rarms_iac.providers.cgroups import attach_target
from rarms_iac.providers.cgroups.effects import LinuxEffects
from rarms_iac.providers.cgroups.measuring import LinuxMeasuringHost
from rarms_iac.providers.measuring import PartitionWork, Work
from tests.builders import a_component, a_host
from tests.contracts.benches import forget_groups, forget_host, groups_of, slice_of
from tests.contracts.test_measuring_contract import ready
from tests.unit.cli.running import rarms

pytestmark = [pytest.mark.needs("control-groups", "podman"), pytest.mark.alone]
LINES = Samples(source="json_lines", response_time=TimeField(field="ms", unit="ms"))
LOOP = 'while :; do i=0; while [ $i -lt 20000 ]; do i=$((i+1)); done; sleep 0.01; echo "{\\"ms\\": 5}"; done'
PODMAN = (
    "podman --cgroup-manager=cgroupfs --runtime runc run --detach --rm --network=none --ulimit nofile=1024:1024 "
    "--ulimit nproc=1024:1024"
)


@pytest.fixture
def container(tmp_path: Path) -> Iterator[str]:
    """The name of a container with a shell that works and has children."""
    root, name = tmp_path / "root", f"rarms-test-{uuid.uuid4().hex[:8]}"
    for folder in ("bin", "dev", "proc", "sys", "tmp", "etc", "run"):
        (root / folder).mkdir(parents=True)
    shutil.copy(str(shutil.which("busybox")), root / "bin" / "busybox")
    for link in ("sh", "sleep"):
        (root / "bin" / link).symlink_to("busybox")
    words = [*PODMAN.split(), f"--name={name}", "--rootfs", str(root), "/bin/sh", "-c", LOOP]
    subprocess.run(words, check=True, capture_output=True)
    yield name
    subprocess.run(["podman", "rm", "--force", "--time=0", name], check=False, capture_output=True)
    forget_groups(tmp_path)


class Killed(BaseException):
    """Stands for the end of the process."""


class MortalEffects(LinuxEffects):
    """This machine, until the process is killed before the change of this number; nothing is changed after it."""

    def __init__(self, at: int = 0) -> None:
        self.changes = 0
        self._at = at

    def _count(self) -> None:
        self.changes += 1
        if self._at and self.changes >= self._at:
            raise Killed

    def write(self, path: Path, text: str) -> None:
        self._count()
        super().write(path, text)

    def replace(self, path: Path, data: bytes) -> None:
        self._count()
        super().replace(path, data)

    def delete(self, path: Path) -> None:
        self._count()
        super().delete(path)


def the_host(folder: Path, attached: LinuxEffects | None = None) -> LinuxMeasuringHost:
    """This machine; what it does to attached components goes through these effects."""
    host = LinuxMeasuringHost(a_host(provider=ProviderKind.LINUX), folder, folder / "state", groups_of(folder))
    if attached is not None:
        host._attached._effects = attached
    return host


def nav2(container: str) -> Component:
    return a_component("nav2", run=Run(attach=AttachedContainer(container=container, engine="podman"), samples=LINES))


def work_of(component: Component) -> Work:
    parts = (PartitionWork(partition=P1, components=(component,)), PartitionWork(partition=P2, load=BusyLoop()))
    return Work(application="robot", partitions=parts, until={"nav2": SampleCount(samples=10)}, seed=1)


def groups_of_container(name: str) -> dict[str, str]:
    """The control groups of a container's first process, by hierarchy."""
    done = subprocess.run(
        ["podman", "inspect", "--format={{.State.Pid}}", name], check=True, capture_output=True, text=True
    )
    lines = Path(f"/proc/{done.stdout.strip()}/cgroup").read_text(encoding="ascii").splitlines()
    return {line.split(":")[1]: line.split(":")[2] for line in lines}


def test_container_is_held_and_given_back(tmp_path: Path, container: str) -> None:
    host, before = the_host(tmp_path), groups_of_container(container)
    slice_name = groups_of(tmp_path).parent_of_containers("x").split("/")[1]

    with host.lock("test"), ready(host, reserve=30):
        with host.run(work_of(nav2(container))) as running:
            samples = list(running.samples())
            held, state = groups_of_container(container), host.observe()
            evidence = running.evidence()
            values = host.tree.read(P1)
        after = groups_of_container(container)

    assert len(samples) >= 10
    assert held["cpu"] == held["memory"] == f"/{slice_name}/{P1}"
    assert values.quota_percent == 60  # 30 % of two processors
    assert state.attached == f"the container {container}"
    assert evidence is not None
    assert evidence.cpu_ms[P1] > 0
    assert evidence.outside == ()
    assert after == before
    assert host.observe().attached == ""


def is_killed(host: LinuxMeasuringHost, component: Component) -> bool:
    try:
        with host.lock("test"), ready(host), host.run(work_of(component)):
            pass
    except Killed:
        return True
    return False


def test_killed_at_each_change_is_given_back(tmp_path: Path, container: str) -> None:
    before, at = groups_of_container(container), 1

    while is_killed(the_host(tmp_path, MortalEffects(at)), nav2(container)):
        left = the_host(tmp_path)
        assert at == 1 or left.observe().attached == f"the container {container}"
        with left.lock("the next command"):
            remove_test_partitions(left)
        assert left.observe().attached == ""
        assert groups_of_container(container) == before, at
        at += 1

    assert at > 6
    assert groups_of_container(container) == before


def refused(host: LinuxMeasuringHost, component: Component) -> str:
    obstacle = host.obstacle(component)
    return "" if obstacle is None else obstacle.reason


def test_what_cannot_be_held_is_refused(tmp_path: Path, container: str, monkeypatch: pytest.MonkeyPatch) -> None:
    host = the_host(tmp_path)
    service = a_component("nav2", run=Run(attach=AttachedService(service="nav2"), samples=LINES))
    words = ("podman", "inspect", "--format={{.State.Pid}}", container)
    process = int(subprocess.check_output(words, text=True))  # the shell; its children end after 10 ms

    assert refused(host, nav2(container)) == ""
    assert "does not have the container rarms-nobody" in refused(host, nav2("rarms-nobody"))
    assert "systemd does not run here" in refused(host, service)

    with monkeypatch.context() as patched:
        patched.setattr(os, "getpid", lambda: process)
        assert "contains rarms itself" in refused(host, nav2(container))
    with monkeypatch.context() as patched:
        patched.setattr(type(host.tree), "members_below", lambda *_: (1, process))
        assert "contains process 1, " in refused(host, nav2(container))
    with monkeypatch.context() as patched:
        patched.setattr(attach_target, "_name", lambda _: "sshd-session")
        assert f"contains sshd-session ({process}), " in refused(host, nav2(container))

    times = ("--sched-runtime=1000000", "--sched-deadline=20000000", "--sched-period=20000000")
    # Without --reset-on-fork the shell can start no further child, and its container ends.
    subprocess.run(["chrt", "--reset-on-fork", "--deadline", *times, "--pid", "0", str(process)], check=True)
    assert "has SCHED_DEADLINE, and a quota does not limit such a thread" in refused(host, nav2(container))


def test_name_of_two_engines_is_ambiguous(tmp_path: Path, container: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rarms_iac.running.engines.shutil.which", lambda name: f"/usr/bin/{name}")
    either = a_component("nav2", run=Run(attach=AttachedContainer(container=container), samples=LINES))

    assert "docker and podman are installed, and both may have a container" in refused(the_host(tmp_path), either)


MANIFEST = """\
schema: rarms/v1
application: {{ name: robot }}
hosts:
  onboard: {{ provider: linux, logical_processors: 2, memory: 1 GiB, linux: {{ slice: {slice} }} }}
components:
  nav2:
    criticality: 1
    apt: {{ mean_response_time: {{ at_most: 20 ms }} }}
    run:
      attach: {{ container: {container}, engine: podman }}
      samples: {{ from: json_lines, response_time: {{ field: ms, unit: ms }} }}
      until: {{ elapsed: 60 s }}
    memory: 64 MiB
    cpu: {{ reserve: measured }}
policy: {{ interference: busy-loop }}
"""


@pytest.fixture
def robot(tmp_path: Path, container: str) -> Iterator[Path]:
    """The folder of a manifest that attaches to the container."""
    text = MANIFEST.format(slice=slice_of(tmp_path), container=container)
    (tmp_path / "rarms.yaml").write_text(text, encoding="utf-8")
    yield tmp_path
    forget_host(tmp_path)


def test_attaching_needs_consent(robot: Path, container: str) -> None:
    before = groups_of_container(container)

    without = rarms("measure", "nav2", "--quick", "-f", str(robot))
    refused = rarms("measure", "nav2", "--quick", "-f", str(robot), stdin="n\n", at_a_terminal=True)

    assert "nav2 already runs. Measuring slows it down." in without.err
    assert "Confirm with --attach." in without.err
    asked = "nav2 already runs. Limit it while measuring, and restore the settings afterwards?"
    assert asked in " ".join(refused.err.split())
    assert without.code == refused.code != 0
    assert groups_of_container(container) == before


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_ended_measurement_gives_the_container_back(robot: Path, container: str, number: signal.Signals) -> None:
    before = groups_of_container(container)
    words = [sys.executable, "-m", "rarms_iac", "measure", "nav2", "--quick", "--attach", "-f", str(robot)]
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as measuring:
        until = time.monotonic() + 60
        while groups_of_container(container) == before:
            assert measuring.poll() is None, measuring.communicate()[1]
            assert time.monotonic() < until
            time.sleep(0.1)
        measuring.send_signal(number)
        measuring.communicate(timeout=60)

    status = rarms("status", "-f", str(robot)).out
    named = f"A measurement limits the container {container}."
    if number == signal.SIGKILL:
        assert named in " ".join(status.split())
        assert groups_of_container(container) != before
        rarms("destroy", "-f", str(robot), "--auto-approve")
        status = rarms("status", "-f", str(robot)).out

    assert named not in " ".join(status.split())
    assert groups_of_container(container) == before
