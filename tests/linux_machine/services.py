"""Services and containers below systemd: started in a partition, or held where they run. See `test_linux_systemd.py`.

pytest runs it in the emulated machine, where systemd is process 1; nothing collects it elsewhere.
"""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac.app import install_there
from rarms_iac.app.install_there import WATCHER_PATH, WATCHER_UNIT, RobotPlaces
from rarms_iac.model.run import (
    AttachedContainer,
    AttachedService,
    Container,
    Run,
    SampleCount,
    Samples,
    Service,
    ServiceProperties,
    Stop,
    TimeField,
)
from rarms_iac.model.setting import LOAD_PARTITIONS, P1
from rarms_iac.model.system import Component
from rarms_iac.providers.cgroups.measuring import LinuxMeasuringHost
from rarms_iac.providers.measuring import PartitionWork, Work
from tests.builders import a_component, a_run
from tests.contracts.benches import forget_groups, forget_host, slice_of
from tests.contracts.test_measuring_contract import ready
from tests.needs import CHECKOUT
from tests.system import test_thread_watcher as watching
from tests.system.test_attached import Killed, MortalEffects, the_host
from tests.unit.cli.running import rarms

LINES = Samples(source="json_lines", response_time=TimeField(field="ms", unit="ms"))
WORKS = "while :; do i=0; while [ $i -lt 2000 ]; do i=$((i+1)); done; echo '{\"ms\": 5}'; sleep 0.1; done"
SLOW = "4 min"
"""A start of a service takes seconds here, and minutes where others work on this computer, too."""
SEEN = Path("/run/robot/seen")
"""A folder that everybody may write to."""

MANIFEST = """\
schema: rarms/v1
application: {{ name: robot }}
hosts:
  onboard:
    provider: linux
    logical_processors: 2
    memory: 1 GiB
    linux: {{ slice: {slice} }}
components:
  camera:
    criticality: 1
    memory: 64 MiB
    cpu: {{ reserve: 30 % }}
    run:
      service:
        exec: [/bin/sh, -c, {script}]
        properties:
          Environment: [OF_UNIT=1, LEVEL=0]
          SupplementaryGroups: [video]
          WorkingDirectory: /run/robot
          LimitMEMLOCK: 8M
          Nice: 3
          Restart: on-failure
      user: nobody
      timeout: 240 s
      environment: {{ LD_DEBUG: files, LD_DEBUG_OUTPUT: {seen}/loader, LEVEL: {level} }}
      samples: {{ from: json_lines, response_time: {{ field: ms, unit: ms }} }}
"""
LEVEL = 'a "3" $HOME `b` \\ c'
"""What a shell, and systemd's files of variables, read as more than letters."""


@pytest.fixture(autouse=True)
def seen() -> Iterator[Path]:
    """The folder of what components write."""
    SEEN.mkdir(parents=True)
    SEEN.chmod(0o1777)
    yield SEEN
    shutil.rmtree(SEEN)


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """The folder of a manifest; what rarms made for it is gone after the test."""
    yield tmp_path
    forget_host(tmp_path)


def output(*words: str) -> str:
    return subprocess.run(words, check=True, capture_output=True, text=True).stdout.strip()


def shown(unit: str, *properties: str) -> dict[str, str]:
    lines = output("systemctl", "show", f"--property={','.join(properties)}", unit).splitlines()
    return dict(line.partition("=")[::2] for line in lines)


def units(pattern: str) -> list[str]:
    return [
        line.split()[0] for line in output("systemctl", "list-units", "--plain", "--no-legend", pattern).splitlines()
    ]


