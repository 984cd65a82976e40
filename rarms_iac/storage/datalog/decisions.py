"""The two logs of decisions, JSON Lines like a data log: the configuration log of a CoI, and the tuning log.

A configuration log, one per platform and component, says which level was chosen, what the CoI gets, in what
environment, and how it was proven; the last `Chosen` is what holds. The tuning log, one a platform, says what each
run of `rarms tune` asked for, in order, and what came of it. A plan depends on none of that: it is there for readers
why components share a partition.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import Literal

from rarms_iac.model.indexes import find_index
from rarms_iac.model.outcomes import VerdictWord
from rarms_iac.model.output import Internal, output
from rarms_iac.model.setting import EnvironmentSetup, PlatformFacts
from rarms_iac.model.system import Threshold
from rarms_iac.storage.codec import Json, NotDecodable, decode, decode_union
from rarms_iac.storage.datalog.files import TUNING, append_to_log, decoded_records
from rarms_iac.storage.disk import MEASUREMENTS
from rarms_iac.storage.records import LogLine, iterate_log
from rarms_iac.texts.messages import quoted


@dataclass(frozen=True, slots=True, kw_only=True)
class Chosen:
    """A level and the reservation that follows from it, with the set-up that it was measured in."""

    kind: Literal["chosen"] = "chosen"
    component: str
    when: str  # UTC, as 2027-01-31T12:00:00Z
    rarms_version: str
    apt: Mapping[str, str]  # by index, as the manifest writes it: at most 100 ms
    partition: str
    reserve: int  # whole per cent of each of the partition's processors
    task: str | None
    data_log: str  # path below the manifest's folder
    identity: str  # the data log's digest
    setup: EnvironmentSetup
    platform_facts: PlatformFacts


@dataclass(frozen=True, slots=True, kw_only=True)
class ProvenIndex:
    """One index with its threshold."""

    index: str
    threshold: Threshold
    value: float | None  # None: unknown
    lower: float | None
    upper: float | None
    met: bool  # it was shown to be; not so: missed, or without a verdict
    verdict: VerdictWord
    error: float | None = None  # that the verdict is wrong; the truth is outside the bounds with twice as much
    samples_needed: int | None = None  # that would show it, where it is inconclusive; None: unknown


@dataclass(frozen=True, slots=True, kw_only=True)
class Proven:
    """The component's indexes in the applied layout, all components together."""

    kind: Literal["proven"] = "proven"
    component: str
    when: str  # UTC, as 2027-01-31T12:00:00.123456Z
    rarms_version: str
    host: str
    partition: str
    reserve: int
    beside: tuple[str, ...]  # the components that ran meanwhile, by name
    indexes: Internal[tuple[ProvenIndex, ...]]
    interference: str | None = None  # the load on all of them; None: there was none
    robot: str = ""  # of `Application`
    machine: str = ""  # the host's own identity (`HostFacts.id`): robots share names; empty: not known
    # Of the application's runs on the host before it, undos among them: clocks jump back, a count of runs does not.
    serial: int
    wall_seconds: float = 0.0  # what the proof took its user; a host's own clock may be a simulation's
    # The reserves of all partitions of the application on the host, by name, in per cent; empty: not known.
    layout: Mapping[str, int] = field(default_factory=dict)


Entry = Chosen | Proven


def read_entries(path: Path) -> tuple[Entry, ...]:
    """Read all entries, oldest first; none without a file.

    Returns:
        Choices and proofs as they were made.

    Raises:
        LogUnreadable: the log is damaged, or holds something else.
        OSError: it cannot be read.
    """
    return entries_in(iterate_log(path), path)


def entries_in(lines: Iterable[LogLine], path: Path) -> tuple[Entry, ...]:
    """Return the entries that lines of a configuration log are, oldest first; `path` is for messages.

    Raises:
        LogUnreadable: the log is damaged, or holds something else.
    """
    return decoded_records(lines, path, _entry_in)


def _entry_in(record: dict[str, Json]) -> Entry:
    entry: Entry = decode_union(Entry, record)
    for number, proven in enumerate(entry.indexes if isinstance(entry, Proven) else ()):
        if find_index(proven.index) is None:
            raise NotDecodable(f"indexes[{number}].index", f"the index {quoted(proven.index)} is unknown")
    return entry


def last_chosen(entries: tuple[Entry, ...]) -> Chosen | None:
    """Return the choice that holds.

    Returns:
        None: not chosen yet.
    """
    return next((entry for entry in reversed(entries) if isinstance(entry, Chosen)), None)


TuningStrategy = Literal["default", "paper"]
TuningEnding = Literal["successful", "unable", "nothing_to_do", "stopped"]


