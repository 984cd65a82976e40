"""Threads of a program that knows nothing of rarms get their task class by their names: real threads and groups."""

import os
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac.model.host import ProviderKind
from rarms_iac.model.run import SampleCount, Samples, TimeField
from rarms_iac.model.setting import P1, SettingEvidence
from rarms_iac.model.system import ThreadsTask
from rarms_iac.planner.task_classes import classes_of
from rarms_iac.providers.cgroups.measuring import LinuxMeasuringHost
from rarms_iac.providers.interface import HostRefused
from rarms_iac.providers.measuring import PartitionWork, Work
from tests.builders import PathPlaces, a_component, a_host, a_run
from tests.contracts.benches import forget_groups, groups_of
from tests.contracts.test_measuring_contract import ready

LINES = Samples(source="json_lines", response_time=TimeField(field="ms", unit="ms"))
PROGRAM = """\
import ctypes, threading, time
libc = ctypes.CDLL(None)
def work(name, later=None):
    libc.prctl(15, name.encode(), 0, 0, 0)  # PR_SET_NAME
    if later:
        time.sleep(0.6)
        libc.prctl(15, later.encode(), 0, 0, 0)
    while True:
        time.sleep(0.02)
for names in (["controller-loop"], ["planner"], ["controller-once", "logger"]):
    threading.Thread(target=work, args=names, daemon=True).start()
while True:
    time.sleep(0.05)
    print('{"ms": 5}', flush=True)
"""

pytestmark = [pytest.mark.needs("control-groups"), pytest.mark.alone]


@pytest.fixture
def host(tmp_path: Path) -> Iterator[LinuxMeasuringHost]:
    """This machine; its control groups are gone after the test."""
    (tmp_path / "arm.py").write_text(PROGRAM, encoding="utf-8")
    yield LinuxMeasuringHost(a_host(provider=ProviderKind.LINUX), tmp_path, tmp_path / "state", groups_of(tmp_path))
    forget_groups(tmp_path)


def ran(host: LinuxMeasuringHost, *threads: str) -> tuple[SettingEvidence, dict[str, tuple[int, int]]]:
    """What was counted of the component `arm`, and policy and priority of its threads at the end."""
    arm = a_component(
        "arm",
        run=a_run(command=(sys.executable, "arm.py"), samples=LINES),
        task=ThreadsTask(task_class="MotionControl", threads=threads),
    )
    classes = classes_of((arm,), {}, P1, PathPlaces()).classes
    part = PartitionWork(partition=P1, components=(arm,), classes=classes)
    work = Work(application="robot", partitions=(part,), until={"arm": SampleCount(samples=30)}, seed=1)
    with ready(host), host.run(work) as running:
        for _ in running.samples():
            pass
        for _ in range(100):  # until the supervisor has seen the last name that a thread takes
            if "logger" in running.runs[0].threads.names:
                break
            time.sleep(0.1)
        group = running.groups[P1]
        ids = [int(task.name) for pid in host.tree.processes(group) for task in Path(f"/proc/{pid}/task").iterdir()]
        values = {
            Path(f"/proc/{thread}/comm").read_text(encoding="ascii").strip(): (
                os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK,
                os.sched_getparam(thread).sched_priority,
            )
            for thread in ids
        }
        evidence = running.evidence()
    assert evidence is not None
    return evidence, values


def test_matching_threads_get_the_class(host: LinuxMeasuringHost) -> None:
    evidence, values = ran(host, "controller*")

    policy, priority = values["controller-loop"]
    assert policy == os.SCHED_FIFO
    assert priority > 1
    assert values["planner"] == values["logger"] == (os.SCHED_OTHER, 0)
    assert evidence.threads == {}


def test_pattern_without_a_thread_is_told(host: LinuxMeasuringHost) -> None:
    evidence, _ = ran(host, "planner", "control_loop")

    assert evidence.threads["arm"].unmatched == ("control_loop",)
    assert {"controller-loop", "planner"} <= set(evidence.threads["arm"].names)


def test_endless_real_time_is_refused(host: LinuxMeasuringHost, monkeypatch: pytest.MonkeyPatch) -> None:
    endless = replace(host.facts, deadline_percent=100)
    monkeypatch.setattr("rarms_iac.providers.cgroups.provider.read_facts", lambda *_: endless)

    with pytest.raises(HostRefused, match="sched_rt_runtime_us"):
        ran(host, "controller*")


def test_removed_groups_free_their_budgets(host: LinuxMeasuringHost) -> None:
    # 60 % each time: the kernel gives all groups of the machine 95 % together
    measured = [ran(host, "controller*")[0] for _ in range(3)]

    assert [evidence.threads for evidence in measured] == [{}, {}, {}]
