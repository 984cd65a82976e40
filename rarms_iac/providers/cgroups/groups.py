"""Control groups as the kernel shows them: what both versions have in common.

Every group of rarms lies below one slice, which weighs more than everything beside it. All paths are parameters: a
test works below a slice of its own. Where a call says `OSError`, the kernel's own answer is passed on.
"""

import mmap
import os
import signal
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from rarms_iac.providers.cgroups import kernel
from rarms_iac.running.start import ProcessPlace

USUAL_PERIOD_US = 100_000
"""The kernel's own period of a quota."""

SLICE_PERIOD_US = 20_000
"""The period of the slice's limit: with 5 % kept for the host, partitions wait 1 ms in every 20 ms."""

_REAL_TIME = 90
"""The most, in per cent of each processor, that real-time processes of a group get (version 1); the kernel gives
those of all groups together 95 %."""

_RUNTIME = "cpu.rt_runtime_us"

_WAIT_SECONDS = 10.0
"""How long `remove` waits for killed processes to end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupValues:
    """The values of a control group, in per cent of one logical processor, microseconds and bytes."""

    shares_percent: float  # its weight against those of the other groups; a reserve of so many per cent
    quota_percent: float | None = None  # None: no limit
    period_us: int = USUAL_PERIOD_US
    processors: tuple[int, ...] | None = None  # it runs on these only; None: on all
    memory: int | None = None  # None: no limit


class GroupEffects(Protocol):
    """What changes the groups below one slice: the calls of these names of `GroupTree`, which say more."""

    def make(self, name: str) -> None:
        """See `GroupTree.make`."""
        ...

    def write(self, name: str, values: GroupValues) -> None:
        """See `GroupTree.write`."""
        ...

    def start_with_machine(self, name: str, starts: bool) -> None:
        """See `GroupTree.start_with_machine`."""
        ...

    def limit_slice(self, percent: int | None) -> None:
        """See `GroupTree.limit_slice`."""
        ...

    def ask_to_end(self, name: str, grace_ms: int) -> None:
        """See `GroupTree.ask_to_end`."""
        ...

    def remove(self, name: str) -> None:
        """See `GroupTree.remove`."""
        ...


class GroupTree(ABC):
    """The groups below one slice."""

    page_bytes = mmap.PAGESIZE
    """In whole pages of so many bytes the machine's kernel counts memory."""

    def __init__(self, slices: Mapping[str, Path]) -> None:
        self._slices = slices  # controller -> the slice's folder in its hierarchy; in version 2 all are the same
        self._folders = tuple(dict.fromkeys(slices.values()))

    @property
    @abstractmethod
    def version(self) -> str:
        """Return v1 or v2."""

    @abstractmethod
    def write(self, name: str, values: GroupValues) -> None:
        """Give a group all of these values, one file after the other. Raises OSError."""

    @abstractmethod
    def read(self, name: str) -> GroupValues:
        """Read the values as they are in the kernel now. Raises FileNotFoundError where the group is not there."""

    @abstractmethod
    def as_kernel_shows(self, values: GroupValues) -> GroupValues:
        """Return what `read` answers once these values are written: the kernel rounds, and has its bounds."""

    @abstractmethod
    def cpu_ms(self, name: str) -> float:
        """Return the processor time, in ms, that the group consumed since it was made. Raises OSError."""

    @abstractmethod
    def throttled_ms(self, name: str) -> float:
        """Return the time, in ms, that its quota kept the group waiting. Raises OSError."""

    @abstractmethod
    def usable_processors(self) -> int:
        """Return how many of the machine's processors groups may use at all. Raises OSError."""

    @abstractmethod
    def _write_quota(self, name: str, percent: float | None, period_us: int) -> None:
        """Limit a group, or the slice where the name is empty; None: no limit."""

    @abstractmethod
    def _prepare_slice(self) -> None:
        """Make the slice with the highest weight, and what groups below it need."""

    @abstractmethod
    def _prepare_group(self, name: str) -> None:
        """Give a fresh group what it needs before a process may join."""

    @property
    def boot(self) -> str:
        """What stands for the machine's start in definitions, where groups outlive it; empty: they do not."""
        return ""

    def name_for(self, partition: str) -> str:
        """Return what a partition's group is called, unless that name is taken."""
        return partition

    def ask_to_end(self, name: str, grace_ms: int) -> None:
        """Ask the processes in the group to end (SIGTERM), and wait until they did or the grace is over.

        Args:
            name: of the group, which need not be there.
            grace_ms: how long they may take; with 0 no process is asked.
        """
        until = time.monotonic() + grace_ms / 1000
        if grace_ms:
            _signal(self.processes(name), signal.SIGTERM)
        while time.monotonic() < until and self.processes(name):
            time.sleep(kernel.LOOK_SECONDS)

    def names(self) -> tuple[str, ...]:
        """Return the names of the groups below the slice, sorted."""
        slice_folder = self._slices["cpu"]
        if not slice_folder.is_dir():
            return ()
        return tuple(sorted(entry.name for entry in slice_folder.iterdir() if entry.is_dir()))

    def make(self, name: str) -> None:
        """Make a group with the kernel's own values, and the slice above it; what is there stays. Raises OSError."""
        self._prepare_slice()
        for folder in self._folders:
            kernel.make_folder(folder / name)
        self._prepare_group(name)

    def start_with_machine(self, name: str, starts: bool) -> None:  # noqa: B027 - it is the whole of it
        """Have systemd start a group with the machine, or not; without systemd nothing does.

        Args:
            name: of the group, which is there.
            starts: whether it is to.

        Raises:
            OSError: systemd refuses.
        """

    def limit_slice(self, percent: int | None) -> None:
        """Let all groups together have no more than this, where the slice is there: the rest is for what is beside it.

        A group whose own quota is larger gets the smaller one first: version 1 refuses the slice's otherwise.

        Args:
            percent: of one logical processor; None: no limit.

        Raises:
            OSError: the kernel refuses.
        """
        if not self._slices["cpu"].is_dir():
            return
        for name in self.names():
            with suppress(FileNotFoundError):  # the group was removed meanwhile
                values = self.read(name)
                if percent is not None and values.quota_percent is not None and values.quota_percent > percent:
                    self.write(name, replace(values, quota_percent=percent))
        self._write_quota("", percent, SLICE_PERIOD_US)

    def remove(self, name: str) -> None:
        """End every process in the group at once and remove it, and the slice where it is empty then.

        Raises:
            TimeoutError: its processes do not end, or something keeps the group.
            OSError: it may not be removed.
        """
        self._end_processes(name)
        until = time.monotonic() + _WAIT_SECONDS
        for folder in reversed(self._folders):
            for group in kernel.inner_first(folder / name):
                kernel.remove_folder(group, until)
            with suppress(OSError):  # another group is in it, or it is gone
                folder.rmdir()

    def _end_processes(self, name: str) -> None:
        until = time.monotonic() + _WAIT_SECONDS
        while running := self.processes(name):
            _signal(running, signal.SIGKILL)
            kernel.wait(until, f"{name}: {len(running)} processes do not end")

    def place(self, name: str) -> ProcessPlace:
        """Return what brings a starting process into the group: the files that take its id, or words before its own."""
        return ProcessPlace(join=tuple(folder / name / "cgroup.procs" for folder in self._folders))

    def allow_real_time(self, name: str, percent: float) -> None:
        """Let real-time processes of a group run for a part of each processor's time, where the kernel asks for it.

        A kernel with budgets (version 1) starts none in a group without one, and gives all groups of the machine 95 %
        together. A budget is counted in pieces of 100 ms.

        Args:
            name: of the group.
            percent: of each processor; its processes get no more, also where nobody else wants it.

        Raises:
            OSError: other groups have budgets that leave too little.
        """
        folder = self._slices["cpu"]
        if not (folder / name / _RUNTIME).is_file():
            return
        others = sum(_budget_us(folder / group) for group in self.names() if group != name)
        wanted = round(min(percent, _REAL_TIME) * USUAL_PERIOD_US / 100)
        for group, budget in ((folder, others + max(wanted, _budget_us(folder / name))), (folder / name, wanted)):
            kernel.write(group / "cpu.rt_period_us", str(USUAL_PERIOD_US))
            kernel.write(group / _RUNTIME, str(budget))

    def processes(self, name: str) -> tuple[int, ...]:
        """Return the ids of the processes in the group and below it, ascending; none where the group is not there."""
        found: set[int] = set()
        for folder in self._folders:
            for group in kernel.inner_first(folder / name):
                with suppress(FileNotFoundError):
                    found.update(int(word) for word in kernel.read(group / "cgroup.procs").split())
        return tuple(sorted(found))

    def _whole_pages(self, memory: int | None) -> int | None:
        return None if memory is None else memory - memory % self.page_bytes

    def _file(self, controller: str, name: str, file: str) -> Path:
        return self._slices[controller] / name / file


def _signal(processes: tuple[int, ...], number: signal.Signals) -> None:
    for process in processes:
        with suppress(ProcessLookupError):
            os.kill(process, number)


def _budget_us(group: Path) -> int:
    """Return the real-time budget of a group in 100 ms, in microseconds."""
    return int(kernel.read(group / _RUNTIME)) * USUAL_PERIOD_US // int(kernel.read(group / "cpu.rt_period_us"))
