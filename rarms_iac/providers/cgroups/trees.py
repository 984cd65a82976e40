"""Control groups of version 1, of version 2, and of systemd: what each setting is in the kernel's files.

Where systemd is process 1, each group is a slice unit, made, changed and removed by `systemctl` alone. Its properties
lie in files of systemd, and the unit may start with the machine: so a restart keeps partitions. What the kernel holds
is read from its own files, as everywhere. Begin at `find_tree`.
"""

import errno
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from rarms_iac.providers.cgroups.effects import LinuxEffects, below_first
from rarms_iac.providers.cgroups.groups import USUAL_PERIOD_US, GroupTree, GroupValues, whole_pages
from rarms_iac.running.kernel_files import UnreadableFile, entry_of, number_or_max, processor_list, whole_number
from rarms_iac.running.orders import ProcessPlace

CONTROLLERS_V2 = ("cpuset", "memory", "cpu")
_MOST_SHARES_V1, MOST_WEIGHT_V2 = 262_144, 10_000
_NO_MEMORY_LIMIT_V1 = 2**62  # the kernel shows its largest page count for none


class GroupTreeV1(GroupTree):
    """Version 1: a hierarchy for each controller."""

    version = "v1"
    _memory_events = "memory.oom_control"

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

    def used_memory(self, name: str) -> int | None:
        return self._memory_in(name, "total_rss", "total_shmem")

    def usable_processors(self) -> int:
        folder = self._slices["cpuset"]
        there = folder if self._effects.has_folder(folder) else folder.parent
        return len(self._processors_in(there / "cpuset.cpus"))

    def _write_quota(self, name: str, percent: float | None, period_us: int) -> None:
        self._write("cpu", name, "cpu.cfs_quota_us", "-1")  # the old quota may be more than the new period allows
        if percent is not None:
            self._write("cpu", name, "cpu.cfs_period_us", str(period_us))
            self._write("cpu", name, "cpu.cfs_quota_us", str(self._quota_us(percent, period_us)))

    def remove(self, name: str) -> None:
        """Remove the group, and what container engines made of its name in hierarchies that rarms does not use."""
        super().remove(name)
        slice_folder = self._slices["cpu"]
        root = slice_folder.parents[1]
        for hierarchy in self._effects.folders(root):
            folder = root / hierarchy / slice_folder.name
            if folder not in self._folders:
                for group in below_first(self._effects, folder / name):
                    self._effects.remove_empty(group)
                self._effects.remove_empty(folder)

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

    version = "v2"
    _memory_events = "memory.events"

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

    def used_memory(self, name: str) -> int | None:
        return self._memory_in(name, "anon", "shmem")

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
        """Do nothing: in version 2 a group without processors of its own has those of the slice."""


def _shares(values: GroupValues) -> int:
    return min(max(2, round(values.shares_percent * 10)), _MOST_SHARES_V1)


def weight_v2(values: GroupValues) -> int:
    """Return the weight of version 2 for these values."""
    return min(max(1, round(values.shares_percent)), MOST_WEIGHT_V2)


def _list(values: GroupValues) -> str:
    return ",".join(str(number) for number in values.processors or ())


UNITS = Path("/etc/systemd/system")
BOOT = "systemd"
"""Stands for the machine's start in definitions: systemd keeps groups over all of them."""

_UNIT = b"""\
[Unit]
Description=Partition of rarms

[Slice]
CPUAccounting=yes
MemoryAccounting=yes
"""
_TARGET = "multi-user.target"
"""What the machine starts."""

_NOT_IN_A_UNIT = re.compile(r"[^a-zA-Z0-9_.]")


def slice_unit(slice_name: str) -> str:
    """Return the name of the unit that holds all partitions.

    Args:
        slice_name: as the manifest has it; a dash in it would make the unit a part of another one.
    """
    return f"{_NOT_IN_A_UNIT.sub('_', slice_name)}.slice"


