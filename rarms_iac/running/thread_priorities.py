"""Gives threads the priority of a task class by their names, so that a program need not be changed (Linux).

In: rules, and the control groups or processes to look at. Out: threads in SCHED_FIFO, and what was seen of them. The
standard library only: the supervisor of a component loads this file by its path. Begin at `ThreadPriorities`.
"""

import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple

LOOK_EVERY_S = 0.25
"""A thread that begins has its usual priority for at most so long."""

SHOWN_NAMES = 12
_STARTED = 19
"""The field of `/proc/<id>/stat` after the name that has the start time (proc_pid_stat(5))."""


class ThreadRule(NamedTuple):
    """The values for the threads with a name."""

    pattern: str  # of the thread's name, as a shell's
    priority: int  # of SCHED_FIFO
    affinity: int = 0  # a bit for each processor that it may use; 0: all


class _Usual(NamedTuple):
    """The values of a thread before it got those of a rule."""

    policy: int
    priority: int
    processors: frozenset[int]


class ThreadPriorities:
    """The threads that have a priority by rules, look after look."""

    def __init__(self, rules: Sequence[ThreadRule]) -> None:
        self._rules = rules
        self._usual: dict[tuple[int, str], _Usual] = {}  # by id and start time of the threads that have a rule's values
        self._matched: set[str] = set()
        self._names: set[str] = set()
        self._refused = ""

    def look(self, processes: Iterable[int]) -> None:
        """Give each thread of these processes the values of its rule, and others back what they had.

        A new thread has the name of the one that made it, until it takes another.
        """
        there = set()
        for thread, started, name in _threads(processes):
            there.add((thread, started))
            if len(self._names) < SHOWN_NAMES:
                self._names.add(name)
            rule = next((rule for rule in self._rules if fnmatchcase(name, rule.pattern)), None)
            if rule is not None:
                self._matched.add(rule.pattern)
            with suppress(ProcessLookupError):  # it has ended
                self._apply((thread, started), name, rule)
        self._usual = {thread: usual for thread, usual in self._usual.items() if thread in there}

    def seen(self) -> dict[str, Any]:
        """Return what was seen so far: names without a thread, names of threads, and what the kernel refused."""
        unmatched = [rule.pattern for rule in self._rules if rule.pattern not in self._matched]
        return {"unmatched": unmatched, "names": sorted(self._names), "refused": self._refused}

    def _apply(self, thread: tuple[int, str], name: str, rule: ThreadRule | None) -> None:
        if sys.platform != "linux":
            return
        number = thread[0]
        try:
            if rule is None:
                if (usual := self._usual.pop(thread, None)) is not None:
                    os.sched_setscheduler(number, usual.policy, os.sched_param(usual.priority))
                    os.sched_setaffinity(number, usual.processors)
                return
            policy, wanted = os.sched_getscheduler(number), os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
            priority = os.sched_getparam(number).sched_priority
            if (policy, priority) == (wanted, rule.priority):
                return
            usual = _Usual(policy, priority, frozenset(os.sched_getaffinity(number)))
            if rule.affinity:
                allowed = {at for at in range(rule.affinity.bit_length()) if rule.affinity >> at & 1}
                os.sched_setaffinity(number, allowed)
            os.sched_setscheduler(number, wanted, os.sched_param(rule.priority))
            self._usual.setdefault(thread, usual)
        except ProcessLookupError:
            raise
        except OSError as problem:
            self._refused = self._refused or f"{name}: {problem.strerror or problem}"


def members(groups: Iterable[str]) -> Iterator[int]:
    """Yield the ids of the processes in control groups and below them."""
    for group in groups:
        for folder, _, files in os.walk(group):
            if "cgroup.procs" in files:
                with suppress(OSError):
                    yield from map(int, (Path(folder) / "cgroup.procs").read_text(encoding="ascii").split())


def _threads(processes: Iterable[int]) -> Iterator[tuple[int, str, str]]:
    """Yield id, start time and name of each thread."""
    for process in processes:
        with suppress(OSError):
            for entry in os.scandir(f"/proc/{process}/task"):
                with suppress(OSError, IndexError):
                    text = Path(entry.path, "stat").read_text(encoding="utf-8", errors="replace")
                    before, _, after = text.rpartition(")")
                    yield int(entry.name), after.split()[_STARTED], before.partition("(")[2]
