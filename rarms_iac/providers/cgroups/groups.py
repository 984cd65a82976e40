"""Control groups as the kernel shows them: version 1 and version 2 behind one class.

Every group of rarms lies below one slice, which weighs more than everything beside it. All paths are parameters: a
test works below a slice of its own. Where a call says `OSError`, the kernel's own answer is passed on.
"""

import errno
import mmap
import os
import signal
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from rarms_iac.running.start import ProcessPlace

CONTROL_GROUPS = Path("/sys/fs/cgroup")
USUAL_PERIOD_US = 100_000
"""The kernel's own period of a quota."""

_CONTROLLERS_V1 = ("cpuset", "memory", "cpuacct", "cpu")  # cpu last: with it a group is there
_CONTROLLERS_V2 = ("cpuset", "memory", "cpu")
_MOST_SHARES_V1, _MOST_WEIGHT_V2 = 262_144, 10_000
_NO_MEMORY_LIMIT_V1 = 2**62  # the kernel shows its largest page count for none
_REAL_TIME = 90
"""The most, in per cent of each processor, that real-time processes of a group get (version 1); all together get 95."""

_RUNTIME = "cpu.rt_runtime_us"

_WAIT_SECONDS, _LOOK_SECONDS = 10.0, 0.005
_PAGE = mmap.PAGESIZE


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupValues:
    """The values of a control group, in per cent of one logical processor, microseconds and bytes."""

    shares_percent: float  # counted against the shares of the other groups
    quota_percent: float | None = None  # None: no limit
    period_us: int = USUAL_PERIOD_US
    processors: tuple[int, ...] | None = None  # it runs on these only; None: on all
    memory: int | None = None  # None: no limit


@dataclass(frozen=True, slots=True, kw_only=True)
class MissingFeatures:
    """The parts of the kernel, and the rights, that control groups need and that are not here."""

    names: tuple[str, ...]


class GroupTree(ABC):
    """The groups below one slice."""

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
    def shown(self, values: GroupValues) -> GroupValues:
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
    def _prepare_slice(self) -> None:
        """Make the slice with the highest weight, and what groups below it need."""

    @abstractmethod
    def _prepare_group(self, name: str) -> None:
        """Give a fresh group what it needs before a process may join."""

    def ask_to_end(self, name: str, grace_ms: int) -> None:
        """Ask the processes in the group to end (SIGTERM), and wait until they did or the grace is over.

        Args:
            name: of the group, which need not be there.
            grace_ms: how long they may take; with 0 nobody is asked.
        """
        until = time.monotonic() + grace_ms / 1000
        if grace_ms:
            _signal(self.processes(name), signal.SIGTERM)
        while time.monotonic() < until and self.processes(name):
            time.sleep(_LOOK_SECONDS)

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
            _make_folder(folder / name)
        self._prepare_group(name)

    def remove(self, name: str) -> None:
        """End every process in the group at once and remove it, and the slice where it is empty then.

        Raises:
            TimeoutError: its processes do not end, or something keeps the group.
            OSError: it may not be removed.
        """
        until = time.monotonic() + _WAIT_SECONDS
        while running := self.processes(name):
            _signal(running, signal.SIGKILL)
            _wait(until, f"{name}: {len(running)} processes do not end")
        for folder in reversed(self._folders):
            for group in _inner_first(folder / name):
                _remove_folder(group, until)
            with suppress(OSError):  # another group is in it, or it is gone
                folder.rmdir()

    def place(self, name: str) -> ProcessPlace:
        """Return what brings a starting process into the group: the files that take its id."""
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
            _write(group / "cpu.rt_period_us", str(USUAL_PERIOD_US))
            _write(group / _RUNTIME, str(budget))

    def processes(self, name: str) -> tuple[int, ...]:
        """Return the ids of the processes in the group and below it, ascending; none where the group is not there."""
        found: set[int] = set()
        for folder in self._folders:
            for group in _inner_first(folder / name):
                with suppress(FileNotFoundError):
                    found.update(int(word) for word in _read(group / "cgroup.procs").split())
        return tuple(sorted(found))

    def _file(self, controller: str, name: str, file: str) -> Path:
        return self._slices[controller] / name / file