class GroupTreeSystemd(GroupTreeV2):
    """Slice units below one slice unit."""

    def __init__(self, effects: LinuxEffects, slices: Mapping[str, Path]) -> None:
        """Take the name of the unit for the slice's folder."""
        super().__init__(effects, slices)
        self._slice = slices["cpu"].name

    @property
    def boot(self) -> str:
        return BOOT

    def name_for(self, partition: str) -> str:
        readable = _NOT_IN_A_UNIT.sub("_", json.dumps(partition)[1:-1])
        return f"{self._slice.removesuffix('.slice')}-{readable}.slice"

    def make(self, name: str) -> None:
        self._write_unit(name)
        self._systemctl("start", name)
        self._await(name, "cgroup.procs", "*")
        self._prepare_slice()

    def start_with_machine(self, name: str, starts: bool) -> None:
        self._write_unit(name)  # the group may have been made without one
        words = ("add-wants", _TARGET) if starts else ("disable",)
        self._systemctl(*words, "--no-reload", "--quiet", name)

    def write(self, name: str, values: GroupValues) -> None:
        self._refuse_used_memory(name, values.memory)
        memory, shown = values.memory, whole_pages(values.memory)
        processors = " ".join(map(str, values.processors or ()))
        quota = _quota(values.quota_percent, values.period_us)
        weight = weight_v2(values)
        limit = f"MemoryMax={'infinity' if memory is None else memory}"
        self._set(name, f"CPUWeight={weight}", *quota, limit, f"AllowedCPUs={processors}")
        self._await(name, "cpu.weight", str(weight))
        self._await(name, "memory.max", "max" if shown is None else str(shown))
        self._await_quota(name, values.quota_percent, values.period_us)

    def _quota_us(self, percent: float, period_us: int) -> int:
        """Round down, as systemd does."""
        return int(percent * period_us) // 100

    def remove(self, name: str) -> None:
        self._effects.end_processes(self._groups(name))
        self._forget(name)
        self._effects.await_removal(self._slices["cpu"] / name)
        if not self.names():
            self._forget(self._slice)

    def place(self, name: str) -> ProcessPlace:
        """Return words that have systemd make a scope for each process: a slice holds none itself."""
        words = ("systemd-run", "--scope", "--quiet", "--collect", f"--slice={name}", "--")
        return replace(self._counted(name), words=words)

    def parent_of_containers(self, name: str) -> str:
        return name

    def _prepare_slice(self) -> None:
        self._set(self._slice, f"CPUWeight={MOST_WEIGHT_V2}")

    def _write_quota(self, name: str, percent: float | None, period_us: int) -> None:
        self._set(name or self._slice, *_quota(percent, period_us))
        self._await_quota(name, percent, period_us)

    def _await_quota(self, name: str, percent: float | None, period_us: int) -> None:
        shown = "max *" if percent is None else f"{self._quota_us(percent, period_us)} {period_us}"
        self._await(name, "cpu.max", shown)

    def _await(self, name: str, file: str, pattern: str) -> None:
        """Wait until the kernel has the value that systemd was given: systemd answers before."""
        self._effects.await_text(self._file("cpu", name, file), pattern)

    def _write_unit(self, name: str) -> None:
        if not self._effects.has_file(UNITS / name):
            self._effects.replace(UNITS / name, _UNIT)

    def _forget(self, unit: str) -> None:
        """Stop a slice, with its properties and what starts it with the machine; its unit need not be there."""
        self._effects.run("systemctl", "stop", unit, may_fail=True)  # it may not run
        if self._effects.has_file(UNITS / unit):
            self._systemctl("disable", "--no-reload", "--quiet", unit)
            self._effects.delete(UNITS / unit)
        self._systemctl("revert", unit)  # this reads all units again

    def _set(self, unit: str, *properties: str) -> None:
        self._systemctl("set-property", unit, *properties)

    def _systemctl(self, *words: str) -> None:
        self._effects.run("systemctl", *words)


def _quota(percent: float | None, period_us: int) -> Iterator[str]:
    yield "CPUQuota=" if percent is None else f"CPUQuota={percent:.2f}%"
    yield f"CPUQuotaPeriodSec={period_us}us"


