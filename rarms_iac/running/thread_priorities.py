"""Gives threads the priority of a task class by their names, so that a program need not be changed (Linux).

In: rules, and the control groups or processes to look at. Out: threads in SCHED_FIFO, and what was seen of them. The
standard library only: the supervisor of a component loads this file by its path, and `thread_watcher` is a small
process. Begin at `ThreadPriorities`.
"""

import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from fnmatch import fnmatchcase
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


def rules_text(rules: Iterable[ThreadRule]) -> str:
    """Write rules as a setting of a partition: `controller* at 21, planner at 19`. No name has a comma."""
    return ", ".join(f"{rule.pattern} at {rule.priority}" for rule in rules)


def rules_of(text: str) -> tuple[ThreadRule, ...]:
    """Read what `rules_text` wrote. Raises ValueError."""
    parts = (part.rpartition(" at ") for part in text.split(", ") if text)
    return tuple(ThreadRule(pattern=pattern, priority=int(priority)) for pattern, _, priority in parts)


class _Given(NamedTuple):
    """The rule whose values a thread has, and the values before."""

    rule: ThreadRule
    policy: int
    priority: int
    processors: frozenset[int]


class ThreadPriorities:
    """The threads that have a priority by rules, look after look.

    Several may look after the same threads. With the same rules they set the same values; of different rules those that
    came last count.
    """

    def __init__(self, rules: Sequence[ThreadRule]) -> None:
        self._given: dict[tuple[int, str], _Given] = {}  # by id and start time
        self._started: dict[tuple[int, int], str] = {}  # by id and inode: to read a name is faster than a start time
        self._names: set[str] = set()
        self.change(rules)

    def change(self, rules: Sequence[ThreadRule]) -> None:
        """Replace the rules; the next look gives threads their values."""
        self._rules = rules
        self._matched: set[str] = set()
        self._refused = ""

    def look(self, processes: Iterable[int]) -> None:
        """Give each thread of these processes the values of its rule, and others back what they had.

        A new thread has the name of the one that made it, until it takes another.
        """
        there, started = set(), self._started
        self._started = {}
        for thread, name in _threads(processes):
            self._started[thread] = start = started.get(thread) or _start_of(thread[0])
            known = thread[0], start
            there.add(known)
            if len(self._names) < SHOWN_NAMES:
                self._names.add(name)
            rule = next((rule for rule in self._rules if fnmatchcase(name, rule.pattern)), None)
            if rule is not None:
                self._matched.add(rule.pattern)
                with self._noted(name):
                    self._give(known, rule)
            elif known in self._given:
                with self._noted(name):
                    self._give_back(known)
        for gone in self._given.keys() - there:  # it has ended, or its process has left
            with self._noted(f"thread {gone[0]}"):
                self._give_back(gone)

    def give_back(self) -> None:
        """Give all threads back what they had."""
        self.change(())
        self.look(())

    def seen(self) -> dict[str, Any]:
        """Return what was seen so far: names without a thread, names of threads, and what the kernel refused."""
        unmatched = [rule.pattern for rule in self._rules if rule.pattern not in self._matched]
        return {"unmatched": unmatched, "names": sorted(self._names), "refused": self._refused}

    @contextmanager
    def _noted(self, name: str) -> Iterator[None]:
        """Note the first refusal of the kernel; a thread may have ended."""
        try:
            yield
        except ProcessLookupError:
            pass
        except OSError as problem:
            self._refused = self._refused or f"{name}: {problem.strerror or problem}"

    def _give(self, thread: tuple[int, str], rule: ThreadRule) -> None:
        if sys.platform != "linux":
            return
        number, given = thread[0], self._given.get(thread)
        policy, wanted = os.sched_getscheduler(number), os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        priority = os.sched_getparam(number).sched_priority
        if policy == wanted and given is not None and (given.rule == rule or priority == rule.priority):
            self._given[thread] = given._replace(rule=rule)  # it has another value from others with newer rules
            return
        processors = frozenset(os.sched_getaffinity(number))
        if (policy, priority) == (wanted, rule.priority):  # from others, or from a process that was killed
            self._given[thread] = _Given(rule, os.SCHED_OTHER, 0, processors)
            return
        if rule.affinity:
            allowed = {at for at in range(rule.affinity.bit_length()) if rule.affinity >> at & 1}
            os.sched_setaffinity(number, allowed)
        os.sched_setscheduler(number, wanted, os.sched_param(rule.priority))
        usual = _Given(rule, policy, priority, processors) if given is None else given
        self._given[thread] = usual._replace(rule=rule)

    def _give_back(self, thread: tuple[int, str]) -> None:
        given = self._given.pop(thread)
        if sys.platform != "linux" or _start_of(thread[0]) != thread[1]:
            return
        os.sched_setscheduler(thread[0], given.policy, os.sched_param(given.priority))
        os.sched_setaffinity(thread[0], given.processors)


def members(groups: Iterable[str]) -> Iterator[int]:
    """Yield the ids of the processes in control groups and below them."""
    for group in groups:
        for folder, _, files in os.walk(group):
            if "cgroup.procs" in files:
                with suppress(OSError):
                    yield from map(int, _content(f"{folder}/cgroup.procs").split())


def _threads(processes: Iterable[int]) -> Iterator[tuple[tuple[int, int], str]]:
    """Yield the id and inode of each thread, and its name."""
    for process in processes:
        with suppress(OSError), os.scandir(f"/proc/{process}/task") as entries:
            for entry in entries:
                with suppress(OSError):
                    yield (int(entry.name), entry.inode()), _content(f"{entry.path}/comm").removesuffix("\n")


def _start_of(thread: int) -> str:
    """Return the start time of a thread; empty: it has ended."""
    with suppress(OSError, IndexError):
        return _content(f"/proc/{thread}/stat").rpartition(")")[2].split()[_STARTED]
    return ""


def _content(file: str) -> str:
    """Return a file of the kernel; each look reads one for each thread, and `Path` takes three times as long."""
    handle = os.open(file, os.O_RDONLY)
    try:
        pieces = []
        while piece := os.read(handle, 65_536):
            pieces.append(piece)
    finally:
        os.close(handle)
    return b"".join(pieces).decode("utf-8", "replace")
