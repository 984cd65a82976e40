"""How many threads of a group run, or wait for a processor, at once: on real processes."""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import cast

import pytest

from rarms_iac.providers.cgroups.groups import GroupTree
from rarms_iac.providers.cgroups.processes import ThreadLooks, looking_at

pytestmark = pytest.mark.needs("linux")

BUSY, IDLE = "print(flush=True)\nwhile True: pass", "import time; print(flush=True); time.sleep(600)"


class Group:
    """A control group that has these processes, as far as it is asked here."""

    def __init__(self, processes: list[int]) -> None:
        self._processes = tuple(processes)

    def processes(self, _name: str) -> tuple[int, ...]:
        return self._processes


@contextmanager
def running(*programs: str) -> Iterator[Group]:
    started = [subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) for program in programs]
    try:
        for process in started:
            assert process.stdout is not None
            assert process.stdout.readline()
        yield Group([process.pid for process in started])
    finally:
        for process in started:
            process.kill()
            process.communicate()


def looked_at(group: Group) -> ThreadLooks:
    with looking_at(cast("GroupTree", group), "rarms-p1") as looks:
        time.sleep(0.5)
    return looks


@pytest.mark.parametrize(("programs", "most"), [((BUSY, IDLE), 1), ((BUSY, BUSY, IDLE), 2)])
def test_running_and_waiting_threads_count(programs: tuple[str, ...], most: int) -> None:
    with running(*programs) as group:
        looks = looked_at(group)

    assert looks.most(500.0) == most


def test_unseen_or_rare_use_does_not_count() -> None:
    with running(BUSY) as group:
        looks = looked_at(group)

    assert ThreadLooks(cast("GroupTree", group), "rarms-p1").most(1.0) is None
    assert looks.most(1_000_000.0) == 1
