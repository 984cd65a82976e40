"""A data log: headers, and a setting a line with where it comes from."""

from array import array
from collections.abc import Collection, Hashable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any
from weakref import WeakValueDictionary

from rarms_iac.model.host import ProviderKind
from rarms_iac.model.series import SampleColumns, columns_of
from rarms_iac.model.setting import EnvironmentSetup, PlatformFacts, Setting, join_settings

FORMAT = "rarms-datalog/3"


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """Everything that can change the PI, by name: `vision.run.timeout`, `file components/vision.py`.

    Two logs with equal parts say the same thing; a part that differs shows the change.
    """

    parts: Mapping[str, str]
    interpreters: Mapping[str, str] = field(default_factory=dict)  # programs outside the folder, variables; only warn


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """A line of a data log: what settings have in common that were measured under the same conditions.

    A file has several where the conditions changed, or where branches were merged that both measured.
    """

    platform: str
    digest: str  # of all the rest but P1's processors, of which each setting says its own; each record names it
    identity: Identity
    platform_facts: PlatformFacts
    setup: EnvironmentSetup
    format_version: str = FORMAT


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """The origin of a setting."""

    rarms_version: str
    when: str  # UTC, as 2027-01-31T12:00:00Z
    beside: tuple[str, ...] = ()  # partitions that ran on the host meanwhile, which was overridden
    weak_load: bool = False  # the load cannot take all that P2 reserves, or was seen to leave some of it idle


@dataclass(frozen=True, slots=True, kw_only=True)
class Recorded:
    """A measured setting with where it comes from."""

    setting: Setting
    provenance: Provenance

    @property
    def is_busy(self) -> bool:
        """Whether something else ran on the host meanwhile."""
        return bool(self.provenance.beside)


DIGITS = 4
"""Decimals of a millisecond that a log keeps."""


def as_recorded(setting: Setting) -> Setting:
    """Return the setting as it will be read back: its times rounded.

    All that decides by what was measured decides by this, so that a run that goes on from its log decides the same.
    """
    is_real = setting.evidence is not None
    series = (replace(each, samples=columns_of(each.samples), wanders=is_real) for each in setting.series)
    rounded: Setting = _rounded(replace(setting, series=tuple(series)))
    return rounded


def _rounded(value: Any) -> Any:
    match value:
        case float():
            return round(value, DIGITS)
        case array():
            return array("d", [round(time, DIGITS) for time in value])
        case SampleColumns():
            times = {"began_ms": _rounded(value.began_ms), "response_ms": _rounded(value.response_ms)}
            return replace(value, **times, known={})
        case Mapping():
            return {name: _rounded(item) for name, item in sorted(value.items())}
        case tuple():
            return tuple(map(_rounded, value))
        case _ if is_dataclass(value) and not isinstance(value, type):
            return replace(value, **{part.name: _rounded(getattr(value, part.name)) for part in fields(value)})
        case _:
            return value


@dataclass(frozen=True, slots=True, kw_only=True)
class Remeasurement:
    """Measuring all that was asked for once more, apart from what is recorded: who is killed in it goes on with it."""

    seed: int  # of its settings, and of no others before it
    asked: str  # what was asked for, so that the same command is known again
    begun: str  # UTC; the same in all logs that one command is about
    ended: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class LogRecord:
    """A line of a data log that is not a header."""

    header: str  # its digest
    record: Recorded | Remeasurement  # of several records of a remeasurement the last holds