@dataclass(frozen=True, slots=True, kw_only=True)
class TunedPartition:
    """A partition as tuning left it."""

    name: str
    components: tuple[str, ...]  # the most critical first
    processors: int  # logical ones that its virtual ones take: under the core scheduler all of their cores
    reserve: int  # CR: whole per cent of each of its virtual processors, and of each logical one that they take
    parts: Internal[int | None]  # per cent of one logical processor that its parts reserved; None: it was there before

    @property
    def reserved(self) -> int:
        """In per cent of one logical processor."""
        return self.processors * self.reserve

    @output
    def reserved_lp(self) -> Fraction:
        """What it reserves, in LPs."""
        return Fraction(self.reserved, 100)

    @output
    def parts_lp(self) -> Fraction | None:
        """What its parts reserved in partitions of their own, in LPs; None: it was there before."""
        return None if self.parts is None else Fraction(self.parts, 100)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrailSetting:
    """A setting that was asked for, with its answer."""

    components: tuple[str, ...]
    reserve: int  # CR
    worse: tuple[str, ...]  # those that were not shown to meet every threshold; none: it was enough
    unresolved: bool = False  # it was not enough, and not shown to be too little
    predicted: int | None = None  # the CR that was expected to be enough; None: nothing predicted it
    processors: Internal[int] = 1  # P1's VPs, which the CR is per cent of

    @output
    def met(self) -> bool:
        """Whether it was enough."""
        return not self.worse


@dataclass(frozen=True, slots=True, kw_only=True)
class UnprovedNeed:
    """A compound that may need less than it was taken to need, so that another layout may be better."""

    components: tuple[str, ...]
    shown: int  # CR that it needs at least, as was shown
    unresolved: int  # the highest CR that was not enough, and not shown to be too little


@dataclass(frozen=True, slots=True, kw_only=True)
class TuningRun:
    """A run; amounts in per cent of one logical processor. One that was stopped goes on later, and is not recorded."""

    kind: Literal["tuning"] = "tuning"
    when: str  # UTC, as 2027-01-31T12:00:00Z
    rarms_version: str
    strategy: TuningStrategy
    ending: TuningEnding
    message: str
    capacity: Internal[int]  # of the hosts, without what is kept for them or unmanaged
    fixed: Internal[int] = 0  # what partitions reserve that are not tuned: a part of `before` and of `after`
    before: Internal[int]
    after: Internal[int]
    proved: bool  # that no other layout is better
    contradictions: tuple[str, ...]
    doubts: tuple[UnprovedNeed, ...] = ()  # with any, nothing is proved
    partitions: tuple[TunedPartition, ...]
    trail: tuple[TrailSetting, ...]
    written: bool  # into the manifest

    @output
    def claim(self) -> str:
        """What is known of other layouts: `proved` that none is better, or `not proved`."""
        return "proved" if self.proved else "not proved"

    @output
    def capacity_lp(self) -> Fraction:
        """What the hosts can promise, in LPs."""
        return Fraction(self.capacity, 100)

    @output
    def fixed_lp(self) -> Fraction:
        """What partitions reserve that are not tuned, in LPs: a part of what is reserved before and after."""
        return Fraction(self.fixed, 100)

    @output
    def before_lp(self) -> Fraction:
        """What was reserved, in LPs."""
        return Fraction(self.before, 100)

    @output
    def after_lp(self) -> Fraction:
        """What is reserved now, in LPs."""
        return Fraction(self.after, 100)


def tuning_path(folder: Path, platform: str) -> Path:
    """Return the path below the manifest's folder; components have folders there, so it cannot be a component's.

    Returns:
        The path; whether there is such a file is not looked at.
    """
    return folder / MEASUREMENTS / platform / TUNING


def append_run(path: Path, run: TuningRun) -> None:
    """Add a run, unless the last one says the same; the log and its folder are made. On the disk on return.

    Args:
        run: what `rarms tune` asked, found and wrote.

    Raises:
        LogUnreadable: the log is damaged.
        OSError: it cannot be written.
    """
    last = read_runs(path)[-1:]
    if last and replace(last[0], when=run.when, rarms_version=run.rarms_version) == run:
        return
    append_to_log(path, run)


def read_runs(path: Path) -> tuple[TuningRun, ...]:
    """Read all runs, oldest first; none without a file.

    Returns:
        The runs as they were recorded.

    Raises:
        LogUnreadable: the log is damaged, or holds something else.
        OSError: it cannot be read.
    """
    return runs_in(iterate_log(path), path)


def runs_in(lines: Iterable[LogLine], path: Path) -> tuple[TuningRun, ...]:
    """Return the runs that lines of a tuning log are, oldest first; `path` is for messages.

    Raises:
        LogUnreadable: the log is damaged, or holds something else.
    """
    return decoded_records(lines, path, _run_in)


def _run_in(record: dict[str, Json]) -> TuningRun:
    run = decode(TuningRun, record)
    groups = [each.components for kind in (run.partitions, run.trail, run.doubts) for each in kind]
    if not all(groups):
        raise NotDecodable("", "a compound or a partition does not have a component")
    return run
