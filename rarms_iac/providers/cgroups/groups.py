"""Control groups as the kernel shows them: what both versions have in common.

Every group of rarms lies below one slice, which weighs more than everything outside. All paths are parameters: a
test works below a slice of its own. Where a call says `OSError`, the kernel's own answer is passed on. Every call that
reads raises `UnreadableFile` if a file has no number where the kernel writes one.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from rarms_iac.planner.task_classes import budget_percent
from rarms_iac.providers.cgroups.effects import LinuxEffects, below_first, processes_in
from rarms_iac.running.kernel_files import PROC, entry_of, kernel_text, processor_list, whole_number
from rarms_iac.running.orders import ProcessPlace
from rarms_iac.running.work_places import group_path

USUAL_PERIOD_US = 100_000
"""The kernel's own period of a quota."""

SLICE_PERIOD_US = 20_000
"""The period of the slice's limit: with 5 % kept for the host, partitions wait 1 ms in every 20 ms."""

_RUNTIME = "cpu.rt_runtime_us"

PAGE_BYTES = 4096
"""In whole pages the kernel counts memory. Machines with larger ones are rare, and a MiB is whole pages there, too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupValues:
    """The values of a control group, in per cent of one logical processor, microseconds and bytes."""

    shares_percent: float  # its weight against those of the other groups; a reserve of so many per cent
    quota_percent: float | None = None  # None: no limit
    period_us: int = USUAL_PERIOD_US
    processors: tuple[int, ...] | None = None  # it runs on these only; None: on all
    memory: int | None = None  # None: no limit


class GroupTree(ABC):
    """The groups below one slice."""

    version: str  # v1 or v2
    _memory_events: str  # name of the file with the count `oom_kill`

    def __init__(self, effects: LinuxEffects, slices: Mapping[str, Path]) -> None:
        self._effects = effects
        self._slices = slices  # controller -> the slice's folder in its hierarchy; in version 2 all are the same
        self._folders = tuple(dict.fromkeys(slices.values()))

    @abstractmethod
    def write(self, name: str, values: GroupValues) -> None:
        """Give a group all of these values, one file after the other. Raises OSError."""

    @abstractmethod
    def read(self, name: str) -> GroupValues:
        """Read the values as they are in the kernel now. Raises FileNotFoundError where the group is not there."""

    def as_kernel_shows(self, values: GroupValues) -> GroupValues:
        """Return the answer of `read` once these values are written: the kernel rounds, and has its bounds."""
        quota, period = values.quota_percent, values.period_us
        return replace(
            values,
            shares_percent=self._shown_shares(values),
            quota_percent=None if quota is None else self._quota_us(quota, period) * 100 / period,
            period_us=USUAL_PERIOD_US if quota is None else period,
            memory=whole_pages(values.memory),
        )

    def _quota_us(self, percent: float, period_us: int) -> int:
        """Return a quota in whole microseconds of each period."""
        return round(percent * period_us / 100)

    @abstractmethod
    def _shown_shares(self, values: GroupValues) -> float:
        """Return the shares that the kernel shows."""

    @abstractmethod
    def cpu_ms(self, name: str) -> float:
        """Return the processor time, in ms, that the group consumed since it was made. Raises OSError."""

    @abstractmethod
    def throttled_ms(self, name: str) -> float:
        """Return the time, in ms, that its quota kept the group waiting. Raises OSError."""

    @abstractmethod
    def used_memory(self, name: str) -> int | None:
        """Return the bytes of the group's processes that the kernel cannot take back; None: it does not say."""

    @abstractmethod
    def usable_processors(self) -> int:
        """Return the number of the machine's processors that groups may use at all. Raises OSError."""

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
    def is_there(self) -> bool:
        """Return whether the slice exists."""
        return self._effects.has_folder(self._slices["cpu"])

    @property
    def boot(self) -> str:
        """What stands for the machine's start in definitions, where groups outlive it; empty: they do not."""
        return ""

    def name_for(self, partition: str) -> str:
        """Return the name of a partition's group, unless that name is taken."""
        return partition

    def ask_to_end(self, name: str, grace_ms: int) -> None:
        """Ask the processes in the group to end (SIGTERM), and wait until they did or the grace is over.

        Args:
            name: of the group, which need not be there.
            grace_ms: how long they may take; with 0 no process is asked.
        """
        if grace_ms:
            self._effects.ask_to_end(self._groups(name), grace_ms)

    def names(self) -> tuple[str, ...]:
        """Return the names of the groups below the slice, sorted."""
        return self._effects.folders(self._slices["cpu"])

    def make(self, name: str) -> None:
        """Make a group with the kernel's own values, and the slice above it; what is there stays. Raises OSError."""
        self._prepare_slice()
        for folder in self._folders:
            self._effects.make(folder / name)
        self._prepare_group(name)

    def start_with_machine(self, name: str, starts: bool) -> None:  # noqa: B027 - it is the whole of it
        """Have systemd start a group with the machine, or not; without systemd nothing does.

        Raises:
            OSError: systemd refuses.
        """

    def limit_slice(self, percent: int | None) -> None:
        """Let all groups together have no more than this, where the slice is there: the rest is for what is outside.

        A group whose own quota is larger gets the smaller one first: version 1 refuses the slice's otherwise.

        Args:
            percent: of one logical processor; None: no limit.

        Raises:
            OSError: the kernel refuses.
        """
        if not self.is_there:
            return
        for name in self.names():
            with suppress(FileNotFoundError):  # the group was removed meanwhile
                values = self.read(name)
                if percent is not None and values.quota_percent is not None and values.quota_percent > percent:
                    self.write(name, replace(values, quota_percent=percent))
        with suppress(FileNotFoundError):  # a kill left half of it
            now = self.read("")
            if now.quota_percent == percent and (percent is None or now.period_us == SLICE_PERIOD_US):
                return
        self._write_quota("", percent, SLICE_PERIOD_US)

    def remove(self, name: str) -> None:
        """End every process in the group at once and remove it, and the slice where it is empty then.

        Raises:
            OSError: its processes do not end, something keeps the group, or it may not be removed.
        """
        self._effects.end_processes(self._groups(name))
        for folder in reversed(self._folders):
            for group in below_first(self._effects, folder / name):
                self._effects.remove(group)
            self._effects.remove_empty(folder)

    def place(self, name: str) -> ProcessPlace:
        """Return the way of a starting process into the group: files that take its id, or words before its own."""
        join = tuple(folder / name / "cgroup.procs" for folder in self._folders)
        return replace(self._counted(name), join=join)

    def parent_of_containers(self, name: str) -> str:
        """Return the group as `docker run` and `podman run` take it after `--cgroup-parent`."""
        return f"/{self._slices['cpu'].name}/{name}"

    def _counted(self, name: str) -> ProcessPlace:
        """Return the counters of a group's time and of the processes that the kernel killed for its memory."""
        return ProcessPlace(
            groups=(self._slices["cpuacct"] / name,), memory_events=self._slices["memory"] / name / self._memory_events
        )

    def real_time_percent(self) -> int | None:
        """Return the part of each processor that the kernel has for real-time budgets; None: none, or all.

        Raises:
            OSError: the kernel refuses to tell.
        """
        root = self._slices["cpu"].parent
        if not self._effects.has_file(root / _RUNTIME):
            return None
        budget = self._budget_us(root)
        return None if budget < 0 else 100 * budget // USUAL_PERIOD_US

    def allow_real_time(self, name: str, percent: int) -> None:
        """Let real-time processes of a group run for a part of each processor's time, where the kernel asks for it.

        A kernel with budgets (version 1) starts none in a group without one, and gives all groups of the machine 95 %
        together. A budget is counted in pieces of 100 ms.

        Args:
            percent: of each processor; its processes get no more, also where the rest is idle.

        Raises:
            OSError: other groups have budgets that leave too little.
        """
        folder = self._slices["cpu"]
        if not self._effects.has_file(folder / name / _RUNTIME):
            return
        others = sum(self._budget_us(folder / group) for group in self.names() if group != name)
        wanted = budget_percent(percent) * USUAL_PERIOD_US // 100
        for group, budget in ((folder, others + max(wanted, self._budget_us(folder / name))), (folder / name, wanted)):
            self._effects.write(group / "cpu.rt_period_us", str(USUAL_PERIOD_US))
            self._effects.write_budget(group / _RUNTIME, str(budget))

    def processes(self, name: str) -> tuple[int, ...]:
        """Return the ids of the processes in the group and below it, ascending; none where the group is not there."""
        return processes_in(self._effects, self._groups(name))

    def members_below(self, group: Path | str) -> tuple[int, ...]:
        """Return the ids of the processes in any control group and below it, ascending."""
        return processes_in(self._effects, (Path(group),))

    def folder_of(self, path: str) -> Path:
        """Return the folder of a control group in the hierarchy of the processor time, by its path there."""
        return self._slices["cpu"].parent / path.lstrip("/")

    def folders_of(self, name: str) -> tuple[Path, ...]:
        """Return the folders of a group below the slice, one for each hierarchy."""
        return self._groups(name)

    def home_of(self, process: int) -> Path:
        """Return the control group of a process in the hierarchy of the processor time."""
        return self._home(kernel_text(PROC / f"{process}/cgroup"), "cpu")

    def homes_of(self, process: int, name: str) -> Mapping[Path, Path]:
        """Return the control group of a process in each hierarchy, by the folder of one of ours there.

        None where it has ended.
        """
        if not (text := kernel_text(PROC / f"{process}/cgroup")):
            return {}
        return {folder / name: self._home(text, controller) for controller, folder in self._slices.items()}

    def _home(self, text: str, controller: str) -> Path:
        return self._slices[controller].parent / group_path(text, controller).lstrip("/")

    def _groups(self, name: str) -> tuple[Path, ...]:
        return tuple(folder / name for folder in self._folders)

    def _budget_us(self, group: Path) -> int:
        """Return the real-time budget of a group in 100 ms, in microseconds."""
        period, budget = group / "cpu.rt_period_us", group / _RUNTIME
        return self._number_in(budget, least=-1) * USUAL_PERIOD_US // self._number_in(period, least=1)

    def _read(self, controller: str, name: str, file: str) -> str:
        return self._effects.read(self._file(controller, name, file))

    def _number_in(self, file: Path, *, least: int = 0) -> int:
        return whole_number(file, self._effects.read(file), least=least)

    def _entry_in(self, controller: str, name: str, file: str, entry: str) -> int:
        path = self._file(controller, name, file)
        return entry_of(path, self._effects.read(path), entry)

    def _memory_in(self, name: str, *entries: str) -> int | None:
        """Add up entries of a group's `memory.stat`; None where it is not there."""
        path = self._file("memory", name, "memory.stat")
        text = self._read_if_there(path)
        return sum(entry_of(path, text, entry) for entry in entries) if text else None

    def _processors_in(self, file: Path) -> tuple[int, ...]:
        """Return the processors that a file lists; none where it is not there."""
        return processor_list(file, self._read_if_there(file))

    def _write(self, controller: str, name: str, file: str, text: str) -> None:
        self._effects.write(self._file(controller, name, file), text)

    def _read_if_there(self, file: Path) -> str:
        return self._effects.read(file) if self._effects.has_file(file) else ""

    def _file(self, controller: str, name: str, file: str) -> Path:
        return self._slices[controller] / name / file


def whole_pages(memory: int | None) -> int | None:
    """Return so many bytes as the kernel counts them; None: no limit."""
    return None if memory is None else memory - memory % PAGE_BYTES