@dataclass(frozen=True, slots=True, kw_only=True, weakref_slot=True)
class DataLog:
    """The settings measured of components in one partition, against one interfering load, under equal conditions."""

    header: Header
    recorded: tuple[Recorded, ...]  # in the order in which they were measured
    remeasurements: tuple[Remeasurement, ...] = ()  # those that were asked for, in order
    file: "LogFile | None" = field(default=None, repr=False, compare=False)  # that it is a part of, and keeps in memory
    settings: tuple[Setting, ...] = field(init=False, repr=False, compare=False)
    """What counts, joined to one setting a reservation, in the order in which these were first measured."""
    estimated: tuple[Setting, ...] = field(init=False, repr=False, compare=False)
    """The same, and those of the first pass where nothing else was measured."""

    def __post_init__(self) -> None:
        runs = [record.setting for record in self.estimating]
        judged = [run for run in runs if not run.first_pass]
        object.__setattr__(self, "settings", join_settings(judged, simulated=self.is_simulated))
        all_are_judged = len(judged) == len(runs)
        estimated = self.settings if all_are_judged else join_settings(runs, simulated=self.is_simulated)
        object.__setattr__(self, "estimated", estimated)

    def of(self, processors: int) -> "DataLog":
        """Return the log with only what was measured with so many processors.

        Returns:
            The same log where all of it was; its `EnvironmentSetup` has that number.
        """
        own = tuple(record for record in self.recorded if self.processors_of(record.setting) == processors)
        if processors == self.header.setup.processors and len(own) == len(self.recorded):
            return self
        header = replace(self.header, setup=replace(self.header.setup, processors=processors))
        return DataLog(header=header, recorded=own, remeasurements=self.remeasurements, file=self.file)

    def processors_of(self, setting: Setting) -> int:
        """Return the virtual processors that P1 had at a setting of this log."""
        return setting.processors or self.header.setup.processors

    @property
    def is_simulated(self) -> bool:
        """Whether its samples were drawn from seeds."""
        return self.header.platform_facts.provider is ProviderKind.SIMULATED

    @property
    def counting(self) -> tuple[Recorded, ...]:
        """The settings that reservations use, each run by itself; those of the first pass are not among them."""
        return tuple(record for record in self.estimating if not record.setting.first_pass)

    @property
    def estimating(self) -> tuple[Recorded, ...]:
        """The same, and those of the first pass, which provisional reservations use.

        A setting that was measured while something else ran gives way to a later one of the same reservation that had
        the host to itself, and to every later pass that was measured so to its end.
        """
        clean = self._last_clean_remeasurement()
        return tuple(
            record for at, record in enumerate(self.recorded) if not (record.is_busy and self._gives_way(at, clean))
        )

    @property
    def highest_seed(self) -> int:
        """The last seed that anything was, or was to be, measured with; 0 where nothing was."""
        seeds = [
            *(record.setting.seed for record in self.recorded),
            *(remeasurement.seed for remeasurement in self.remeasurements),
        ]
        return max(seeds, default=0)

    def _gives_way(self, at: int, clean: int) -> bool:
        busy = self.recorded[at].setting
        later = self.recorded[at + 1 :]
        return busy.seed < clean or any(
            record.setting.reserve == busy.reserve
            and not record.is_busy
            and (busy.first_pass or not record.setting.first_pass)
            for record in later
        )

    def _last_clean_remeasurement(self) -> int:
        """Return the seed of the last pass that ended and had the host to itself; 0: there is none."""
        busy = {record.setting.seed for record in self.recorded if record.is_busy}
        return max(
            (
                remeasurement.seed
                for remeasurement in self.remeasurements
                if remeasurement.ended and remeasurement.seed not in busy
            ),
            default=0,
        )


@dataclass(frozen=True, slots=True, kw_only=True, weakref_slot=True)
class LogFile:
    """All records of a data log's file, each with the digest of its header."""

    headers: Mapping[str, Header]  # by digest, in the order of their lines
    recorded: tuple[tuple[str, Recorded], ...]
    remeasurements: tuple[tuple[str, Remeasurement], ...] = ()
    _logs: "WeakValueDictionary[Hashable, DataLog]" = field(
        default_factory=WeakValueDictionary, init=False, repr=False, compare=False
    )

    def log_of(self, header: Header, digests: Collection[str]) -> DataLog:
        """Return the settings measured under some of the headers; the same object as long as it is in use.

        Args:
            digests: Of the headers whose records count.
        """
        key = (header.digest, *sorted(digests))
        log = self._logs.get(key)
        if log is None:
            log = self._logs[key] = DataLog(
                header=header,
                recorded=tuple(record for digest, record in self.recorded if digest in digests),
                remeasurements=tuple(each for digest, each in self.remeasurements if digest in digests),
                file=self,
            )
        return log

    def last_measured(self, digest: str) -> str:
        """Return the time of a header's last record.

        Returns:
            UTC, as texts that sort by time; empty: it has no record.
        """
        times = [record.provenance.when for own, record in self.recorded if own == digest]
        times += [remeasurement.begun for own, remeasurement in self.remeasurements if own == digest]
        return max(times, default="")