class GroupTreeV1(GroupTree):
    """Version 1: a hierarchy for each controller."""

    @property
    def version(self) -> str:
        """See `GroupTree.version`."""
        return "v1"

    def write(self, name: str, values: GroupValues) -> None:
        """See `GroupTree.write`."""
        _write(self._file("cpu", name, "cpu.shares"), str(_shares(values)))
        quota = self._file("cpu", name, "cpu.cfs_quota_us")
        if values.quota_percent is None:
            _write(quota, "-1")
        else:
            _write(quota, "-1")  # the old quota may be more than the new period allows
            _write(self._file("cpu", name, "cpu.cfs_period_us"), str(values.period_us))
            _write(quota, str(round(values.quota_percent * values.period_us / 100)))
        processors = self._file("cpuset", name, "cpuset.cpus")
        _write(processors, _read(self._slices["cpuset"] / "cpuset.cpus") if not values.processors else _list(values))
        limit = -1 if values.memory is None else values.memory
        _write(self._file("memory", name, "memory.limit_in_bytes"), str(limit))

    def read(self, name: str) -> GroupValues:
        """See `GroupTree.read`."""
        quota = int(_read(self._file("cpu", name, "cpu.cfs_quota_us")))
        period = int(_read(self._file("cpu", name, "cpu.cfs_period_us")))
        all_processors = _read_if_there(self._slices["cpuset"] / "cpuset.cpus")
        # Who makes a group by hand may leave out a controller, or the processors of its set.
        memory = int(_read_if_there(self._file("memory", name, "memory.limit_in_bytes")) or _NO_MEMORY_LIMIT_V1)
        processors = _read_if_there(self._file("cpuset", name, "cpuset.cpus"))
        return GroupValues(
            shares_percent=int(_read(self._file("cpu", name, "cpu.shares"))) / 10,
            quota_percent=None if quota < 0 else quota * 100 / period,
            period_us=USUAL_PERIOD_US if quota < 0 else period,
            processors=None if processors in {"", all_processors} else _numbers(processors),
            memory=None if memory >= _NO_MEMORY_LIMIT_V1 else memory,
        )

    def shown(self, values: GroupValues) -> GroupValues:
        """See `GroupTree.shown`."""
        return replace(
            values,
            shares_percent=_shares(values) / 10,
            quota_percent=_rounded_quota(values),
            period_us=USUAL_PERIOD_US if values.quota_percent is None else values.period_us,
            memory=_whole_pages(values.memory),
        )

    def cpu_ms(self, name: str) -> float:
        """See `GroupTree.cpu_ms`."""
        return int(_read(self._file("cpuacct", name, "cpuacct.usage"))) / 1e6

    def throttled_ms(self, name: str) -> float:
        """See `GroupTree.throttled_ms`."""
        return _entry(self._file("cpu", name, "cpu.stat"), "throttled_time") / 1e6

    def usable_processors(self) -> int:
        """See `GroupTree.usable_processors`."""
        folder = self._slices["cpuset"]
        return len(_numbers(_read((folder if folder.is_dir() else folder.parent) / "cpuset.cpus")))

    def _prepare_slice(self) -> None:
        for folder in self._folders:
            _make_folder(folder)
        _fill_cpuset(self._slices["cpuset"])
        _write(self._slices["cpu"] / "cpu.shares", str(_MOST_SHARES_V1))

    def _prepare_group(self, name: str) -> None:
        _fill_cpuset(self._slices["cpuset"] / name)


