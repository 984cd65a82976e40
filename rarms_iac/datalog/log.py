"""What a data log says: its header, and a setting a line with where it comes from."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from rarms_iac.model.measurement import Bench, EnvironmentSetup, Setting

FORMAT = "rarms-datalog/1"


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """Everything that can change the PI, by name: `vision.run.until.samples`, `file components/vision.py`.

    Two logs with equal parts say the same thing; a part that differs tells what changed.
    """

    parts: Mapping[str, str]
    interpreters: Mapping[str, str] = field(default_factory=dict)  # programs outside the manifest's folder; only warn


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """The first line of a data log: what all its settings have in common."""

    platform: str
    digest: str  # of the identity's parts
    identity: Identity
    bench: Bench
    setup: EnvironmentSetup
    format_version: str = FORMAT


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Where a setting comes from."""

    rarms_version: str
    when: str  # UTC, as 2027-01-31T12:00:00Z
    beside: tuple[str, ...] = ()  # partitions that ran on the host meanwhile, which was overridden


@dataclass(frozen=True, slots=True, kw_only=True)
class Recorded:
    """A measured setting with where it comes from."""

    setting: Setting
    provenance: Provenance


@dataclass(frozen=True, slots=True, kw_only=True)
class DataLog:
    """All that was measured of components in one partition, against one interfering load, on one platform."""

    header: Header
    recorded: tuple[Recorded, ...]  # in the order in which they were measured

    @property
    def settings(self) -> tuple[Setting, ...]:
        """The settings alone; a reservation may be there more than once."""
        return tuple(one.setting for one in self.recorded)
