"""The processes of a control group as `/proc` shows them: what they consumed, how many processors they use at once."""

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from threading import Event, Thread

from rarms_iac.model.processor_number import most_at_once
from rarms_iac.providers.cgroups.groups import GroupTree
from rarms_iac.running.kernel_files import PROC, UnreadableFile, in_ms, kernel_text, read_process, whole_number

_SUPERVISOR = "supervisor_process.py"


def consumed_ms(process: int) -> float:
    """Return the processor time, in ms, of all that a process started, in whole ticks of the kernel's clock.

    Args:
        process: its id; what it consumed itself does not count.
    """
    stat, below = read_process(process), _children(process)
    total = stat.ticks_of_children if stat else 0
    while below:
        child = below.pop()
        if (stat := read_process(child)) is not None:
            total += stat.ticks + stat.ticks_of_children
        below += _children(child)
    return in_ms(total)


def orphans(processes: Iterable[int], read: Callable[[Path], str] = kernel_text) -> tuple[tuple[int, str], ...]:
    """Return the processes that no supervisor of rarms started, with their names: none ends with its component.

    Args:
        processes: ids of the processes in a control group.
        read: as of `read_process`.

    Returns:
        Pairs of id and name, in the order of the ids given.
    """
    found = ((process, read_process(process, read)) for process in processes)
    return tuple((process, stat.name) for process, stat in found if stat and not _is_supervised(stat.parent, read))


def _is_supervised(process: int, read: Callable[[Path], str]) -> bool:
    while process > 1:
        if _SUPERVISOR in read(PROC / f"{process}/cmdline"):
            return True
        stat = read_process(process, read)
        process = stat.parent if stat else 0
    return False


def _children(process: int) -> list[int]:
    try:
        files = [thread / "children" for thread in (PROC / f"{process}/task").iterdir()]
    except OSError:
        return []
    return [whole_number(file, child) for file in files for child in kernel_text(file).split()]


BETWEEN_S = (0.005, 0.025)
"""The least and the greatest pause between two looks: at random, so that they lock into no period of a component."""


class ThreadLooks:
    """What was seen of a group's threads so far."""

    def __init__(self, tree: GroupTree, group: str) -> None:
        self._tree = tree
        self._group = group
        self._seconds: dict[int, float] = {}  # by number of threads that ran, or waited for a processor, at once
        self._ended = Event()
        self._problem: UnreadableFile | OSError | None = None

    def most(self, under_way_ms: float) -> int | None:
        """Return the most threads at once.

        Args:
            under_way_ms: how long a job was under way so far.

        Returns:
            None where the group was not looked at yet.

        Raises:
            UnreadableFile, OSError: the last look failed.
        """
        if self._problem is not None:
            raise self._problem
        seconds = dict(self._seconds)
        return most_at_once(seconds, under_way_ms / 1000) if seconds else None

    def forget(self) -> None:
        """Forget what was seen while processes started: jobs did not use it."""
        self._seconds = {}

    def look_until_ended(self) -> None:
        """Look again and again; each look stands for the time since the one before."""
        pauses, before = Random(), time.perf_counter()  # noqa: S311 - no secret
        while not self._ended.wait(pauses.uniform(*BETWEEN_S)):
            try:
                threads, now = sum(map(_runnable, self._tree.processes(self._group))), time.perf_counter()
            except (UnreadableFile, OSError) as problem:
                self._problem = problem
                return
            self._seconds[threads] = self._seconds.get(threads, 0.0) + now - before
            before = now

    def end(self) -> None:
        """Look no more."""
        self._ended.set()


@contextmanager
def looking_at(tree: GroupTree, group: str) -> Iterator[ThreadLooks]:
    """Look at a group's threads as long as the context lasts.

    Yields:
        What was seen so far; it stays when the context has ended.
    """
    looks = ThreadLooks(tree, group)
    thread = Thread(target=looks.look_until_ended, name=f"threads of {group}", daemon=True)
    thread.start()
    try:
        yield looks
    finally:
        looks.end()
        thread.join()


def _runnable(process: int) -> int:
    """How many threads of a process run or wait for a processor; none where it has ended."""
    try:
        return sum(_is_runnable(thread) for thread in (PROC / str(process) / "task").iterdir())
    except OSError:
        return 0


def _is_runnable(thread: Path) -> bool:
    """NOTE: the state follows the name, which may hold anything, also a bracket."""
    words = kernel_text(thread / "stat").rpartition(")")[2].split()
    return words[:1] == ["R"]