CONTROL_GROUPS = Path("/sys/fs/cgroup")
SYSTEMD_FOLDER = "run/systemd/system"
"""Below `/`: it is there where systemd is process 1 (sd_booted(3))."""

_CONTROLLERS_V1 = ("cpuset", "memory", "cpuacct", "cpu")  # cpu last: `GroupTree.names` looks there
_NO_QUOTAS = "quotas of processor time (CONFIG_CFS_BANDWIDTH)"


@dataclass(frozen=True, slots=True, kw_only=True)
class MissingFeatures:
    """The parts of the kernel, and the rights, that control groups need and that are not here."""

    names: tuple[str, ...]


def find_tree(
    slice_name: str, version: str = "automatic", effects: LinuxEffects | None = None, root: Path = CONTROL_GROUPS
) -> GroupTree | MissingFeatures:
    """Choose the version that a machine has, version 2 where it has both.

    Args:
        slice_name: the group below which those of rarms lie.
        effects: of the machine; None: this one.
        root: where control groups are mounted: `sys/fs/cgroup` below the folder that is `/`.

    Returns:
        The groups below the slice, which need not be there yet; or what is missing (where both versions lack
        something: of version 1 where the machine has any of it).
    """
    effects = effects or LinuxEffects()
    unified = next(
        (path for path in (root, root / "unified") if _controllers(effects, path) >= set(CONTROLLERS_V2)), root
    )
    systemd_runs = effects.has_folder(root.parents[2] / SYSTEMD_FOLDER)
    missing = {"v1": tuple(_missing_v1(effects, root)), "v2": tuple(_missing_v2(effects, unified))}
    if version == "automatic":  # in version 1 systemd keeps no sets of processors
        has_v1 = any(effects.has_file(root / name / "cgroup.procs") for name in _CONTROLLERS_V1)
        version = "v2" if systemd_runs or not missing["v2"] or not has_v1 else "v1"
    if missing[version]:
        return MissingFeatures(names=missing[version])
    if version == "v1":
        return GroupTreeV1(effects, {name: root / name / slice_name for name in _CONTROLLERS_V1})
    if systemd_runs:
        return GroupTreeSystemd(effects, dict.fromkeys((*CONTROLLERS_V2, "cpuacct"), unified / slice_unit(slice_name)))
    return GroupTreeV2(effects, dict.fromkeys((*CONTROLLERS_V2, "cpuacct"), unified / slice_name))


def _missing_v1(effects: LinuxEffects, root: Path) -> Iterator[str]:
    for name in _CONTROLLERS_V1:
        if not effects.has_file(root / name / "cgroup.procs"):
            yield f"the controller {name} of version 1 at {(root / name).as_posix()}"
        elif not effects.is_writable(root / name):
            yield f"the right to create groups in {(root / name).as_posix()}"
    if effects.has_file(root / "cpu" / "cpu.shares") and not effects.has_file(root / "cpu" / "cpu.cfs_quota_us"):
        yield _NO_QUOTAS


def _missing_v2(effects: LinuxEffects, root: Path) -> Iterator[str]:
    offered, shown = _controllers(effects, root), root.as_posix()
    if not offered:
        yield f"version 2 of control groups at {shown} (kernel parameter systemd.unified_cgroup_hierarchy=1)"
        return
    for name in CONTROLLERS_V2:
        if name not in offered:
            yield f"the controller {name} of version 2 at {shown} (kernel parameter cgroup_enable={name})"
    if not effects.is_writable(root):
        yield f"the right to create groups in {shown}"
    groups = [root / name for name in effects.folders(root)]  # the root itself has neither file
    if any(effects.has_file(group / "cpu.weight") and not effects.has_file(group / "cpu.max") for group in groups):
        yield _NO_QUOTAS


def _controllers(effects: LinuxEffects, root: Path) -> frozenset[str]:
    try:
        return frozenset(effects.read(root / "cgroup.controllers").split())
    except OSError:
        return frozenset()
