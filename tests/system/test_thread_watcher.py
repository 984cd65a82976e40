"""Threads of programs that rarms did not start get their task class as applied: real threads, real control groups."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from rarms_iac.app.install_there import RobotPlaces
from rarms_iac.providers.cgroups.provider import STATE_FOLDER
from tests.contracts.benches import forget_host, groups_of, slice_of
from tests.needs import CHECKOUT
from tests.unit.cli.running import rarms

MANIFEST = """\
schema: rarms/v1
application: {{ name: robot }}
hosts:
  onboard: {{ provider: linux, logical_processors: 2, memory: 1 GiB, linux: {{ slice: {slice} }} }}
components:
  arm: {{ criticality: 1, memory: 64 MiB, cpu: {{ reserve: 20 % }}, task: {task} }}
tasks: {{ MotionControl: {{ category: Medium, priority: {priority} }} }}
"""
TASK = '{ class: MotionControl, threads: ["controller*"] }'
PROGRAM = """\
import ctypes, threading, time
libc = ctypes.CDLL(None)
def work(name):
    libc.prctl(15, name.encode(), 0, 0, 0)  # PR_SET_NAME
    time.sleep(600)
for name in ("controller-loop", "planner"):
    threading.Thread(target=work, args=(name,), daemon=True).start()
time.sleep(600)
"""
USUAL = (os.SCHED_OTHER, 0)

pytestmark = [pytest.mark.needs("control-groups"), pytest.mark.alone]


def priorities(process: int) -> dict[str, tuple[int, int]]:
    """Policy and priority of a process's threads, by name."""
    tasks = [int(task.name) for task in Path(f"/proc/{process}/task").iterdir()]
    return {
        Path(f"/proc/{task}/comm").read_text(encoding="ascii").strip(): (
            os.sched_getscheduler(task) & ~os.SCHED_RESET_ON_FORK,
            os.sched_getparam(task).sched_priority,
        )
        for task in tasks
    }


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """The folder of a manifest; what rarms made for it is gone after the test."""
    yield tmp_path
    forget_host(tmp_path)


@pytest.fixture
def service(folder: Path) -> Iterator[Callable[[], dict[str, tuple[int, int]]]]:
    """A program in the partition that rarms did not start; what it returns are the `priorities` of its threads."""
    apply(folder)
    tree = groups_of(folder)
    with subprocess.Popen([sys.executable, "-c", PROGRAM]) as program:
        for group in tree.folders_of(tree.name_for("arm")):
            (group / "cgroup.procs").write_text(str(program.pid), encoding="ascii")

        try:
            yield lambda: priorities(program.pid)
        finally:
            program.kill()


@pytest.fixture
def watcher() -> Iterator[subprocess.Popen[str]]:
    """The process that `rarms install` has the system start."""
    words = [sys.executable, "-I", "-m", "rarms_iac.running.thread_watcher", str(STATE_FOLDER)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def apply(folder: Path, task: str = TASK, priority: int = 4) -> None:
    text = MANIFEST.format(slice=slice_of(folder), task=task, priority=priority)
    if task != TASK:
        text = text.partition("tasks:")[0]
    (folder / "rarms.yaml").write_text(text, encoding="utf-8")
    applied = rarms("apply", "-f", str(folder), "--auto-approve")
    assert applied.code == 0, applied.err


def awaited(values: Callable[[], dict[str, tuple[int, int]]], thread: str, wanted: tuple[int, int]) -> None:
    until = time.monotonic() + 30
    while (found := values().get(thread)) != wanted:
        assert time.monotonic() < until, found
        time.sleep(0.1)


def test_threads_of_service_get_applied_class(
    folder: Path, service: Callable[[], dict[str, tuple[int, int]]], watcher: subprocess.Popen[str]
) -> None:
    awaited(service, "controller-loop", (os.SCHED_FIFO, 20))
    assert service()["planner"] == USUAL

    (folder / "rarms.yaml").write_text(MANIFEST.format(slice=slice_of(folder), task=TASK, priority=6), encoding="utf-8")
    planned = rarms("plan", "-f", str(folder)).out
    assert "threads" in planned
    assert "controller* at 20 -> controller* at 22" in planned
    apply(folder, priority=6)
    awaited(service, "controller-loop", (os.SCHED_FIFO, 22))

    assert rarms("undo", "-f", str(folder), "--auto-approve").code == 0
    awaited(service, "controller-loop", (os.SCHED_FIFO, 20))

    watcher.terminate()
    said, _ = watcher.communicate(timeout=30)
    assert service()["controller-loop"] == USUAL
    assert watcher.returncode == 0
    assert said.splitlines() == [f"arm: priorities of threads: controller* at {priority}." for priority in (20, 22, 20)]


def test_watcher_ends_without_rules(
    folder: Path, service: Callable[[], dict[str, tuple[int, int]]], watcher: subprocess.Popen[str]
) -> None:
    awaited(service, "controller-loop", (os.SCHED_FIFO, 20))

    apply(folder, task="MotionControl")

    said, _ = watcher.communicate(timeout=30)
    assert watcher.returncode == 0
    assert service()["controller-loop"] == USUAL
    assert said.splitlines()[1:] == ["arm: threads have their usual priority again."]


def test_killed_watcher_leaves_no_priority_behind(
    folder: Path, service: Callable[[], dict[str, tuple[int, int]]], watcher: subprocess.Popen[str]
) -> None:
    awaited(service, "controller-loop", (os.SCHED_FIFO, 20))
    watcher.kill()
    watcher.wait()

    words = [sys.executable, "-I", "-m", "rarms_iac.running.thread_watcher", str(STATE_FOLDER)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as after:
        assert after.stdout is not None
        after.stdout.readline()
        time.sleep(1)
        after.terminate()

    assert service()["controller-loop"] == USUAL


def test_cron_keeps_one_watcher(folder: Path, service: Callable[[], dict[str, tuple[int, int]]]) -> None:
    (folder / "current").symlink_to(CHECKOUT / ".venv")
    places = RobotPlaces(versions=str(folder), state=str(STATE_FOLDER), systemd=str(folder / "none"), cron=str(folder))
    (text,) = places.boot_files.values()
    command = text.splitlines()[1].removeprefix("* * * * * root ").removesuffix(" 2>&1 | logger -t rarms-threads")

    with subprocess.Popen(["sh", "-c", f"exec {command.rpartition(' && ')[2]}"], stdout=subprocess.PIPE) as first:
        awaited(service, "controller-loop", (os.SCHED_FIFO, 20))
        second = subprocess.run(["sh", "-c", command], capture_output=True, timeout=30, check=False)
        (folder / "current").unlink()  # another version is installed
        first.wait(timeout=30)

    assert (second.returncode, second.stdout) == (0, b"")
    assert service()["controller-loop"] == USUAL