def test_service_runs_in_its_partition(folder: Path) -> None:
    script = f"(env; cat /proc/self/cgroup; ulimit -l; nice; id -un; id -Gn; pwd) >{SEEN}/said; {WORKS}"
    words = {"slice": slice_of(folder), "seen": SEEN, "script": json.dumps(script), "level": json.dumps(LEVEL)}
    (folder / "rarms.yaml").write_text(MANIFEST.format(**words), encoding="utf-8")
    where = ("-f", str(folder))

    assert rarms("apply", *where, "--auto-approve").code == 0
    ran = rarms("run", *where, "camera", "--samples", "3")
    slice_unit = slice_of(folder).replace("-", "_")
    output("systemctl", "set-property", f"{slice_unit}-camera.slice", "CPUWeight=7")
    drifted, status = rarms("drift", *where), rarms("status", *where)

    assert ran.code == 0, ran.err
    assert "left their control group" not in ran.out + ran.err
    said = (SEEN / "said").read_text(encoding="utf-8").splitlines()
    assert f"LEVEL={LEVEL}" in said
    assert "OF_UNIT=1" in said
    group = next(line for line in said if line.startswith("0::"))
    assert group.startswith(f"0::/{slice_unit}.slice/{slice_unit}-camera.slice/rarms-camera-"), group
    locked, nice, user, groups, at = said[-5:]
    assert (locked, nice, user, at) == ("8192", "3", "nobody", "/run/robot")
    assert {"nogroup", "video"} <= {*groups.split()}
    started = "".join(file.read_text(errors="replace") for file in SEEN.glob("loader.*"))
    assert "program: /bin/sh" in started
    assert "systemd-run" not in started
    assert "systemctl" not in started
    assert units("rarms-camera-*") == []
    assert [*Path("/run").glob("rarms-camera-*")] == []
    assert drifted.code == 2
    assert "reserve" in drifted.out
    assert status.code == 0, status.err

    assert rarms("destroy", *where, "--auto-approve").code == 0
    assert units(f"{slice_unit}-*") == []


def test_threads_of_own_service_get_their_class(folder: Path) -> None:
    watching.apply(folder)
    unit = f"{slice_of(folder).replace('-', '_')}-arm.slice"
    (folder / "current").symlink_to(CHECKOUT / ".venv")
    places = RobotPlaces(versions=str(folder))
    words = ("--unit=arm", "--collect", f"--slice={unit}", sys.executable, "-c", watching.PROGRAM)
    install_there._install_boot(places)
    try:
        output("systemd-run", "--quiet", *words)
        process = int(shown("arm", "MainPID")["MainPID"])
        watching.awaited(lambda: watching.priorities(process), "controller-loop", (os.SCHED_FIFO, 20))
        others = watching.priorities(process)
        output("systemctl", "stop", WATCHER_PATH, WATCHER_UNIT)
        after = watching.priorities(process)
        output("systemctl", "stop", "arm")
    finally:
        install_there._remove_boot(places)

    assert others["planner"] == watching.USUAL
    assert after["controller-loop"] == watching.USUAL
    assert rarms("destroy", "-f", str(folder), "--auto-approve").code == 0


def service(script: str, *, stop: Stop | None = None, **properties: str | int) -> Run:
    """Lines of a service without a partition."""
    made = Service(exec=("/bin/sh", "-c", script), properties=ServiceProperties(**properties))  # type: ignore[arg-type]
    return replace(
        a_run(command=(), samples=LINES, timeout=SLOW), service=made, stop=stop or Stop(), until=SampleCount(samples=2)
    )


def work_of(component: Component) -> Work:
    """The component in P1, and nothing else: a load would take the emulated processors from everything."""
    parts = (
        PartitionWork(partition=P1, components=(component,)),
        *(PartitionWork(partition=name) for name in LOAD_PARTITIONS),
    )
    return Work(application="robot", partitions=parts, until={component.name: SampleCount(samples=5)}, seed=1)


def test_time_of_a_service_is_that_of_its_unit(tmp_path: Path) -> None:
    host = the_host(tmp_path)
    try:
        with ready(host), host.run(work_of(a_component("camera", run=service(WORKS)))) as running:
            samples, used_ms, evidence = list(running.samples()), running.cpu_ms("camera"), running.evidence()
    finally:
        forget_groups(tmp_path)

    assert len(samples) == 5
    assert used_ms is not None
    assert used_ms > 0
    assert evidence is not None
    assert evidence.outside == ()


@contextmanager
def running_service(unit: str, *properties: str) -> Iterator[str]:
    words = (f"--unit={unit}", *(f"--property={each}" for each in properties))
    output("systemd-run", "--quiet", "--collect", *words, "/bin/sh", "-c", WORKS)
    try:
        yield unit
    finally:
        output("systemctl", "stop", unit)


