"""Holds a running service or container to CR while it is measured, and gives back to it what it had.

What was there before is written to `attached.record` of the host before the first change. The file is removed last.
After a kill the next run that holds the host gives it back. Begin at `AttachedState.hold`.

Below systemd nothing is moved: the unit gets a quota and a weight at run time. Elsewhere its processes are moved to the
partition's group, children included.
"""

import errno
import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from rarms_iac.providers.cgroups.attach_target import AttachTarget
from rarms_iac.providers.cgroups.effects import LinuxEffects
from rarms_iac.providers.cgroups.groups import SLICE_PERIOD_US, GroupTree
from rarms_iac.providers.journaled import report_damage, report_failure
from rarms_iac.storage.codec import decode, encode
from rarms_iac.storage.json_text import parse_json

FILE = "attached.record"
HIGHEST_WEIGHT = 10_000
"""Of the unit while it is measured: what P2 leaves goes to it before other services of its slice."""
ROUNDS = 100
"""So often the processes of the partition's group are moved back: they may start others meanwhile."""

_PROPERTIES = ("CPUWeight", "CPUQuota", "CPUQuotaPeriodSec")
_FOLDERS = (Path("/run/systemd/system.control"), Path("/run/systemd/transient"))
"""Folders where systemd keeps the values of `set-property --runtime`: of units with a file, and of transient ones."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AttachedRecord:
    """What a service or container had before it was measured."""

    component: str
    title: str
    boot: str  # id of the machine's start: with another one, the kernel has forgotten all of it
    unit: str = ""  # of systemd; empty: processes are moved
    values: Mapping[str, str] = field(default_factory=dict)  # by property of the unit
    drop_ins: Mapping[str, str] = field(default_factory=dict)  # content by path, of those that were there
    group: str = ""  # of the partition, to which processes are moved
    homes: Mapping[str, Mapping[str, str]] = field(default_factory=dict)  # by folder of that group: group by process id
    format: Literal["rarms-attached/1"] = "rarms-attached/1"


class AttachedState:
    """The record of one slice, and how it is carried out."""

    def __init__(self, host: str, folder: Path, effects: LinuxEffects) -> None:
        self._host = host
        self._path = folder / FILE
        self._effects = effects

    def record(self) -> AttachedRecord | None:
        """Return what is held now, or was left by a killed run; None: nothing.

        Raises:
            HostDamaged: the record cannot be read.
        """
        with report_damage(self._host, self._path):
            data = self._effects.content(self._path)
            return None if data is None else decode(AttachedRecord, parse_json(data.decode("utf-8", "replace")))

    def hold(self, target: AttachTarget, tree: GroupTree, group: str, percent: float, boot: str) -> str:
        """Hold a target to a part of the host; what it had is recorded first.

        Args:
            group: of P1.
            percent: CR, of one logical processor.
            boot: id of the machine's latest start.

        Returns:
            The group that holds it, as `GroupTree` takes it: that of the unit, or of P1.

        Raises:
            OSError: systemd or the kernel refuses.
        """
        record = AttachedRecord(component=target.component, title=target.title, boot=boot)
        if target.unit:
            self._save(self._with_values(replace(record, unit=target.unit), target.group))
            quota = (f"CPUQuota={percent:.2f}%", f"CPUQuotaPeriodSec={SLICE_PERIOD_US}us")
            self._set(target.unit, f"CPUWeight={HIGHEST_WEIGHT}", *quota)
            return str(target.group)
        processes = tree.members_below(target.group)
        homes = _homes(tree, group, processes)
        if not all(homes.values()):
            raise ProcessLookupError(errno.ESRCH, f"{target.title} no longer has a process")
        self._save(replace(record, group=group, homes=homes))
        tree.write(group, replace(tree.read(group), quota_percent=percent, period_us=SLICE_PERIOD_US))
        for _ in range(ROUNDS):
            if not (there := tree.members_below(target.group)):
                break
            for process in there:
                for folder in tree.folders_of(group):
                    self._move(process, folder)
        else:
            raise TimeoutError(errno.ETIMEDOUT, f"{target.title} starts processes faster than they can be moved")
        return group

    def restore(self, tree: GroupTree, boot: str) -> AttachedRecord | None:
        """Give back what was there before, where something is held; return what that was.

        Raises:
            OSError: systemd or the kernel refuses; the record stays.
            HostDamaged: the record cannot be read.
        """
        record = self.record()
        if record is None:
            return None
        if record.boot == boot:
            if record.unit:
                self._give_back_values(record)
            else:
                self._move_back(record, tree)
        with report_failure(self._host, self._path):
            self._effects.delete(self._path)
        return record

    def _save(self, record: AttachedRecord) -> None:
        with report_failure(self._host, self._path):
            self._effects.replace(self._path, (json.dumps(encode(record), indent=1) + "\n").encode("ascii"))

    def _with_values(self, record: AttachedRecord, group: Path) -> AttachedRecord:
        """Read the unit's own values: where it says nothing, the kernel's default counts again afterwards."""
        shown = self._effects.output("systemctl", "show", "--property=CPUWeight,CPUQuotaPerSecUSec", record.unit)
        said = dict(line.partition("=")[::2] for line in shown.splitlines())
        weight = said.get("CPUWeight", "")
        quota, period = "", ""
        with suppress(OSError):  # the controller is off, so nothing limits it
            limit, _, period_us = self._effects.read(group / "cpu.max").partition(" ")
            if said.get("CPUQuotaPerSecUSec") != "infinity" and limit != "max":
                quota, period = f"{100 * int(limit) / int(period_us):.2f}%", f"{period_us}us"
        values = {"CPUWeight": weight if weight.isdecimal() and int(weight) <= HIGHEST_WEIGHT else ""}
        values |= {"CPUQuota": quota, "CPUQuotaPeriodSec": period}
        paths = [path for path in _drop_ins(record.unit) if self._effects.has_file(path)]
        files = {str(path): (self._effects.content(path) or b"").decode("utf-8", "replace") for path in paths}
        return replace(record, values=values, drop_ins=files)

    def _give_back_values(self, record: AttachedRecord) -> None:
        active = self._effects.output("systemctl", "show", "--property=ActiveState", "--value", record.unit)
        if active in {"active", "activating", "reloading"}:
            self._set(record.unit, *(f"{name}={value}" for name, value in record.values.items()))
        for path in _drop_ins(record.unit):
            content = record.drop_ins.get(str(path))
            if content is not None:
                self._effects.replace(path, content.encode("utf-8"))
            elif self._effects.has_file(path):
                self._effects.delete(path)
                self._effects.remove_empty(path.parent)
        self._effects.run("systemctl", "daemon-reload")

    def _move_back(self, record: AttachedRecord, tree: GroupTree) -> None:
        """Move the processes in the partition's group to where they, or those that started them, were."""
        for _ in range(ROUNDS):
            left = [(Path(folder), homes) for folder, homes in record.homes.items()]
            there = [(process, folder, homes) for folder, homes in left for process in tree.members_below(folder)]
            if not there:
                return
            for process, folder, homes in there:
                home = Path(homes.get(str(process)) or next(iter(homes.values()), ""))
                root = folder.parent.parent  # of the hierarchy: the home may be gone
                self._move(process, home if home.name and self._effects.has_folder(home) else root)
        raise TimeoutError(errno.ETIMEDOUT, f"processes of {record.title} cannot be moved out of {record.group}")

    def _move(self, process: int, group: Path) -> None:
        with suppress(ProcessLookupError):  # it has ended
            self._effects.write(group / "cgroup.procs", str(process))

    def _set(self, unit: str, *properties: str) -> None:
        self._effects.run("systemctl", "set-property", "--runtime", unit, *properties)


def _drop_ins(unit: str) -> list[Path]:
    return [folder / f"{unit}.d" / f"50-{name}.conf" for folder in _FOLDERS for name in _PROPERTIES]


def _homes(tree: GroupTree, group: str, processes: tuple[int, ...]) -> dict[str, dict[str, str]]:
    """Return the group of each process, by the partition's folder in each hierarchy."""
    found: dict[str, dict[str, str]] = {str(folder): {} for folder in tree.folders_of(group)}
    for process in processes:
        for folder, home in tree.homes_of(process, group).items():
            found[str(folder)][str(process)] = str(home)
    return found
