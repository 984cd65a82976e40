"""Components in containers, by a real podman in real control groups: their time, their end, and what stays."""

import json
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac.model.run import Container, Run, SampleCount, Samples, Stop, TimeField
from rarms_iac.model.setting import P1
from rarms_iac.providers.measuring import PartitionWork, Work
from rarms_iac.running.component import ComponentRun
from rarms_iac.running.orders import StartContext
from tests.builders import a_component, a_run
from tests.contracts.benches import forget_groups
from tests.contracts.test_measuring_contract import linux, ready

pytestmark = [pytest.mark.needs("control-groups", "podman"), pytest.mark.alone]

OPTIONS = (
    "--cgroup-manager=cgroupfs",
    "--runtime=runc",
    "--network=none",
    "--ulimit=nofile=1024:1024",
    "--ulimit=nproc=1024:1024",
)
"""What podman needs on machines without systemd and with small limits; no defaults of rarms."""
LINES = Samples(source="json_lines", response_time=TimeField(field="ms", unit="ms"))
WORKS = "while :; do i=0; while [ $i -lt 20000 ]; do i=$((i+1)); done; echo '{\"ms\": 60}'; done"


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """A folder with a root file system of busybox, whose host makes control groups; they are gone after the test."""
    root = tmp_path / "root"
    for name in ("bin", "dev", "proc", "sys", "tmp", "etc", "run", "out"):
        (root / name).mkdir(parents=True)
    shutil.copy(str(shutil.which("busybox")), root / "bin" / "busybox")
    for name in ("sh", "sleep", "cat", "id"):
        (root / "bin" / name).symlink_to("busybox")
    yield tmp_path
    forget_groups(tmp_path)


def in_container(folder: Path, script: str, *options: str) -> Run:
    container = Container(
        engine="podman",
        image=str(folder / "root"),
        options=(*OPTIONS, *options, "--rootfs"),
        command=("/bin/sh", "-c", script),
    )
    return replace(a_run(command=(), samples=LINES), container=container)


def containers() -> list[str]:
    listed = subprocess.run(["podman", "ps", "--all", "--format", "json"], capture_output=True, text=True, check=True)
    return [name for each in json.loads(listed.stdout or "[]") for name in each["Names"] if "rarms-eyes-" in name]


def test_time_of_a_container_counts_in_its_partition(folder: Path) -> None:
    eyes = a_component("eyes", run=in_container(folder, WORKS))
    work = Work(
        application="robot",
        partitions=(PartitionWork(partition=P1, components=(eyes,)),),
        until={"eyes": SampleCount(samples=20)},
        seed=1,
    )
    host = linux(folder)
    with ready(host):
        with host.run(work) as running:
            for number, _ in enumerate(running.samples()):
                if number == 5:
                    running.count_from_now()  # as after the warm-up: the engine's own start does not count
            used_ms, evidence = running.cpu_ms("eyes"), running.evidence()
            threads = running.used_processors(P1)
        assert evidence is not None
        assert used_ms is not None
        assert used_ms > 0.5 * evidence.elapsed_ms  # it never waits
        assert [each for each in evidence.outside if each.component == "eyes"] == []
        assert threads == 1
    assert containers() == []


def test_a_container_ends_by_its_signal_and_grace(folder: Path) -> None:
    traps = f"trap 'echo ended >>/out/said; exit 0' INT; echo '{{\"ms\": 1}}' >>/out/lines; {WORKS}"
    (folder / "out").mkdir()
    file = Samples(source="json_lines", response_time=TimeField(field="ms", unit="ms"), file="out/lines")
    run = in_container(folder, traps, f"--volume={folder}/out:/out")
    run = replace(run, samples=file, stop=Stop(signal="INT"), until=SampleCount(samples=1))

    with ComponentRun("eyes", run, StartContext(base=folder)) as running:
        assert [sample.response_ms for sample in running] == [1]

    assert (folder / "out" / "said").read_text(encoding="utf-8") == "ended\n"
    assert containers() == []


def manifest(folder: Path, script: str) -> None:
    run = in_container(folder, script)
    assert run.container is not None
    text = {
        "schema": "rarms/v1",
        "application": {"name": "robot"},
        "hosts": {"onboard": {"provider": "linux", "logical_processors": 2, "memory": "1 GiB"}},
        "components": {
            "eyes": {
                "criticality": 1,
                "run": {
                    "container": {
                        "engine": run.container.engine,
                        "image": run.container.image,
                        "options": list(run.container.options),
                        "command": list(run.container.command),
                    },
                    "samples": {"from": "json_lines", "response_time": {"field": "ms", "unit": "ms"}},
                    "stop": {"grace": "1 s"},
                },
            }
        },
    }
    (folder / "rarms.yaml").write_text(json.dumps(text), encoding="utf-8")


def started(folder: Path, *words: str) -> "subprocess.Popen[str]":
    """`rarms run eyes`, once its container has written a sample."""
    manifest(folder, WORKS)
    process = subprocess.Popen(
        [sys.executable, "-m", "rarms_iac", "run", *words, "eyes"],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert "60" in process.stdout.readline()
    return process


def gone() -> bool:
    until = time.monotonic() + 60
    while containers() and time.monotonic() < until:
        time.sleep(0.2)
    return not containers()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_no_container_stays_when_rarms_ends(folder: Path, number: signal.Signals) -> None:
    process = started(folder, "--samples", "100000")

    process.send_signal(number)

    process.communicate(timeout=60)
    assert gone()


def test_a_container_without_partition_left_no_group(folder: Path) -> None:
    process = started(folder, "--samples", "3")

    said, errors = process.communicate(timeout=60)

    assert process.returncode == 0, errors
    assert "left their control group" not in said + errors


def test_a_service_becomes_its_container(folder: Path) -> None:
    process = started(folder, "--exec")

    process.send_signal(signal.SIGTERM)

    process.communicate(timeout=60)
    assert process.returncode == 128 + signal.SIGKILL  # its shell is deaf to SIGTERM, as process 1 of the container
    assert gone()