CPU = "CPUWeight", "CPUQuotaPerSecUSec", "CPUQuotaPeriodUSec"
HELD = {"CPUWeight": "10000", "CPUQuotaPerSecUSec": "600ms", "CPUQuotaPeriodUSec": "20ms"}
UNLIMITED = {"cpu.weight": "100", "cpu.max": "max 100000"}
"""The kernel has no such files where systemd has turned the controller off, as no unit of the slice has a value."""
HELD_IN_KERNEL = ("10000", "12000 20000")
"""Weight and quota of P1 at a reservation of 30 % of two processors."""


def in_kernel(unit: str) -> tuple[str, str]:
    """Weight and quota of a unit's control group, as the kernel has them."""
    group = Path("/sys/fs/cgroup" + shown(unit, "ControlGroup")["ControlGroup"])
    files = {name: group / name for name in UNLIMITED}
    weight, quota = (
        file.read_text(encoding="ascii").strip() if file.exists() else UNLIMITED[name] for name, file in files.items()
    )
    return weight, quota


def nav2(service: str = "nav2") -> Component:
    return a_component("nav2", run=Run(attach=AttachedService(service=service), samples=LINES))


class MortalPrograms(MortalEffects):
    """Each call of systemd that changes something may be the last one, too."""

    def run(self, *words: str, may_fail: bool = False) -> None:
        self._count()
        super().run(*words, may_fail=may_fail)


@pytest.fixture
def tested(tmp_path: Path) -> Iterator[Path]:
    """The folder of a host whose test partitions are gone after the test."""
    yield tmp_path
    forget_groups(tmp_path)


@pytest.mark.parametrize(
    ("properties", "own"),
    [
        pytest.param((), ("100", "max 100000"), id="none"),
        pytest.param(("CPUWeight=30", "CPUQuota=150%", "CPUQuotaPeriodSec=50ms"), ("30", "75000 50000"), id="own"),
    ],
)
def test_service_is_held_and_given_back(tested: Path, properties: tuple[str, ...], own: tuple[str, str]) -> None:
    host = the_host(tested)
    with running_service("nav2", *properties):
        before, group = shown("nav2", *CPU), shown("nav2", "ControlGroup")
        with host.lock("test"), ready(host, reserve=30):
            with host.run(work_of(nav2())) as running:
                samples, held, state = list(running.samples()), shown("nav2", *CPU), host.observe()
                where, used_ms, evidence = shown("nav2", "ControlGroup"), running.cpu_ms("nav2"), running.evidence()
                held_in_kernel = in_kernel("nav2")
                rest = [host.tree.read(host.tree.name_for(name)).quota_percent for name in LOAD_PARTITIONS]
            after = shown("nav2", *CPU)
            with suppress(KeyboardInterrupt), host.run(work_of(nav2())):
                raise KeyboardInterrupt
            interrupted = shown("nav2", *CPU)
        after_in_kernel = in_kernel("nav2")
        left = list(Path("/run/systemd/system.control").glob("nav2.service.d/*"))

    assert len(samples) == 5
    assert held == HELD
    assert held_in_kernel == HELD_IN_KERNEL
    assert where == group, "nothing is moved"
    assert rest == pytest.approx([70, 70], abs=1)
    assert state.attached == "the service nav2"
    assert used_ms is not None
    assert used_ms > 0
    assert evidence is not None
    assert evidence.outside == ()
    assert after == interrupted == before
    assert after_in_kernel == own
    assert left == []
    assert host.observe().attached == ""


def is_killed(host: LinuxMeasuringHost) -> bool:
    """Hold nav2 and give it back; the test partitions are there."""
    try:
        with host.lock("test"), host.run(work_of(nav2())):
            pass
    except Killed:
        return True
    return False


