"""Control groups where systemd is process 1: each is a slice unit, made, changed and removed by `systemctl` alone.

Its properties lie in files of systemd, and the unit may start with the machine: so a restart keeps partitions. What the
kernel holds is read from its own files, as everywhere.
"""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from rarms_iac.providers.cgroups.effects import LinuxEffects
from rarms_iac.providers.cgroups.groups import GroupValues, whole_pages
from rarms_iac.providers.cgroups.versions import MOST_WEIGHT_V2, GroupTreeV2, weight_v2
from rarms_iac.running.start import ProcessPlace

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
        """Systemd rounds down."""
        return int(percent * period_us) // 100

    def remove(self, name: str) -> None:
        self._effects.end_processes(self._groups(name))
        self._forget(name)
        self._effects.await_removal(self._slices["cpu"] / name)
        if not self.names():
            self._forget(self._slice)

    def place(self, name: str) -> ProcessPlace:
        """Return a slice holds no process itself, so systemd makes a scope for each."""
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
        """Wait until the kernel has what systemd was told: systemd answers before."""
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
        self._systemctl("revert", unit)  # this reads all units anew

    def _set(self, unit: str, *properties: str) -> None:
        self._systemctl("set-property", unit, *properties)

    def _systemctl(self, *words: str) -> None:
        self._effects.run("systemctl", *words)


def _quota(percent: float | None, period_us: int) -> Iterator[str]:
    yield "CPUQuota=" if percent is None else f"CPUQuota={percent:.2f}%"
    yield f"CPUQuotaPeriodSec={period_us}us"
