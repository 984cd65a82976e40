"""Finds where the work of a setting ran: in the control groups of its components, or elsewhere on the machine.

In: the components that run, each below its supervisor, and two or more looks at `/proc`. Out: the processes outside of
these groups that used processor time. Begin at `WorkPlaces`. A program such as `docker run` or `systemd-run` starts the
work in another control group, and the component's reservation has no effect on it.
"""

import os
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock

from rarms_iac.model.setting import OutsideWork
from rarms_iac.running.kernel_files import PROC, ProcessStat, entry_of, in_ms, kernel_text, read_process, whole_number

LEAST_SHARE = 0.05
"""Part of the setting's time from which processes outside count, if a component's group used less."""

LISTED = 8
"""Largest number of entries of processes outside; the largest entries are kept."""

SHOWN_SHARE = 0.02
"""Entries with a smaller part of all work outside are not kept, unless they left their component's group."""

EXPECTED = frozenset({"rosmaster", "rosout", "roslaunch", "roscore", "rarms"})
"""Programs outside that never do a component's work: the ROS master with its nodes, and another rarms."""

_KERNEL_THREADS = 2
"""The process id of kthreadd, whose children are the kernel's own threads."""

_CLIENTS = frozenset({"systemd-run", "systemctl"})
"""Programs that start and end a service; the service itself is in the component's group, they are not."""

Look = Mapping[int, ProcessStat]
"""The processes of the machine at one moment, by id."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentPlace:
    """The place of a component's processes."""

    component: str
    supervisor: int | None  # its process id; None: not started yet
    groups: tuple[Path, ...]  # folders of control groups; none: the group that rarms is in
    has_own_group: bool = False  # a container or service has one, which its engine makes where it belongs


@dataclass(frozen=True, slots=True, kw_only=True)
class UsedTime:
    """The processor time of a process in a setting, in ticks."""

    own: int
    children: int  # of those that ended, without what was counted as their own


