"""Control groups of version 1 and of version 2: what each setting is in the kernel's files."""

import errno
from pathlib import Path

from rarms_iac.providers.cgroups.groups import USUAL_PERIOD_US, GroupTree, GroupValues
from rarms_iac.running.kernel_files import UnreadableFile, entry_of, number_or_max, processor_list, whole_number

CONTROLLERS_V2 = ("cpuset", "memory", "cpu")
_MOST_SHARES_V1, MOST_WEIGHT_V2 = 262_144, 10_000
_NO_MEMORY_LIMIT_V1 = 2**62  # the kernel shows its largest page count for none


class GroupTreeV1(GroupTree):
    """Version 1: a hierarchy for each controller."""

    _memory_events = "memory.oom_control"

    @property
    def version(self) -> str:
        return "v1"

    def write(self, name: str, values: GroupValues) -> None:
        self._write("cpu", name, "cpu.shares", str(_shares(values)))
        self._write_quota(name, values.quota_percent, values.period_us)
        self._write("cpuset", name, "cpuset.cpus", _list(values) or self._read("cpuset", "", "cpuset.cpus"))
        limit = -1 if values.memory is None else values.memory
        self._write("memory", name, "memory.limit_in_bytes", str(limit))

    def read(self, name: str) -> GroupValues:
        quota = self._number_in(self._file("cpu", name, "cpu.cfs_quota_us"), least=-1)
        period = self._number_in(self._file("cpu", name, "cpu.cfs_period_us"), least=1)
        all_processors = self._read_if_there(self._slices["cpuset"] / "cpuset.cpus")
        # Who makes a group by hand may leave out a controller, or the processors of its set.
        limit, cpuset = self._file("memory", name, "memory.limit_in_bytes"), self._file("cpuset", name, "cpuset.cpus")
        memory = whole_number(limit, self._read_if_there(limit) or str(_NO_MEMORY_LIMIT_V1))
        processors = self._read_if_there(cpuset)
        return GroupValues(
            shares_percent=self._number_in(self._file("cpu", name, "cpu.shares")) / 10,
            quota_percent=None if quota < 0 else quota * 100 / period,
            period_us=USUAL_PERIOD_US if quota < 0 else period,
            processors=None if processors in {"", all_processors} else processor_list(cpuset, processors),
            memory=None if memory >= _NO_MEMORY_LIMIT_V1 else memory,
        )

    def _shown_shares(self, values: GroupValues) -> float:
        return _shares(values) / 10

    def cpu_ms(self, name: str) -> float:
        return self._number_in(self._file("cpuacct", name, "cpuacct.usage")) / 1e6

    def throttled_ms(self, name: str) -> float:
        return self._entry_in("cpu", name, "cpu.stat", "throttled_time") / 1e6

    def usable_processors(self) -> int:
        folder = self._slices["cpuset"]
        there = folder if self._effects.has_folder(folder) else folder.parent
        return len(self._processors_in(there / "cpuset.cpus"))

    def _write_quota(self, name: str, percent: float | None, period_us: int) -> None:
        self._write("cpu", name, "cpu.cfs_quota_us", "-1")  # the old quota may be more than the new period allows
        if percent is not None:
            self._write("cpu", name, "cpu.cfs_period_us", str(period_us))
            self._write("cpu", name, "cpu.cfs_quota_us", str(self._quota_us(percent, period_us)))

    def _prepare_slice(self) -> None:
        for folder in self._folders:
            self._effects.make(folder)
        self._fill_cpuset(self._slices["cpuset"])
        self._effects.write(self._slices["cpu"] / "cpu.shares", str(_MOST_SHARES_V1))

    def _prepare_group(self, name: str) -> None:
        self._fill_cpuset(self._slices["cpuset"] / name)

    def _fill_cpuset(self, group: Path) -> None:
        """Give a group its parent's processors and memory nodes, without which no process may join."""
        for file in ("cpuset.cpus", "cpuset.mems"):
            if not self._read_if_there(group / file):
                self._effects.write(group / file, self._effects.read(group.parent / file))


class GroupTreeV2(GroupTree):
    """Version 2: one hierarchy."""

    _memory_events = "memory.events"

    @property
    def version(self) -> str:
        return "v2"

    def write(self, name: str, values: GroupValues) -> None:
        self._refuse_used_memory(name, values.memory)
        self._write("cpu", name, "cpu.weight", str(weight_v2(values)))
        self._write_quota(name, values.quota_percent, values.period_us)
        self._write("cpuset", name, "cpuset.cpus", _list(values) or "\n")
        self._write("memory", name, "memory.max", "max" if values.memory is None else str(values.memory))

    def read(self, name: str) -> GroupValues:
        quota_us, period_us = self._quota_in(self._file("cpu", name, "cpu.max"))
        memory = self._file("memory", name, "memory.max")
        return GroupValues(
            shares_percent=float(self._number_in(self._file("cpu", name, "cpu.weight"))),
            quota_percent=None if quota_us is None else quota_us * 100 / period_us,
            period_us=USUAL_PERIOD_US if quota_us is None else period_us,
            processors=self._processors_in(self._file("cpuset", name, "cpuset.cpus")) or None,
            memory=number_or_max(memory, self._effects.read(memory)),
        )

    def _quota_in(self, file: Path) -> tuple[int | None, int]:
        """Return the quota (None: no limit) and the period of `cpu.max`, in microseconds."""
        words = (text := self._effects.read(file)).split()
        if len(words) != 2:
            raise UnreadableFile(file, text, "a quota and a period")
        return number_or_max(file, words[0]), whole_number(file, words[1], least=1)

    def _shown_shares(self, values: GroupValues) -> float:
        return float(weight_v2(values))

    def _refuse_used_memory(self, name: str, memory: int | None) -> None:
        file = self._file("memory", name, "memory.stat")
        used = entry_of(file, self._read_if_there(file), "anon")
        if memory is not None and used > memory:
            raise OSError(errno.EBUSY, f"its processes use {used} bytes")  # the kernel would end some of them

    def cpu_ms(self, name: str) -> float:
        return self._entry_in("cpu", name, "cpu.stat", "usage_usec") / 1e3

    def throttled_ms(self, name: str) -> float:
        return self._entry_in("cpu", name, "cpu.stat", "throttled_usec") / 1e3

    def usable_processors(self) -> int:
        folder = self._slices["cpu"]
        files = (group / "cpuset.cpus.effective" for group in (folder, folder.parent))
        return len(next(filter(None, map(self._processors_in, files)), ()))

    def _write_quota(self, name: str, percent: float | None, period_us: int) -> None:
        quota = "max" if percent is None else str(self._quota_us(percent, period_us))
        self._write("cpu", name, "cpu.max", f"{quota} {period_us}")

    def _prepare_slice(self) -> None:
        folder = self._slices["cpu"]
        for parent in (folder.parent, folder):
            self._effects.make(parent)
            self._effects.write(parent / "cgroup.subtree_control", " ".join(f"+{name}" for name in CONTROLLERS_V2))
        self._effects.write(folder / "cpu.weight", str(MOST_WEIGHT_V2))

    def _prepare_group(self, name: str) -> None:
        """Nothing: in version 2 a group without processors of its own has those of the slice."""


def _shares(values: GroupValues) -> int:
    return min(max(2, round(values.shares_percent * 10)), _MOST_SHARES_V1)


def weight_v2(values: GroupValues) -> int:
    """Return the weight of version 2 for these values."""
    return min(max(1, round(values.shares_percent)), MOST_WEIGHT_V2)


def _list(values: GroupValues) -> str:
    return ",".join(str(number) for number in values.processors or ())
