"""The machine below a Linux host's partitions: its facts, and the processes of a control group.

Read from `/etc`, `/proc` and `/sys`: what processes consumed, and how many processors they use at once.
"""

import re
import time
import uuid
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from random import Random
from threading import Event, Thread

from rarms_iac.model.experiment import most_at_once
from rarms_iac.model.host import Host, ProviderKind, SchedulerType, host_identity
from rarms_iac.model.state import USUAL_DEADLINE_PERCENT, HostFacts, ProcessorKind, Rights
from rarms_iac.providers.cgroups.effects import LinuxEffects
from rarms_iac.providers.cgroups.groups import GroupTree
from rarms_iac.providers.cgroups.speed import read_governor
from rarms_iac.running.kernel_files import (
    PROC,
    UnreadableFile,
    children_of,
    in_ms,
    kernel_text,
    processor_list,
    read_process,
    real_time_percent,
    whole_number,
)
from rarms_iac.running.run_exec import started_by_exec
from rarms_iac.running.work_places import group_path

NAMESPACE = uuid.UUID("b0c2d7ee-3f0b-5a6f-9a55-6b1f0f6a7c11")
"""Ids of partitions, and of machines that have none of their own, are made in it."""

STARTS_OF_WATCHER = (Path("/etc/systemd/system/rarms-threads.path"), Path("/etc/cron.d/rarms"))
"""The files of `rarms install` by which the system starts the watcher of threads."""

WATCHER_IN_S = 90.0
"""After a change of its rules the watcher runs: cron starts it each minute."""

_WATCHER = "rarms_iac.running.thread_watcher"
_ID, _MEMORY, _HOSTNAME = Path("/etc/machine-id"), Path("/proc/meminfo"), Path("/proc/sys/kernel/hostname")
_BOOT = Path("/proc/sys/kernel/random/boot_id")
_CPU = Path("/sys/devices/system/cpu")
_SMT, _PROCESSORS = _CPU / "smt/active", _CPU / "online"
MEBIBYTE = 2**20


def read_boot(effects: LinuxEffects) -> str:
    """Return the id of the machine's latest start. Raises OSError."""
    return effects.read(_BOOT)


def read_facts(host: Host, effects: LinuxEffects) -> HostFacts:
    """Return the facts of a machine, the host of the manifest.

    Raises:
        OSError: it has no `/proc`, or no `/sys`.
        UnreadableFile: a file is not as a Linux writes it.
    """
    name = effects.read(_HOSTNAME)
    deadline = real_time_percent(lambda file: _text(effects, file))
    online = effects.read(_PROCESSORS)
    if not (processors := processor_list(_PROCESSORS, online)):
        raise UnreadableFile(_PROCESSORS, online, "a list of processors")
    return HostFacts(
        name=host.name,
        id=host_identity(_text(effects, _ID) or uuid.uuid5(NAMESPACE, name).hex),
        provider=ProviderKind.LINUX,
        computer_name=name,
        os_build=0,
        client=False,
        scheduler=SchedulerType.NONE,
        smt=_text(effects, _SMT) == "1",
        logical_processors=len(processors),
        memory=_memory_kib(effects.read(_MEMORY)) * 1024 // MEBIBYTE * MEBIBYTE,
        rights=Rights.PROVEN,  # `LinuxHostProvider.tree` has refused the host where they are missing
        governor=read_governor(effects),
        processor_kinds=_kinds(effects, processors),
        deadline_percent=None if deadline == USUAL_DEADLINE_PERCENT else deadline,
    )


def _kinds(effects: LinuxEffects, processors: Iterable[int]) -> tuple[ProcessorKind, ...]:
    counts = Counter(_kind(effects, _CPU / f"cpu{number}") for number in processors)
    return tuple(sorted(replace(kind, processors=count) for kind, count in counts.items())) if len(counts) > 1 else ()


def _kind(effects: LinuxEffects, folder: Path) -> ProcessorKind:
    siblings, capacity, base = (
        folder / name for name in ("topology/thread_siblings_list", "cpu_capacity", "cpufreq/base_frequency")
    )
    return ProcessorKind(
        processors=1,
        threads=len(processor_list(siblings, _text(effects, siblings))),
        capacity=whole_number(capacity, _text(effects, capacity) or "0"),
        base_mhz=whole_number(base, _text(effects, base) or "0") // 1000,  # of kHz
    )


def _memory_kib(text: str) -> int:
    words = text.partition("MemTotal:")[2].split()
    if not words:
        raise UnreadableFile(_MEMORY, text, "a line MemTotal")
    return whole_number(_MEMORY, words[0])


def _text(effects: LinuxEffects, path: Path) -> str:
    return effects.read(path) if effects.has_file(path) else ""


def starts_thread_watcher(effects: LinuxEffects, state_folder: Path) -> bool:
    """Return whether the watcher of threads runs or, as long as its rules are new, the system will start it.

    Args:
        state_folder: rarms writes the rules into it.
    """
    rules = [state_folder / name for name in effects.files(state_folder) if name.endswith(".threads")]
    if any(map(effects.has_file, STARTS_OF_WATCHER)) and all(effects.age_s(file) < WATCHER_IN_S for file in rules):
        return True
    words = f"\0{_WATCHER}\0{state_folder}\0"
    return bool(rules) and any(words in kernel_text(PROC / process / "cmdline") for process in effects.folders(PROC))


_SUPERVISOR = "supervisor_process.py"
_SERVICE = re.compile(r"rarms-[^/]*\.service")
_OF_DOCKER = re.compile(r"(^|/|docker-)[0-9a-f]{64}(\.scope)?(/|$)")


