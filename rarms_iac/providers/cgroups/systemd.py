"""Control groups where systemd is process 1: each is a slice unit, made, changed and removed by `systemctl` alone.

Its properties lie in files of systemd, and the unit may start with the machine: so a restart keeps partitions. What the
kernel holds is read from its own files, as everywhere.
"""

import errno
import json
import re
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from rarms_iac.providers.cgroups import kernel
from rarms_iac.providers.cgroups.groups import GroupValues
from rarms_iac.providers.cgroups.versions import MOST_WEIGHT_V2, GroupTreeV2, weight_v2
from rarms_iac.running.start import ProcessPlace
from rarms_iac.storage.replace import replace as replace_file

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
_WAIT_SECONDS = 10.0
_SYSTEMCTL_SECONDS = 120.0
"""More than systemd lets any unit take by itself (DefaultTimeoutStopSec)."""


def slice_unit(slice_name: str) -> str:
    """Return the name of the unit that holds all partitions.

    Args:
        slice_name: as the manifest has it; a dash in it would make the unit a part of another one.
    """
    return f"{_NOT_IN_A_UNIT.sub('_', slice_name)}.slice"


class GroupTreeSystemd(GroupTreeV2):
    """Slice units below one slice unit."""

    def __init__(self, slices: Mapping[str, Path]) -> None:
        """See `GroupTree`; the slice's folder has the name of its unit."""
        super().__init__(slices)
        self._slice = slices["cpu"].name

    @property
    def boot(self) -> str:
        """See `GroupTree.boot`."""
        return BOOT

    def name_for(self, partition: str) -> str:
        """See `GroupTree.name_for`. The text is that of JSON, as the shell script has it."""
        readable = _NOT_IN_A_UNIT.sub("_", json.dumps(partition)[1:-1])
        return f"{self._slice.removesuffix('.slice')}-{readable}.slice"

    def make(self, name: str) -> None:
        """See `GroupTree.make`."""
        _write_unit(name)
        _systemctl("start", name)
        self._prepare_slice()

    def start_with_machine(self, name: str, starts: bool) -> None:
        """See `GroupTree.start_with_machine`."""
        _write_unit(name)  # somebody else may have made the group without one
        words = ("add-wants", _TARGET) if starts else ("disable",)
        _systemctl(*words, "--no-reload", "--quiet", name)

    def write(self, name: str, values: GroupValues) -> None:
        """See `GroupTree.write`."""
        self._refuse_used_memory(name, values.memory)
        memory = "infinity" if values.memory is None else values.memory
        processors = " ".join(map(str, values.processors or ()))
        quota = _quota(values.quota_percent, values.period_us)
        _set(name, f"CPUWeight={weight_v2(values)}", *quota, f"MemoryMax={memory}", f"AllowedCPUs={processors}")
        wanted = self.as_kernel_shows(values)
        _wait_until(lambda: self.read(name) == wanted, f"{name} does not get what systemd was told: {values}")

    def as_kernel_shows(self, values: GroupValues) -> GroupValues:
        """See `GroupTree.as_kernel_shows`."""
        quota = _rounded_down(values.quota_percent, values.period_us)
        return replace(super().as_kernel_shows(values), quota_percent=quota)

    def remove(self, name: str) -> None:
        """See `GroupTree.remove`."""
        self._end_processes(name)
        _forget(name)
        folder = self._slices["cpu"]
        _wait_until(lambda: not (folder / name).is_dir(), f"{name} cannot be removed")
        if not self.names():
            _forget(self._slice)

    def place(self, name: str) -> ProcessPlace:
        """See `GroupTree.place`: systemd makes a scope for each process, as a slice holds none itself."""
        return ProcessPlace(words=("systemd-run", "--scope", "--quiet", "--collect", f"--slice={name}", "--"))

    def _prepare_slice(self) -> None:
        _set(self._slice, f"CPUWeight={MOST_WEIGHT_V2}")

    def _write_quota(self, name: str, percent: float | None, period_us: int) -> None:
        _set(name or self._slice, *_quota(percent, period_us))
        wanted = _rounded_down(percent, period_us)
        message = f"{name or self._slice} does not get the quota that systemd was told: {percent} %"
        _wait_until(lambda: self.read(name).quota_percent == wanted, message)


def _quota(percent: float | None, period_us: int) -> Iterator[str]:
    yield "CPUQuota=" if percent is None else f"CPUQuota={percent:.2f}%"
    yield f"CPUQuotaPeriodSec={period_us}us"


def _rounded_down(percent: float | None, period_us: int) -> float | None:
    """Return what systemd makes of a quota: whole microseconds in each period."""
    return None if percent is None else int(percent * period_us) // 100 * 100 / period_us


def _write_unit(name: str) -> None:
    if not (UNITS / name).is_file():
        replace_file(UNITS / name, _UNIT)


def _forget(unit: str) -> None:
    """Stop a slice, with its properties and what starts it with the machine; its unit need not be there."""
    with suppress(OSError):  # it does not run
        _systemctl("stop", unit)
    if (UNITS / unit).is_file():
        _systemctl("disable", "--no-reload", "--quiet", unit)
        (UNITS / unit).unlink()
    _systemctl("revert", unit)  # this reads all units anew


def _set(unit: str, *properties: str) -> None:
    _systemctl("set-property", unit, *properties)


def _wait_until(holds: Callable[[], bool], message: str) -> None:
    """Wait until the kernel has what systemd was told: systemd answers before."""
    until = time.monotonic() + _WAIT_SECONDS
    while True:
        with suppress(FileNotFoundError):  # the controller is not on yet
            if holds():
                return
        kernel.wait(until, message)


def _systemctl(*words: str) -> None:
    command = ["systemctl", *words]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", check=False, timeout=_SYSTEMCTL_SECONDS
        )
    except subprocess.TimeoutExpired as problem:
        raise TimeoutError(errno.ETIMEDOUT, str(problem)) from None
    if done.returncode:
        raise OSError(errno.EIO, f"systemctl {' '.join(words)}: {done.stderr.strip()}")
