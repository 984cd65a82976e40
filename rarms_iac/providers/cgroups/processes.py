"""The processes of this machine as `/proc` shows them: what they consumed, and whether a supervisor ends them."""

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from rarms_iac.providers.cgroups.effects import kernel_text

_PROC = Path("/proc")
_SUPERVISOR = "supervisor_process.py"


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessStat:
    """The values of `/proc/<id>/stat` that rarms uses."""

    name: str
    parent: int
    ticks: int  # of processor time that it consumed itself
    ticks_of_children: int  # that those of its children that ended had consumed


def read_process(process: int, read: Callable[[Path], str] = kernel_text) -> ProcessStat | None:
    """Read a process; None where it is gone.

    Args:
        process: its id.
        read: returns a file of `/proc` on its machine.
    """
    before, _, after = read(_PROC / f"{process}/stat").rpartition(")")
    fields = after.split()
    if len(fields) < 15:
        return None
    user, system, user_of_children, system_of_children = map(int, fields[11:15])
    return ProcessStat(
        name=before.partition("(")[2],
        parent=int(fields[1]),
        ticks=user + system,
        ticks_of_children=user_of_children + system_of_children,
    )


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
        if _SUPERVISOR in read(_PROC / f"{process}/cmdline"):
            return True
        stat = read_process(process, read)
        process = stat.parent if stat else 0
    return False


def _children(process: int) -> list[int]:
    threads = Path(f"/proc/{process}/task")
    try:
        return [int(child) for thread in threads.iterdir() for child in kernel_text(thread / "children").split()]
    except OSError:
        return []


def in_ms(ticks: float | str) -> float:
    """Return a time in ticks of the kernel's clock as milliseconds.

    Args:
        ticks: as a file of the kernel has it.
    """
    return float(ticks) * 1000 / os.sysconf("SC_CLK_TCK")