def test_killed_at_each_change_is_given_back(tested: Path) -> None:
    at, shared = 1, the_host(tested)
    with running_service("nav2", "CPUWeight=30"), ready(shared):
        before = shown("nav2", *CPU)
        while is_killed(the_host(tested, MortalPrograms(at))):
            left = the_host(tested)
            assert at == 1 or left.observe().attached == "the service nav2"
            with left.lock("the next command"):
                assert left.observe().attached == ""
            assert shown("nav2", *CPU) == before, at
            at += 1

    assert at > 6


def refused(host: LinuxMeasuringHost, service: str) -> str:
    obstacle = host.obstacle(nav2(service))
    return "" if obstacle is None else obstacle.reason


def test_services_that_cannot_be_held_are_refused(tested: Path) -> None:
    host = the_host(tested)
    with running_service("nav2@1"), running_service("priority", "CPUSchedulingPolicy=fifo", "CPUSchedulingPriority=5"):
        assert "the service nav2.service is not running, but its instance nav2@1.service is" in refused(host, "nav2")
        assert refused(host, "nav2@1") == ""
        assert "has SCHED_FIFO" in refused(host, "priority")
        assert "the service nobody.service is not running" in refused(host, "nobody")
        assert "contains rarms itself" in refused(host, "job")
        with running_service("nav2@2"):
            assert "several services have the name nav2: nav2@1.service, nav2@2.service" in refused(host, "nav2")


PODMAN = ("--cgroup-manager=systemd", "--runtime=runc", "--network=none", "--log-driver=k8s-file")
LIMITS = ("--ulimit=nofile=1024:1024", "--ulimit=nproc=1024:1024")


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A root file system of busybox."""
    for name in ("bin", "dev", "proc", "sys", "tmp", "etc", "run"):
        (tmp_path / "root" / name).mkdir(parents=True)
    shutil.copy(str(shutil.which("busybox")), tmp_path / "root" / "bin" / "busybox")
    for link in ("sh", "sleep", "cat"):
        (tmp_path / "root" / "bin" / link).symlink_to("busybox")
    return tmp_path / "root"


def test_container_runs_in_its_partition(tested: Path, root: Path) -> None:
    options = (*PODMAN, *LIMITS, "--rootfs")
    made = Container(engine="podman", image=str(root), options=options, command=("/bin/sh", "-c", WORKS))
    eyes = a_component("eyes", run=replace(a_run(command=(), samples=LINES, timeout=SLOW), container=made))
    host = the_host(tested)

    with ready(host), host.run(work_of(eyes)) as running:
        samples, used_ms, evidence = list(running.samples()), running.cpu_ms("eyes"), running.evidence()
        scopes = [path.name for path in host.tree.folders_of(host.tree.name_for(P1))[0].glob("libpod-*")]

    assert len(samples) == 5
    assert len(scopes) == 1
    assert scopes[0].endswith(".scope")
    assert used_ms is not None
    assert used_ms > 0
    assert evidence is not None
    assert evidence.outside == ()


def test_container_is_held_and_given_back(tested: Path, root: Path) -> None:
    words = (*PODMAN, *LIMITS, "--detach", "--rm", "--name=eyes", "--rootfs", str(root), "/bin/sh", "-c", WORKS)
    output("podman", "run", *words)
    try:
        host = the_host(tested)
        component = a_component(
            "eyes", run=Run(attach=AttachedContainer(container="eyes", engine="podman"), samples=LINES)
        )
        process = output("podman", "inspect", "--format={{.State.Pid}}", "eyes")
        scope = Path(f"/proc/{process}/cgroup").read_text(encoding="ascii").strip().rpartition("/")[2]
        before, before_in_kernel = shown(scope, *CPU), in_kernel(scope)
        with host.lock("test"), ready(host, reserve=30):
            with host.run(work_of(component)) as running:
                samples, held, held_in_kernel = list(running.samples()), shown(scope, *CPU), in_kernel(scope)
            after, after_in_kernel = shown(scope, *CPU), in_kernel(scope)
    finally:
        output("podman", "rm", "--force", "--time=0", "eyes")

    assert scope.endswith(".scope")
    assert len(samples) == 5
    assert (held, held_in_kernel) == (HELD, HELD_IN_KERNEL)
    assert (after, after_in_kernel) == (before, before_in_kernel)