class GroupTreeV2(GroupTree):
    """Version 2: one hierarchy."""

    @property
    def version(self) -> str:
        """See `GroupTree.version`."""
        return "v2"

    def write(self, name: str, values: GroupValues) -> None:
        """See `GroupTree.write`."""
        if values.memory is not None and (used := self._unreclaimable(name)) > values.memory:
            raise OSError(errno.EBUSY, f"its processes use {used} bytes")  # the kernel would end some of them
        _write(self._file("cpu", name, "cpu.weight"), str(_weight(values)))
        percent, period = values.quota_percent, values.period_us
        quota = "max" if percent is None else str(round(percent * period / 100))
        _write(self._file("cpu", name, "cpu.max"), f"{quota} {period}")
        _write(self._file("cpuset", name, "cpuset.cpus"), _list(values) if values.processors else "\n")
        _write(self._file("memory", name, "memory.max"), "max" if values.memory is None else str(values.memory))

    def read(self, name: str) -> GroupValues:
        """See `GroupTree.read`."""
        quota, period = _read(self._file("cpu", name, "cpu.max")).split()
        memory = _read(self._file("memory", name, "memory.max"))
        processors = _read(self._file("cpuset", name, "cpuset.cpus"))
        return GroupValues(
            shares_percent=float(_read(self._file("cpu", name, "cpu.weight"))),
            quota_percent=None if quota == "max" else int(quota) * 100 / int(period),
            period_us=USUAL_PERIOD_US if quota == "max" else int(period),
            processors=_numbers(processors) or None,
            memory=None if memory == "max" else int(memory),
        )

    def shown(self, values: GroupValues) -> GroupValues:
        """See `GroupTree.shown`."""
        return replace(
            values,
            shares_percent=float(_weight(values)),
            quota_percent=_rounded_quota(values),
            period_us=USUAL_PERIOD_US if values.quota_percent is None else values.period_us,
            memory=_whole_pages(values.memory),
        )

    def _unreclaimable(self, name: str) -> int:
        return _entry(self._file("memory", name, "memory.stat"), "anon")

    def cpu_ms(self, name: str) -> float:
        """See `GroupTree.cpu_ms`."""
        return _entry(self._file("cpu", name, "cpu.stat"), "usage_usec") / 1e3

    def throttled_ms(self, name: str) -> float:
        """See `GroupTree.throttled_ms`."""
        return _entry(self._file("cpu", name, "cpu.stat"), "throttled_usec") / 1e3

    def usable_processors(self) -> int:
        """See `GroupTree.usable_processors`."""
        folder = self._slices["cpu"]
        return len(_numbers(_read((folder if folder.is_dir() else folder.parent) / "cpuset.cpus.effective")))

    def _prepare_slice(self) -> None:
        folder = self._slices["cpu"]
        for parent in (folder.parent, folder):
            _make_folder(parent)
            _write(parent / "cgroup.subtree_control", " ".join(f"+{name}" for name in _CONTROLLERS_V2))
        _write(folder / "cpu.weight", str(_MOST_WEIGHT_V2))

    def _prepare_group(self, name: str) -> None:
        """Nothing: in version 2 a group without processors of its own has those of the slice."""


def find_tree(slice_name: str, version: str = "automatic", root: Path = CONTROL_GROUPS) -> GroupTree | MissingFeatures:
    """Choose the version that this machine has, version 2 where it has both.

    Args:
        slice_name: of the group below which ours lie.
        version: automatic, v1 or v2.
        root: where control groups are mounted.

    Returns:
        The groups below the slice, which need not be there yet; or what is missing, of version 1 where it is that of
        both.
    """
    unified = next((path for path in (root, root / "unified") if _controllers(path) >= set(_CONTROLLERS_V2)), root)
    missing_v2 = tuple(_missing_v2(unified))
    if version == "v2" or (version == "automatic" and not missing_v2):
        slices = dict.fromkeys((*_CONTROLLERS_V2, "cpuacct"), unified / slice_name)
        return MissingFeatures(names=missing_v2) if missing_v2 else GroupTreeV2(slices)
    if missing_v1 := tuple(_missing_v1(root)):
        return MissingFeatures(names=missing_v1)
    return GroupTreeV1({name: (root / name).resolve() / slice_name for name in _CONTROLLERS_V1})


