"""The requests that use cases share: which manifest, which hosts and snapshots, how far a plan may go."""

from dataclasses import dataclass
from datetime import UTC, date, datetime
from typing import TYPE_CHECKING

from rarms_iac.model.system import Disruption

if TYPE_CHECKING:
    from rarms_iac.providers.interface import WaitLimits

DEFAULT_MANIFEST = "rarms.yaml"
SILENCE_MS = 600_000
"""How long the next word of a host's script is waited for, unless it is said."""


def today_utc() -> date:
    """Return the day it is now.

    Returns:
        The date in UTC. No layer below `app` asks the clock for it: they are given the day.
    """
    return datetime.now(UTC).date()


@dataclass(frozen=True, slots=True, kw_only=True)
class ManifestSource:
    """Which manifest, and the day by which its acceptances are judged."""

    manifest: str = DEFAULT_MANIFEST  # file, folder, or `-`; as given
    overlays: tuple[str, ...] = ()
    today: date


@dataclass(frozen=True, slots=True, kw_only=True)
class SnapshotFile:
    """A file that stands for a host, or for the guest of one of its partitions.

    An empty host: the only one there is, or the one the file names.
    """

    host: str
    file: str
    guest: str = ""  # a partition


@dataclass(frozen=True, slots=True, kw_only=True)
class HostSelection:
    """Which hosts, live or written down."""

    hosts: tuple[str, ...] = ()  # none: all
    snapshots: tuple[SnapshotFile, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanLimits:
    """How far a plan may go."""

    targets: tuple[str, ...] = ()  # addresses: partition/vision
    max_disruption: Disruption | None = None  # None: as the policy says


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """How a run of steps is begun."""

    auto_approve: bool = False
    lock_timeout_ms: int = 0
    event_timeout_ms: int = SILENCE_MS
    out: str | None = None  # only write the plan into this file; None: do it

    @property
    def waits(self) -> "WaitLimits":
        """How long a run waits for a host, and for a word from it."""
        from rarms_iac.providers.interface import WaitLimits  # a command that only reads does without

        return WaitLimits(lock_ms=self.lock_timeout_ms, silence_ms=self.event_timeout_ms)
