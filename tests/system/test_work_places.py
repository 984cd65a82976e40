"""Where the work of a component runs and what the kernel killed: real processes, control groups and a container."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from rarms_iac.model.run import SampleCount, Samples, TimeField
from rarms_iac.model.setting import P1, OutsideWork, SettingEvidence
from rarms_iac.model.system import Component
from rarms_iac.providers.cgroups.effects import LinuxEffects
from rarms_iac.providers.interface import HostFailed
from rarms_iac.providers.measuring import PartitionWork, Work
from tests.builders import a_component, a_run
from tests.contracts.benches import forget_groups
from tests.contracts.test_measuring_contract import linux, ready, some_work
from tests.needs import require

LINES = Samples(source="json_lines", response_time=TimeField(field="ms", unit="ms"))
PARENT = '--cgroup-parent "$RARMS_CGROUP_PARENT"'
CONTAINER = (
    "exec podman --cgroup-manager=cgroupfs --runtime runc run --rm --network=none --ulimit nofile=1024:1024 "
    "--ulimit nproc=1024:1024 {parent} --rootfs {root} /bin/sh -c '{loop}'"
)
LOOP = 'while :; do i=0; while [ $i -lt 20000 ]; do i=$((i+1)); done; echo "{\\"ms\\": 5}"; done'

LEAVES = """\
import os, pathlib, sys, time
for controller in ("cpu", "cpuacct"):
    for procs in pathlib.Path("/sys/fs/cgroup").glob(controller + "/cgroup.procs"):
        procs.write_text(str(os.getpid()))
while True:
    until = time.process_time() + 0.02
    while time.process_time() < until: pass
    print('{"ms": 20}', flush=True)
"""
LEAVES_AND_ENDS = """\
import os, pathlib, time
for procs in pathlib.Path("/sys/fs/cgroup").glob("*/rarms-elsewhere/cgroup.procs"):
    procs.write_text(str(os.getpid()))
while time.process_time() < 1: pass
"""
RUN_ALONE = f"""\
schema: rarms/v1
application: {{ name: robot }}
hosts: {{ onboard: {{ provider: linux, logical_processors: 2, memory: 1 GiB }} }}
components:
  eyes:
    criticality: 1
    run: {{ command: ["{sys.executable}", leaves.py], until: {{ samples: 2 }} }}
"""
HUNGRY = """\
import time
print('{"ms": 1}', flush=True)
eaten = []
while True:
    eaten.append(bytearray(8 << 20))
    time.sleep(0.001)
"""


BRISK = """\
import time
while True:
    print('{"ms": 5}', flush=True)
    time.sleep(0.005)
"""


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """A folder whose host makes control groups; they are gone after the test."""
    yield tmp_path
    forget_groups(tmp_path)


def evidence_of(folder: Path, *command: str, samples: int = 12) -> SettingEvidence:
    """What a Linux host counts while the component `eyes` runs this command alone in P1."""
    eyes: Component = a_component("eyes", run=a_run(command=command, samples=LINES))
    work = Work(
        application="robot",
        partitions=(PartitionWork(partition=P1, components=(eyes,)),),
        until={"eyes": SampleCount(samples=samples)},
        seed=1,
    )
    host = linux(folder)
    with ready(host), host.run(work) as running:
        for _ in running.samples():
            pass
        evidence = running.evidence()
    assert evidence is not None
    return evidence


def of_eyes(evidence: SettingEvidence) -> list[OutsideWork]:
    """Its processes that left its group: others run on this machine, too."""
    return [work for work in evidence.outside if work.component == "eyes"]


@pytest.mark.needs("control-groups", "podman")
@pytest.mark.alone
def test_a_container_outside_its_partition_is_named(folder: Path) -> None:
    root = folder / "root"
    for name in ("bin", "dev", "proc", "sys", "tmp", "etc", "run"):
        (root / name).mkdir(parents=True)
    shutil.copy(str(shutil.which("busybox")), root / "bin" / "busybox")
    (root / "bin" / "sh").symlink_to("busybox")

    def evidence(parent: str) -> SettingEvidence:
        return evidence_of(folder, "sh", "-c", CONTAINER.format(parent=parent, root=root, loop=LOOP))

    outside, inside = evidence(""), evidence(PARENT)

    largest, *_ = of_eyes(outside)
    assert largest.name == "sh", outside
    assert "/libpod-" in largest.group
    assert largest.cpu_ms > outside.cpu_ms[P1]
    assert [work for work in of_eyes(inside) if work.name == "sh"] == []
    assert inside.cpu_ms[P1] > 20


@pytest.mark.needs("control-groups")
@pytest.mark.alone
def test_a_process_that_leaves_its_group_is_named(folder: Path) -> None:
    if not Path("/sys/fs/cgroup/cpuacct").is_dir():
        require("control-groups of version 1")

    found = evidence_of(folder, sys.executable, "-c", LEAVES)

    assert [work.group for work in of_eyes(found)] == ["/"], found


@pytest.mark.needs("control-groups")
@pytest.mark.alone
def test_run_names_work_of_jobs_that_ended(tmp_path: Path) -> None:
    if not Path("/sys/fs/cgroup/cpuacct").is_dir():
        require("control-groups of version 1")
    elsewhere = [parent / "rarms-elsewhere" for parent in Path("/sys/fs/cgroup").glob("cpu[a,]*") if parent.is_dir()]
    for group in elsewhere:
        group.mkdir(exist_ok=True)
    (tmp_path / "leaves.py").write_text(LEAVES_AND_ENDS, encoding="utf-8")
    (tmp_path / "rarms.yaml").write_text(RUN_ALONE, encoding="utf-8")

    words = [sys.executable, "-m", "rarms_iac", "run", "eyes"]
    said = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)

    for group in elsewhere:
        group.rmdir()
    assert "Processes of eyes left their control group: python" in said.stdout + said.stderr
    assert "in /rarms-elsewhere" in said.stdout + said.stderr


@pytest.mark.needs("control-groups")
@pytest.mark.alone
def test_memory_kills_are_counted(folder: Path) -> None:
    found = evidence_of(folder, sys.executable, "-c", HUNGRY, samples=3)

    assert found.out_of_memory["eyes"] >= 1


@pytest.mark.needs("control-groups")
@pytest.mark.alone
@pytest.mark.parametrize("file", ["cpu.stat", "cgroup.procs"])
def test_odd_counters_are_the_hosts_failure(folder: Path, monkeypatch: pytest.MonkeyPatch, file: str) -> None:
    real, odd = LinuxEffects.read, [False]

    def read(effects: LinuxEffects, path: Path) -> str:
        return "usage_usec abc\nthrottled_time abc" if odd[0] and path.name == file else real(effects, path)

    monkeypatch.setattr(LinuxEffects, "read", read)
    eyes = a_component("eyes", run=a_run(command=(sys.executable, "-c", BRISK), samples=LINES))
    host = linux(folder)

    def use() -> None:
        with host.run(some_work(eyes, eyes=SampleCount(samples=500))) as running:
            for _ in running.samples():
                odd[0] = True
                running.used_processors(P1)
                running.evidence()

    with ready(host):
        with pytest.raises(HostFailed, match=file):
            use()
        odd[0] = False