def _missing_v1(root: Path) -> Iterator[str]:
    for name in _CONTROLLERS_V1:
        if not (root / name / "cgroup.procs").is_file():
            yield f"the controller {name} of version 1 at {root / name}"
        elif not os.access(root / name, os.W_OK):
            yield f"the right to make groups in {root / name}"
    if (root / "cpu" / "cpu.shares").is_file() and not (root / "cpu" / "cpu.cfs_quota_us").is_file():
        yield "quotas of processor time (CONFIG_CFS_BANDWIDTH)"


def _missing_v2(root: Path) -> Iterator[str]:
    offered = _controllers(root)
    for name in _CONTROLLERS_V2:
        if name not in offered:
            yield f"the controller {name} of version 2 in {root / 'cgroup.controllers'}"
    if offered and not os.access(root, os.W_OK):
        yield f"the right to make groups in {root}"


def _controllers(root: Path) -> frozenset[str]:
    try:
        return frozenset(_read(root / "cgroup.controllers").split())
    except OSError:
        return frozenset()


def _signal(processes: tuple[int, ...], number: signal.Signals) -> None:
    for process in processes:
        with suppress(ProcessLookupError):
            os.kill(process, number)


def _shares(values: GroupValues) -> int:
    return min(max(2, round(values.shares_percent * 10)), _MOST_SHARES_V1)


def _weight(values: GroupValues) -> int:
    return min(max(1, round(values.shares_percent)), _MOST_WEIGHT_V2)


def _whole_pages(memory: int | None) -> int | None:
    return None if memory is None else memory - memory % _PAGE


def _rounded_quota(values: GroupValues) -> float | None:
    if values.quota_percent is None:
        return None
    return round(values.quota_percent * values.period_us / 100) * 100 / values.period_us


def _fill_cpuset(group: Path) -> None:
    """Give a group of version 1 its parent's processors and memory nodes, without which no process may join."""
    for file in ("cpuset.cpus", "cpuset.mems"):
        if not _read(group / file):
            _write(group / file, _read(group.parent / file))


def _inner_first(group: Path) -> Iterator[Path]:
    """The folders of a group and of those below it, the innermost first; nothing where it is not there."""
    with suppress(FileNotFoundError):
        for entry in sorted(group.iterdir()):
            if entry.is_dir():
                yield from _inner_first(entry)
        yield group


def _make_folder(folder: Path) -> None:
    folder.mkdir(exist_ok=True)


def _remove_folder(group: Path, until: float) -> None:
    while True:
        try:
            group.rmdir()
        except FileNotFoundError:
            return
        except OSError:  # a process that was just ended may hold it for a moment
            _wait(until, f"{group} cannot be removed")
        else:
            return


def _wait(until: float, message: str) -> None:
    if time.monotonic() > until:
        raise TimeoutError(message)
    time.sleep(_LOOK_SECONDS)


def _budget_us(group: Path) -> int:
    """The real-time budget in a piece of 100 ms."""
    return int(_read(group / _RUNTIME)) * USUAL_PERIOD_US // int(_read(group / "cpu.rt_period_us"))


def _list(values: GroupValues) -> str:
    return ",".join(str(number) for number in values.processors or ())


def _numbers(text: str) -> tuple[int, ...]:
    """Read the kernel's form of a set of processors: `0-2,5`."""
    spans = [part.partition("-") for part in text.split(",") if part]
    return tuple(number for first, _, last in spans for number in range(int(first), int(last or first) + 1))


def _entry(file: Path, name: str) -> int:
    return next((int(value) for word, value in (line.split() for line in _read(file).splitlines()) if word == name), 0)


def _read(file: Path) -> str:
    return file.read_text(encoding="ascii").strip()


def _read_if_there(file: Path) -> str:
    return _read(file) if file.exists() else ""


def _write(file: Path, text: str) -> None:
    """Write a file of the kernel in one call: it takes or refuses the whole value, and is never replaced."""
    handle = os.open(file, os.O_WRONLY)
    try:
        os.write(handle, text.encode("ascii"))
    finally:
        os.close(handle)
