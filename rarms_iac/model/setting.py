"""A setting: one reservation of P1 with what was measured there; the setup of P1 and P2, and the platform below them.

Several runs of a setting are joined.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from rarms_iac.model.host import ProviderKind, SchedulerType
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.series import HeardMessages, Series, SkippedLines, join_series

P1 = "rarms-p1"
"""The test partition of the components; what its mark calls it. No partition of a manifest may be called so."""

P2 = "rarms-p2"
"""The test partition of the interfering load."""

LOAD_PARTITIONS = (P2, "rarms-p2b", "rarms-p2c")
"""The parts of P2, where the load runs in several."""

TEST_PARTITIONS = (P1, *LOAD_PARTITIONS)

P2_WEIGHT = 10_000
"""The highest weight that Hyper-V and control groups know: what P1's own processors leave idle goes to P2."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PartitionShape:
    """A test partition as it is made; its reserve is set for each setting."""

    name: str
    processors: int
    memory: int  # bytes
    limit: int
    weight: int


@dataclass(frozen=True, slots=True, kw_only=True)
class PlatformFacts:
    """The machine that was measured on, as far as it can change what is measured there."""

    provider: ProviderKind
    processor: str  # its model, as it names itself
    logical_processors: int
    smt: bool
    scheduler: SchedulerType
    guest_image: str  # what the test partitions run; empty: nothing of their own
    os_build: int  # 0: there is none


@dataclass(frozen=True, slots=True, kw_only=True)
class EnvironmentSetup:
    """P1 and P2 in those settings of a data log that count together; only the reserves differ between them."""

    members: tuple[str, ...]  # the components in P1, by name
    interference: str  # the load in P2, by its name in the manifest
    processors: int  # virtual ones, of P1; settings of other numbers do not count. P2 has as many as the host has LPs
    memory: int  # bytes, of P1
    limit: int  # of P1: per cent of each of its processors
    weight: int  # of P1


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineSpeed:
    """The speed of all processors at one moment, as far as the system reports it."""

    governor: str = ""  # of Linux's cpufreq, several joined by a comma; empty: not known, as on Windows
    mhz: int = 0  # on the average of the processors; 0: not known
    limit_mhz: int = 0  # the highest frequency allowed now, on the average; 0: not known
    throttled: int = 0  # rises each time that heat slows the processors


ALL_PARTITIONS = ""
"""Stands for all partitions together, where things are counted by the name of a partition."""