class WorkPlaces:
    """Looks at the machine's processes at the start and the end of a setting.

    A process that started before the first look, such as a daemon, counts with the time above its usual use. The usual
    use is its average from its start to the first look. So programs that always run do not make a finding.
    """

    def __init__(self, groups: Iterable[Path] = (), load_groups: Iterable[Path] = ()) -> None:
        """Take the first look, before the components start.

        Args:
            load_groups: Those of the interfering loads; what runs in them is not outside.

        Raises:
            UnreadableFile: A file of `/proc` has an unknown content.
        """
        self._load_groups = tuple(load_groups)
        self._before = self._last = look()
        self._looked_at = ticks_since_boot() if self._before else 0
        self._alive = frozenset(self._before)
        self._group_ms = {group: _group_ms(group) or 0.0 for group in groups}
        self._used_ms: dict[Path, float] = {}
        self._inside: frozenset[int] = frozenset()
        self._paths: dict[int, str] = {}
        self._lock = Lock()

    def look(self, places: Sequence[ComponentPlace]) -> None:
        """Look again; a process that has ended since the last look keeps its time of that look.

        Raises:
            UnreadableFile: A file of `/proc` or of a control group has an unknown content.
        """
        with self._lock:
            self._look(places)

    def _look(self, places: Sequence[ComponentPlace]) -> None:
        now = look()
        self._last, self._alive = {**self._last, **now}, frozenset(now)
        groups = {group for place in places for group in place.groups}
        ended = self._inside - now.keys()  # they were inside for as long as they were seen
        self._inside = ended.union(members((*groups, *self._load_groups)))
        for group in groups:
            if (used := _group_ms(group)) is not None:
                self._used_ms[group] = used - self._group_ms.get(group, 0.0)
        supervisors = {place.supervisor for place in places}
        for process, stat in now.items():
            before = self._before.get(process)
            if before != stat or stat.parent in supervisors:
                self._paths[process] = group_path(kernel_text(PROC / f"{process}/cgroup"))

    def outside(self, places: Sequence[ComponentPlace], elapsed_ms: float) -> tuple[OutsideWork, ...]:
        """Return the processes that worked outside of the components' groups, as far as they matter.

        Args:
            places: The components, as at the last look.
            elapsed_ms: How long the setting took.

        Returns:
            Largest first. Processes that a component started and that left its group are always there. All others
            are there if together they used more than the components of one group, and at least `LEAST_SHARE`.
        """
        used = used_ticks(self._before, self._last, self._alive)
        usual = usual_rates(self._before, self._looked_at)
        home = self._paths.get(os.getpid(), group_path(kernel_text(PROC / "self/cgroup")))
        sides = _Sides(last=self._last, places={place.supervisor: place for place in places if place.supervisor})
        escaped: list[OutsideWork] = []
        others: list[OutsideWork] = []
        inside: dict[str | Path, float] = dict.fromkeys(map(_unit, places), 0.0)
        for process, ticks in used.items():
            place, is_own = sides.of(process)
            ms = in_ms(ticks.own + ticks.children)
            work = OutsideWork(
                name=self._last[process].name, group=self._paths.get(process, ""), cpu_ms=ms, processes=1
            )
            if is_own:
                if place is not None:  # a supervisor: its children that ended were of the component
                    inside[_unit(place)] += in_ms(ticks.children)
            elif place is not None:
                is_at_home = place.has_own_group or work.group in {home, ""}
                if process in self._inside or (not place.groups and is_at_home):
                    inside[_unit(place)] += ms
                elif process in self._paths and not (place.has_own_group and work.name in _CLIENTS):
                    escaped.append(replace(work, component=place.component))
            elif process not in self._inside and work.name not in EXPECTED:
                above = ms - usual.get((process, self._last[process].began), 0.0) * elapsed_ms
                others += [replace(work, cpu_ms=above)] if above > 0 else []
        measured = {unit: self._used_ms.get(unit, ms) if isinstance(unit, Path) else ms for unit, ms in inside.items()}
        escaped += _ended_elsewhere(places, inside, measured, LEAST_SHARE * elapsed_ms)
        total = sum(work.cpu_ms for work in (*escaped, *others))
        matters = total >= LEAST_SHARE * elapsed_ms and total > min(measured.values(), default=0.0)
        return listed((*escaped, *(others if matters else ())))

    def others(self, elapsed_ms: float, counted_ms: float) -> tuple[OutsideWork, ...]:
        """Return all that used processors in none of the groups, largest first, rarms itself included.

        Args:
            elapsed_ms: How long the setting took.
            counted_ms: How long of it samples counted: the time of each process is its part of this time. Processes
                with less than `SHOWN_SHARE` are left out.
        """
        part = counted_ms / elapsed_ms
        used = used_ticks(self._before, self._last, self._alive)
        sides = _Sides(last=self._last, places={})
        found = []
        for process, ticks in used.items():
            if process not in self._inside and (ms := in_ms(ticks.own + ticks.children)) > 0:
                is_own = sides.of(process)[1]
                name, group = ("rarms", "") if is_own else (self._last[process].name, self._paths.get(process, ""))
                found.append(OutsideWork(name=name, group=group, cpu_ms=ms * part))
        return tuple(work for work in listed(found) if work.cpu_ms >= SHOWN_SHARE * counted_ms)


def look() -> Look:
    """Read all processes of this machine without the threads of the kernel; none on Windows and macOS.

    Raises:
        UnreadableFile: The `stat` of one is not as the kernel writes it.
    """
    if sys.platform != "linux":
        return {}
    ids = [int(entry.name) for entry in PROC.iterdir() if entry.name.isdecimal()]
    found = {process: stat for process in ids if (stat := read_process(process)) is not None}
    kernel = _KERNEL_THREADS if (first := found.get(_KERNEL_THREADS)) and first.name == "kthreadd" else -1
    return {process: stat for process, stat in found.items() if kernel not in {process, stat.parent}}


def ticks_since_boot() -> int:
    """Return the time since the machine's start, as `ProcessStat.began` has it."""
    return int(time.clock_gettime(time.CLOCK_BOOTTIME) * os.sysconf("SC_CLK_TCK")) if sys.platform == "linux" else 0


def usual_rates(before: Look, looked_at: int) -> Mapping[tuple[int, int], float]:
    """Return the processors that each process used on average from its start until a look.

    Args:
        looked_at: Its time in ticks since the machine's start.

    Returns:
        By id and start of the process.
    """
    return {
        (process, stat.began): (stat.ticks + stat.ticks_of_children) / max(1, looked_at - stat.began)
        for process, stat in before.items()
    }


