"""Finds the processes that `rarms run --exec` became, by a variable in their environment.

In: a process of this machine. Out: its value, while the process that has it still runs. Begin at `started_by_exec`.
"""

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rarms_iac.running.kernel_files import PROC, kernel_text, read_process

VARIABLE = "RARMS_RUN_EXEC"
"""The variable of such a process and of those below it: the id and the begin of that process, and its component."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExecProcess:
    """A process that became a component, and still runs."""

    process: int
    component: str  # as `APPLICATION/COMPONENT`


def own_variable(component: str) -> dict[str, str]:
    """Return the variable of this process, which is about to become a component; empty: not on this system.

    Args:
        component: As `ExecProcess.component`.
    """
    started = read_process(os.getpid()) if sys.platform == "linux" else None
    return {} if started is None else {VARIABLE: f"{os.getpid()}:{started.began}:{component}"}


def started_by_exec(process: int, read: Callable[[Path], str] = kernel_text) -> ExecProcess | None:
    """Return the process of `rarms run --exec` that a process is, or began below; None: there is none that still runs.

    Raises:
        UnreadableFile: A `stat` is not as the kernel writes it.
    """
    variables = read(PROC / f"{process}/environ").split("\0")
    value = next((each.removeprefix(f"{VARIABLE}=") for each in variables if each.startswith(f"{VARIABLE}=")), "")
    itself, _, rest = value.partition(":")
    began, _, component = rest.partition(":")
    stat = read_process(int(itself), read) if itself.isdecimal() else None
    return ExecProcess(process=int(itself), component=component) if stat and str(stat.began) == began else None


def find_exec_process(component: str) -> int | None:
    """Return the id of the process of this machine that became a component; None: there is none.

    Args:
        component: As `ExecProcess.component`.

    Raises:
        UnreadableFile: As of `started_by_exec`.
    """
    if sys.platform != "linux":
        return None
    found = (started_by_exec(int(entry.name)) for entry in PROC.iterdir() if entry.name.isdecimal())
    return next((each.process for each in found if each and each.component == component), None)
