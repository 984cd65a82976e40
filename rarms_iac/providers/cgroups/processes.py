"""The processes of this machine as `/proc` shows them: what they consumed, and whether a supervisor ends them."""

from collections.abc import Callable, Iterable
from pathlib import Path

from rarms_iac.running.kernel_files import PROC, in_ms, kernel_text, read_process, whole_number

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