def used_ticks(before: Look, last: Look, alive: frozenset[int]) -> Mapping[int, UsedTime]:
    """Compare two looks.

    Args:
        last: At its end; a process that ended meanwhile as it was seen last.
        alive: The processes that were there at the end.

    Returns:
        By process. If a process ended, its time since its last look is in `children` of its parent.
    """
    counted: dict[int, int] = {}  # by process that is there: what it has of children whose time is known
    for process, stat in last.items():
        if process not in alive:
            parent = stat.parent
            while parent in last and parent not in alive:
                parent = last[parent].parent
            counted[parent] = counted.get(parent, 0) + stat.ticks + stat.ticks_of_children
    found = {}
    for process, stat in last.items():
        known = before.get(process)
        own, children = stat.ticks, stat.ticks_of_children
        if known is not None and known.began == stat.began:
            own, children = own - known.ticks, children - known.ticks_of_children
        if process in alive:
            children -= counted.get(process, 0)
        found[process] = UsedTime(own=max(0, own), children=max(0, children))
    return found


def add_up(work: Iterable[OutsideWork]) -> list[OutsideWork]:
    """Return one entry for each name, group and component, the largest first."""
    sums: dict[tuple[str, str, str], OutsideWork] = {}
    for each in work:
        key = (each.name, each.group, each.component)
        known = sums.get(key)
        sums[key] = (
            each
            if known is None
            else replace(known, cpu_ms=known.cpu_ms + each.cpu_ms, processes=known.processes + each.processes)
        )
    return [each for _, each in sorted(sums.items(), key=lambda item: (-item[1].cpu_ms, item[0]))]


def listed(work: Iterable[OutsideWork]) -> tuple[OutsideWork, ...]:
    """Add up work, and return its largest `LISTED` entries."""
    entries = add_up(work)
    least = SHOWN_SHARE * sum(each.cpu_ms for each in entries)
    return tuple(each for each in entries if each.component or each.cpu_ms >= least)[:LISTED]


def group_path(text: str, controller: str = "cpuacct") -> str:
    """Return the group of the processor time in a `/proc/<id>/cgroup`: version 1's where it is used, else version 2's.

    Args:
        controller: of version 1, the hierarchy that is asked for.

    Returns:
        A path such as `/rarms/vision`; empty where the text has none.
    """
    paths: dict[str, str] = {}
    for line in text.splitlines():
        _, _, rest = line.partition(":")
        controllers, _, path = rest.partition(":")
        paths |= dict.fromkeys(controllers.split(","), path)
    return paths.get(controller) or paths.get("cpu") or paths.get("") or ""


def members(groups: Iterable[Path]) -> Iterator[int]:
    """Yield the ids of the processes in groups and below them; a group that is not there has none."""
    for group in groups:
        for folder, _, files in os.walk(group):
            if "cgroup.procs" in files:
                file = Path(folder) / "cgroup.procs"
                yield from (whole_number(file, word) for word in kernel_text(file).split())


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sides:
    last: Look
    places: Mapping[int, ComponentPlace]  # by supervisor

    def of(self, process: int) -> tuple[ComponentPlace | None, bool]:
        """Return the component that a process belongs to, and whether it is a process of rarms."""
        if process in self.places:
            return self.places[process], True
        above, steps = process, 0
        while above in self.last and steps < len(self.last):
            if above in self.places:
                return self.places[above], False
            if above == os.getpid():
                return None, True
            above, steps = self.last[above].parent, steps + 1
        return None, False


def _ended_elsewhere(
    places: Sequence[ComponentPlace],
    inside: Mapping[str | Path, float],
    measured: Mapping[str | Path, float],
    least_ms: float,
) -> Iterator[OutsideWork]:
    """Return the time of ended processes of a component that its group did not count."""
    for unit, components in _by_unit(places).items():
        missing = inside[unit] - measured[unit]
        if missing >= least_ms > 0:
            yield OutsideWork(name="", group="", cpu_ms=missing, processes=0, component=components[0])


def _by_unit(places: Sequence[ComponentPlace]) -> Mapping[str | Path, Sequence[str]]:
    found: dict[str | Path, list[str]] = {}
    for place in places:
        found.setdefault(_unit(place), []).append(place.component)
    return found


def _unit(place: ComponentPlace) -> str | Path:
    """Return the unit of counting: a group, or a component without one."""
    return place.groups[0] if place.groups else place.component


def _group_ms(group: Path) -> float | None:
    """Return the processor time of a group; None: it does not exist."""
    for name, count in (("cpuacct.usage", 1e6), ("cpu.stat", 1e3)):
        file = group / name
        if text := kernel_text(file):
            return (entry_of(file, text, "usage_usec") if name == "cpu.stat" else whole_number(file, text)) / count
    return None