def consumed_ms(process: int) -> float:
    """Return the processor time, in ms, of all that a process started, in whole ticks of the kernel's clock.

    Args:
        process: its id; what it consumed itself does not count.
    """
    stat, below = read_process(process), children_of(process)
    total = stat.ticks_of_children if stat else 0
    while below:
        child = below.pop()
        if (stat := read_process(child)) is not None:
            total += stat.ticks + stat.ticks_of_children
        below += children_of(child)
    return in_ms(total)


def orphans(processes: Iterable[int], read: Callable[[Path], str] = kernel_text) -> tuple[tuple[int, str], ...]:
    """Return the processes that neither a supervisor nor `rarms run --exec` started, with their names.

    Args:
        processes: ids of the processes in a control group.

    Returns:
        Pairs of id and name, in the order of the ids given.
    """
    found = ((process, read_process(process, read)) for process in processes)
    return tuple(
        (process, stat.name)
        for process, stat in found
        if stat
        and not _is_supervised(stat.parent, read)
        and not _runs_for_client(process, read)
        and started_by_exec(process, read) is None
    )


def _runs_for_client(process: int, read: Callable[[Path], str]) -> bool:
    """Return whether a supervised program waits for the service or docker container that a process belongs to."""
    path = group_path(read(PROC / f"{process}/cgroup"))
    if unit := _SERVICE.search(path):
        option = f"--unit={unit[0]}\0"
    elif _OF_DOCKER.search(path):  # the engine alone knows the container's name; its client joined the partition
        option = "docker\0run\0"
    else:
        return False
    clients = (int(entry.name) for entry in PROC.iterdir() if entry.name.isdecimal())
    return any(option in read(PROC / f"{client}/cmdline") and _is_supervised(client, read) for client in clients)


def _is_supervised(process: int, read: Callable[[Path], str]) -> bool:
    while process > 1:
        if _SUPERVISOR in read(PROC / f"{process}/cmdline"):
            return True
        stat = read_process(process, read)
        process = stat.parent if stat else 0
    return False


MEMORY_EVERY_S = 0.1
"""How often the group's memory is looked at: the kernel adds it up for each look."""

BETWEEN_S = (0.005, 0.025)
"""The least and the greatest pause between two looks: at random, so that they lock into no period of a component."""


PAUSE_PER_LOOK = 50
"""A pause is at least so many times as long as the look before: looks take at most 2 % of a processor."""


class ThreadLooks:
    """The looks at a group's threads so far."""

    def __init__(self, tree: GroupTree, group: str) -> None:
        self._tree = tree
        self._group = group
        self._seconds: dict[int, float] = {}  # by number of threads that ran, or waited for a processor, at once
        self.memory_peak: int | None = None  # bytes, the most that the group's processes had at a look
        self._ended = Event()
        self._problem: UnreadableFile | OSError | None = None

    def most(self, under_way_ms: float) -> int | None:
        """Return the most threads at once.

        Args:
            under_way_ms: how long a job was under way so far.

        Returns:
            None where the group was not looked at yet.

        Raises:
            UnreadableFile, OSError: the last look failed.
        """
        if self._problem is not None:
            raise self._problem
        seconds = dict(self._seconds)
        return most_at_once(seconds, under_way_ms / 1000) if seconds else None

    def forget(self) -> None:
        """Forget what was seen while processes started: jobs did not use it."""
        self._seconds = {}

    def look_until_ended(self) -> None:
        """Look again and again; each look stands for the time since the one before."""
        pauses, before = Random(), time.perf_counter()  # noqa: S311 - no secret
        memory_from, took_s = before, 0.0
        while not self._ended.wait(max(pauses.uniform(*BETWEEN_S), PAUSE_PER_LOOK * took_s)):
            begun = time.perf_counter()
            try:
                threads, now = sum(map(_runnable, self._tree.processes(self._group))), time.perf_counter()
            except (UnreadableFile, OSError) as problem:
                self._problem = problem
                return
            self._seconds[threads] = self._seconds.get(threads, 0.0) + now - before
            before = now
            if now >= memory_from:
                memory_from = now + MEMORY_EVERY_S
                self._look_at_memory()
            took_s = time.perf_counter() - begun

    def _look_at_memory(self) -> None:
        used = self._tree.used_memory(self._group)
        if used is not None:
            self.memory_peak = max(used, self.memory_peak or 0)

    def end(self) -> None:
        """Stop looking."""
        self._ended.set()


@contextmanager
def looking_at(tree: GroupTree, group: str) -> Iterator[ThreadLooks]:
    """Look at a group's threads as long as the context lasts.

    Yields:
        What was seen so far; it stays when the context has ended.
    """
    looks = ThreadLooks(tree, group)
    thread = Thread(target=looks.look_until_ended, name=f"threads of {group}", daemon=True)
    thread.start()
    try:
        yield looks
    finally:
        looks.end()
        thread.join()


def _runnable(process: int) -> int:
    """Return the number of a process's threads that run or wait for a processor; 0 if it has ended."""
    try:
        return sum(_is_runnable(thread) for thread in (PROC / str(process) / "task").iterdir())
    except OSError:
        return 0


_ENGINES = frozenset({"podman", "docker", "conmon", "runc", "crun"})
"""Programs that start a container and pass on its output: their threads are no part of a job."""


def _is_runnable(thread: Path) -> bool:
    """Read the state, which follows the name: a name may hold anything, also a bracket."""
    before, _, after = kernel_text(thread / "stat").rpartition(")")
    return after.split()[:1] == ["R"] and before.partition("(")[2] not in _ENGINES
