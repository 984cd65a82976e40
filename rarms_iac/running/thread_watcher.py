"""Gives threads of services the priority of their task class: `python -I -m rarms_iac.running.thread_watcher FOLDER`.

In: the files `<slice>.threads` of a folder, in which rarms writes the rules of the partitions that run on this machine.
Out: threads in SCHED_FIFO, and lines for the system's log. It ends, and gives threads back what they had, when no file
is there, and on SIGTERM. The standard library only. `rarms install` has the system start it when there is a file.
"""

import json
import math
import os
import signal
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from rarms_iac.running.kernel_files import UnreadableFile, kernel_text, real_time_percent
from rarms_iac.running.thread_priorities import LOOK_EVERY_S, ThreadPriorities, members, rules_of

FILES = "*.threads"
READ_EVERY_S = 2.0
"""How often the files are looked at."""

UNMATCHED_S = 60.0
"""How long a partition may run threads before the log names the patterns without one."""

_ENDLESS = (
    "No thread gets a priority, because kernel.sched_rt_runtime_us does not limit real-time threads. Run: sysctl "
    "kernel.sched_rt_runtime_us=950000."
)

Rules = Mapping[str, str]
"""The rules of each control group, as `rules_text` writes them."""


@dataclass(slots=True)
class _Watched:
    """A control group with rules."""

    text: str
    priorities: ThreadPriorities
    since: float | None = None  # when threads were first seen under these rules
    has_told_refusal: bool = False


class ThreadWatcher:
    """The control groups whose threads have rules, look after look."""

    def __init__(self, folder: Path, tell: Callable[[str], None]) -> None:
        self._folder = folder
        self._tell = tell
        self._read: dict[Path, tuple[object, Rules]] = {}
        self._watched: dict[str, _Watched] = {}
        self._is_endless = False

    def read(self) -> bool:
        """Read the files that changed. Return whether there is one."""
        self._read = {path: self._rules_in(path) for path in sorted(self._folder.glob(FILES))}
        was_endless, self._is_endless = self._is_endless, real_time_is_endless()
        if self._is_endless and not was_endless:
            self._tell(_ENDLESS)
        all_rules = () if self._is_endless else (rules for _, rules in self._read.values())
        wanted = {group: text for rules in all_rules for group, text in rules.items()}
        for group in self._watched.keys() - wanted.keys():
            self._watched.pop(group).priorities.give_back()
            self._tell(f"{_name(group)}: threads have their usual priority again.")
        for group, text in wanted.items():
            known = self._watched.get(group)
            if known is None or known.text != text:
                self._tell(f"{_name(group)}: priorities of threads: {text}.")
                priorities = ThreadPriorities(()) if known is None else known.priorities
                priorities.change(rules_of(text))
                self._watched[group] = _Watched(text, priorities)
        return bool(self._read)

    def look(self) -> None:
        """Look once at the threads of all groups."""
        for group, watched in self._watched.items():
            watched.priorities.look(members([group]))
            self._report(group, watched)

    def end(self) -> None:
        """Give all threads back what they had."""
        for watched in self._watched.values():
            watched.priorities.give_back()
        self._watched = {}

    def _rules_in(self, path: Path) -> tuple[object, Rules]:
        """Return a file's state and rules; one that cannot be read has those of before."""
        before, rules = self._read.get(path, (None, {}))
        state: object = None
        try:
            status = path.stat()
            state = status.st_mtime_ns, status.st_ino, status.st_size
            if state == before:
                return before, rules
            found = json.loads(path.read_text(encoding="utf-8"))
            for text in found.values():
                rules_of(text)
        except (OSError, ValueError, AttributeError) as problem:
            state = state or str(problem)
            if state != before:
                self._tell(f"{path} cannot be read: {problem}. The earlier rules remain valid.")
            return state, rules
        return state, found

    def _report(self, group: str, watched: _Watched) -> None:
        """Report once what is wrong with the rules of a group."""
        seen, now = watched.priorities.seen(), time.monotonic()
        if seen["refused"] and not watched.has_told_refusal:
            watched.has_told_refusal = True
            self._tell(f"{_name(group)}: the kernel refuses a priority: {seen['refused']}.")
        if watched.since is None and seen["names"]:
            watched.since = now
        if watched.since is not None and now > watched.since + UNMATCHED_S:
            watched.since = math.inf
            names = ", ".join(seen["names"])
            for pattern in seen["unmatched"]:
                self._tell(f"{_name(group)}: no thread has the name {pattern}. Its threads: {names}.")


def real_time_is_endless() -> bool:
    """Return whether real-time threads may use all of each processor."""
    with suppress(UnreadableFile):
        return real_time_percent(kernel_text) == 100
    return False


def _name(group: str) -> str:
    return Path(group).name


def _tell(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def main(folder: Path) -> None:
    """Look until nothing is to be watched, until another version of rarms is installed, or until SIGTERM."""
    if sys.platform != "linux":
        return
    ends = {signal.SIGTERM, signal.SIGINT}
    signal.pthread_sigmask(signal.SIG_BLOCK, ends)
    with suppress(OSError):  # partitions that are busy would delay it
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(1))
    programs = Path(sys.executable).parent
    installed, watcher, due = programs.resolve(), ThreadWatcher(folder, _tell), 0.0
    try:
        while True:
            if (now := time.monotonic()) >= due:
                due = now + READ_EVERY_S
                if not watcher.read() or programs.resolve() != installed:
                    return
            watcher.look()
            if signal.sigtimedwait(ends, LOOK_EVERY_S) is not None:
                return
    finally:
        watcher.end()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
