"""Reads files of the Linux kernel (`/proc`, `/sys`, control groups) and the numbers in them.

In: a path, or a file's text. Out: text, whole numbers, processes. Begin at `whole_number`: a text that is not a number
raises `UnreadableFile`, which a host reports with the file and its content.
"""

import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

PROC = Path("/proc")
MOST_PROCESSORS = 8192
"""The most that a kernel can be built for (CONFIG_NR_CPUS of x86)."""
_RUNTIME, _PERIOD = (PROC / f"sys/kernel/sched_rt_{name}_us" for name in ("runtime", "period"))
_NUMBER = re.compile(r"-?[0-9]{1,20}")
_SHOWN = 60
_STAT_FIELDS = 20
"""So many fields of `/proc/<id>/stat` after the name are used; the last is the start time (proc_pid_stat(5))."""


class UnreadableFile(ValueError):
    """A file of the kernel has another content than this reader knows."""

    def __init__(self, file: Path, content: str, wanted: str) -> None:
        self.file = file
        self.content = content if len(content) <= _SHOWN else f"{content[:_SHOWN]}..."
        self.wanted = wanted
        super().__init__(f"{file.as_posix()} has {self.content!a}, not {wanted}")


def kernel_text(file: Path) -> str:
    """Return a file of the kernel; empty where the process has ended, or this kernel has no such file."""
    try:
        return file.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def whole_number(file: Path, text: str, *, least: int = 0) -> int:
    """Return the whole number in a text of a file.

    Args:
        text: The file's content, or a part of it.
        least: A smaller number is not a value of this file.

    Raises:
        UnreadableFile: It is something else, or has more than 20 digits.
    """
    word = text.strip()
    if not _NUMBER.fullmatch(word) or int(word) < least:
        raise UnreadableFile(file, text, "a whole number" + (f" of at least {least}" if least > 0 else ""))
    return int(word)


def number_or_max(file: Path, text: str) -> int | None:
    """Return the whole number in a text of a file; None: the text is `max`, which means no limit.

    Raises:
        UnreadableFile: It is neither.
    """
    return None if text.strip() == "max" else whole_number(file, text)


def real_time_percent(text_of: Callable[[Path], str]) -> int:
    """Return the part of each processor that real-time threads may have; 100: the kernel never stops one.

    Args:
        text_of: Reads a file; empty: there is none. A kernel without these files admits nothing.

    Raises:
        UnreadableFile: One of the files has another content.
    """
    runtime, period = (whole_number(file, text_of(file) or "0", least=-1) for file in (_RUNTIME, _PERIOD))
    return 100 if runtime < 0 else min(100, runtime * 100 // period) if period > 0 else 0


def entry_of(file: Path, text: str, name: str) -> int:
    """Return the number after a name in lines of `name number`; 0 where the name is missing.

    Raises:
        UnreadableFile: The text after the name is not a number.
    """
    for line in text.splitlines():
        word, _, value = line.partition(" ")
        if word == name:
            return whole_number(file, value)
    return 0


def processor_list(file: Path, text: str) -> tuple[int, ...]:
    """Return the processors that the kernel lists as `0-2,5`, ascending.

    Raises:
        UnreadableFile: The text is not such a list.
    """
    found: set[int] = set()
    for part in filter(None, text.strip().split(",")):
        first, dash, last = part.partition("-")
        begin = whole_number(file, first)
        end = whole_number(file, last) if dash else begin
        if not begin <= end < MOST_PROCESSORS:
            raise UnreadableFile(file, text, "a list of processors")
        found.update(range(begin, end + 1))
    return tuple(sorted(found))


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessStat:
    """The values of `/proc/<id>/stat` that rarms uses."""

    name: str
    parent: int
    ticks: int  # processor time of its own
    ticks_of_children: int  # processor time of its children that ended
    began: int  # in ticks since the machine's start; with the id it identifies a process


def read_process(process: int, read: Callable[[Path], str] = kernel_text) -> ProcessStat | None:
    """Read a process; None where it has ended.

    Args:
        read: Returns a file of `/proc` on its machine.

    Raises:
        UnreadableFile: Its `stat` is not as the kernel writes it.
    """
    file = PROC / f"{process}/stat"
    before, _, after = (text := read(file)).rpartition(")")
    fields = after.split()
    if not text:
        return None
    if len(fields) < _STAT_FIELDS:
        raise UnreadableFile(file, text, f"a name and {_STAT_FIELDS} fields")
    parent, *times, began = (whole_number(file, fields[number]) for number in (1, 11, 12, 13, 14, 19))
    return ProcessStat(
        name=before.partition("(")[2],
        parent=parent,
        ticks=times[0] + times[1],
        ticks_of_children=times[2] + times[3],
        began=began,
    )


def children_of(process: int) -> list[int]:
    """Return the ids of the processes that a process started and that still run."""
    try:
        files = [thread / "children" for thread in (PROC / f"{process}/task").iterdir()]
    except OSError:
        return []
    return [whole_number(file, child) for file in files for child in kernel_text(file).split()]


def most_memory_below(process: int) -> int:
    """Return the bytes of memory that all processes below one had at most, each at its own time.

    Raises:
        UnreadableFile: A file is not as the kernel writes it.
    """
    most, below = 0, children_of(process)
    while below:
        file = PROC / f"{(child := below.pop())}/status"
        words = kernel_text(file).partition("\nVmHWM:")[2].split()
        most += 1024 * whole_number(file, words[0]) if words else 0  # of KiB
        below += children_of(child)
    return most


def in_ms(ticks: int) -> float:
    """Return a time in ticks of the kernel's clock as milliseconds."""
    return ticks * 1000 / os.sysconf("SC_CLK_TCK")