SHORT = 0.05
"""The part of all processors' time that neither P1 nor P2 may get of what P2 reserves: what rarms itself consumes is in
it, and about a two-hundredth of each other process that wants a processor. It is taken from both alike."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OutsideWork:
    """Processes that used processor time in a setting and were in none of its partitions."""

    name: str  # of their program; empty: processes that ended before a look saw them
    group: str  # their control group, as a path; empty: unknown
    cpu_ms: float
    processes: int = 1  # that a look saw
    component: str = ""  # that started them, and whose partition they left; empty: none is known


@dataclass(frozen=True, slots=True, kw_only=True)
class ThreadsSeen:
    """The threads of a component that are to have a task class by their names (`task: {threads: [...]}`)."""

    unmatched: tuple[str, ...] = ()  # patterns that no thread's name fits
    names: tuple[str, ...] = ()  # of threads that were seen, some of them
    refused: str = ""  # the first thread that did not get its priority, and the kernel's reason; empty: none

    @property
    def is_fine(self) -> bool:
        """Whether every pattern has a thread, and each has its priority."""
        return not self.unmatched and not self.refused


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingEvidence:
    """The counts of a host's kernel while samples were taken: they show whether the setting was kept."""

    elapsed_ms: float = 0.0
    cpu_ms: Mapping[str, float] = field(default_factory=dict)  # processor time by partition
    # How long its limit stopped a partition; `ALL_PARTITIONS`: the limit of all of them together.
    throttled_ms: Mapping[str, float] = field(default_factory=dict)
    stolen_ms: float = 0.0  # of all processors, by the machine below this one
    waiting_ms: float | None = None  # how long something waited for a processor (PSI); None: not counted
    # By partition, how long a ready virtual processor waits for a logical one; None: not counted.
    dispatch_wait_ns: Mapping[str, float] | None = None
    # By Hyper-V's names of counter set and counter, run times summed over processors; None: not counted.
    hypervisor_ms: Mapping[str, float] | None = None
    # By component, from the first line on: also before samples counted. Only of those that have some.
    skipped_lines: Mapping[str, SkippedLines] = field(default_factory=dict)
    # By component, from the first message on: only of those whose samples come from messages.
    messages: Mapping[str, HeardMessages] = field(default_factory=dict)
    outside: tuple[OutsideWork, ...] = ()  # where work ran that is in none of the partitions, largest first
    others: tuple[OutsideWork, ...] = ()  # all that used processors in none of the partitions, largest first
    out_of_memory: Mapping[str, int] = field(default_factory=dict)  # by component: processes killed for its memory
    speeds: tuple[MachineSpeed, ...] = ()  # of the machine, at the begin and at the end; empty: it does not say
    memory_peak: int | None = None  # bytes, the most that P1's processes had at once; None: not counted
    threads: Mapping[str, ThreadsSeen] = field(default_factory=dict)  # by component, if some have no priority
    disturbances: tuple[str, ...] = ()  # of each try that was disturbed, this one included where it is the last

    @property
    def load_cpu_ms(self) -> float:
        """The processor time of P2, of all its parts together."""
        return sum(self.cpu_ms.get(name, 0.0) for name in LOAD_PARTITIONS)

    def since(self, before: "SettingEvidence") -> "SettingEvidence":
        """Return the counts since then.

        Args:
            before: the counters at some earlier moment.

        Returns:
            The differences.
        """
        waited = self.waiting_ms is not None and before.waiting_ms is not None
        return replace(
            self,
            elapsed_ms=self.elapsed_ms - before.elapsed_ms,
            cpu_ms={name: time - before.cpu_ms.get(name, 0.0) for name, time in self.cpu_ms.items()},
            throttled_ms={name: time - before.throttled_ms.get(name, 0.0) for name, time in self.throttled_ms.items()},
            stolen_ms=self.stolen_ms - before.stolen_ms,
            speeds=(*before.speeds, *self.speeds),
            waiting_ms=(self.waiting_ms or 0.0) - (before.waiting_ms or 0.0) if waited else None,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """One reservation of the test partition P1 with what was measured there."""

    reserve: ReservePercent  # of P1, 1..100
    series: tuple[Series, ...]  # by component name
    beside: int = 0  # what P2 reserved meanwhile: per cent of each of its processors
    seed: int = 0  # that chance was drawn from, where the host draws it
    evidence: SettingEvidence | None = None  # None: the host counts nothing
    spent_ms: float | None = None  # of the host's time, with what was no sample; None: not recorded
    processors: int = 0  # virtual ones of P1 meanwhile; 0: not recorded, so those of the log's `EnvironmentSetup`
    used_processors: int | None = None  # the most that P1 was seen to use at once; None: that was not seen
    first_pass: bool = False  # a first look at it: it chooses settings and a provisional answer, and gives no verdict

    @property
    def host_ms(self) -> float:
        """The host's time that was spent on it; where that was not recorded, the time of its samples."""
        return self.spent_ms if self.spent_ms is not None else max(each.elapsed_ms for each in self.series)

    @property
    def has_verdict(self) -> bool:
        """Whether its samples count: its host had settled, and nothing disturbed it in each of its tries."""
        return not any(each.unsettled for each in self.series)


def join_settings(settings: Iterable[Setting], *, simulated: bool) -> tuple[Setting, ...]:
    """Join all that was measured at each reservation to one setting: one series of each component, in several runs.

    Args:
        settings: under one load, in the order in which they were measured.
        simulated: whether the host draws its samples from a seed: of those of one seed the longest run has all others.

    Returns:
        One setting a reservation, in the order in which these were first measured. What was disturbed or had not
        settled is left out, where anything else is there; so is a first look, where a later one is there.
    """
    by_reserve: dict[int, list[Setting]] = {}
    for setting in settings:
        by_reserve.setdefault(setting.reserve, []).append(setting)
    return tuple(_join(_without_shorter(known) if simulated else known) for known in by_reserve.values())


def _without_shorter(settings: Sequence[Setting]) -> list[Setting]:
    longest: dict[int, Setting] = {}
    for setting in settings:
        known = longest.get(setting.seed)
        if known is None or _length(setting) >= _length(known):
            longest[setting.seed] = setting
    return list(longest.values())


def _length(setting: Setting) -> tuple[bool, bool, int]:
    return not setting.first_pass, setting.has_verdict, min(len(series.samples) for series in setting.series)


def _join(settings: Sequence[Setting]) -> Setting:
    if len(settings) == 1:
        return settings[0]
    settings = [setting for setting in settings if not setting.first_pass] or settings
    valid = [setting for setting in settings if setting.has_verdict] or settings[-1:]
    parts: dict[str, list[Series]] = {}
    for series in (series for setting in valid for series in setting.series):
        parts.setdefault(series.component, []).append(series)
    return replace(
        valid[-1],
        series=tuple(map(join_series, parts.values())),
        spent_ms=sum(setting.host_ms for setting in settings),
        used_processors=most_used(settings),
    )


def most_used(settings: Iterable[Setting]) -> int | None:
    """Find the most processors that P1 was seen to use at once.

    Args:
        settings: in any order, of one log or several.

    Returns:
        None where no setting says it.
    """
    return max((setting.used_processors for setting in settings if setting.used_processors is not None), default=None)


def join_skipped(evidence: Iterable[SettingEvidence | None]) -> Mapping[str, SkippedLines]:
    """Return the skipped lines of several settings or starts, by component."""
    found: dict[str, SkippedLines] = {}
    for each in evidence:
        for name, more in (each.skipped_lines if each else {}).items():
            before = found.get(name, SkippedLines())
            found[name] = SkippedLines(count=before.count + more.count, first=before.first or more.first)
    return found


def join_heard(evidence: Iterable[SettingEvidence | None]) -> Mapping[str, HeardMessages]:
    """Return the heard messages of several settings or starts, by component: counts added, the largest delays."""
    found: dict[str, HeardMessages] = {}
    for each in evidence:
        for name, more in (each.messages if each else {}).items():
            found[name] = _join_heard(found[name], more) if name in found else more
    return found


def _join_heard(one: HeardMessages, other: HeardMessages) -> HeardMessages:
    slow = max(one, other, key=lambda each: each.delay_ms or 0.0)
    slowest = max(one, other, key=lambda each: each.p99_delay_ms or 0.0)
    return replace(
        max(one, other, key=lambda each: abs(each.ahead_ms)),
        inputs=one.inputs + other.inputs,
        outputs=one.outputs + other.outputs,
        unmatched=one.unmatched + other.unmatched,
        delay_ms=slow.delay_ms,
        p99_delay_ms=slowest.p99_delay_ms,
        simulated_time=one.simulated_time or other.simulated_time,
    )
