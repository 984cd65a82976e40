"""The requests that use cases share: which manifest, which hosts and snapshots, how far a plan may go."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, date, datetime
from typing import TYPE_CHECKING

from rarms_iac.app.options import (
    Option,
    auto_approve_option,
    lock_timeout_option,
    option,
    read_day,
    read_host_name,
    read_time,
)
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.model.names import is_name
from rarms_iac.model.system import Disruption
from rarms_iac.model.wording import natural_order, quoted, suggestion

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
class ManifestFile:
    """Which manifest."""

    manifest: str = option(
        "-f",
        "--manifest",
        metavar="PATH",
        environment="RARMS_MANIFEST",
        help="The manifest: a file, or the folder of a rarms.yaml. RARMS_MANIFEST says it too. "
        "[default: rarms.yaml here, or above in the same git repository]",
        default=DEFAULT_MANIFEST,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ManifestSource(ManifestFile):
    """Which manifest with which overlays, and the day by which its acceptances are judged."""

    overlays: tuple[str, ...] = option(
        "--overlay", metavar="FILE", help="A file laid over the manifest; repeatable, later wins.", default=()
    )
    today: date = field(default_factory=today_utc)
    here: str = ""  # the host that is this machine, with any `connect`; empty: those without `connect`
    code: str = ""  # the folder of the components' files; empty: the manifest's


@dataclass(frozen=True, slots=True, kw_only=True)
class DatedManifestSource(ManifestSource):
    """A manifest, for a command that takes `--today`."""

    today: date = field(
        default_factory=today_utc,
        metadata={
            "option": Option(
                flags=("--today",),
                metavar="DATE",
                read=read_day,
                help="The day by which acceptances are judged, as 2026-01-31. [default: today in UTC]",
            )
        },
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SnapshotFile:
    """A file that stands for a host, or for the guest of one of its partitions.

    An empty host: the only one there is, or the one the file names.
    """

    host: str
    file: str
    guest: str = ""  # a partition

    @classmethod
    def parse(cls, text: str) -> "SnapshotFile":
        """Read what `--snapshot` takes.

        Args:
            text: `[HOST[.guest.PARTITION]=]FILE`.

        Returns:
            The file and what it stands for.

        Raises:
            ValueError: a host, and no file.
        """
        host, equals, file = text.partition("=")
        name, _, guest = host.partition(".guest.")
        if equals and is_name(name) and (not guest or is_name(guest)):
            if not file:
                raise ValueError(f"{quoted(text)} names no file: write {host}=FILE.")
            return cls(host=name, file=file, guest=guest)
        return cls(host="", file=text)


@dataclass(frozen=True, slots=True, kw_only=True)
class HostSelection:
    """Which hosts, live or written down.

    Raises:
        RequestError: two snapshots stand for one host, or for one guest.
    """

    hosts: tuple[str, ...] = option(
        "--host", metavar="NAME", read=read_host_name, help="Only this host; repeatable. [default: all]", default=()
    )
    snapshots: tuple[SnapshotFile, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "hosts", tuple(dict.fromkeys(self.hosts)))
        names = [f"{file.host}{file.guest and '.guest.'}{file.guest}" for file in self.snapshots if file.host]
        for name in names:
            if names.count(name) > 1:
                raise RequestError(f"{name} has more than one --snapshot.")


@dataclass(frozen=True, slots=True, kw_only=True)
class SnapshotSelection(HostSelection):
    """Hosts, for a command that takes snapshots in their place."""

    snapshots: tuple[SnapshotFile, ...] = option(
        "--snapshot",
        metavar="[HOST[.guest.PARTITION]=]FILE",
        read=SnapshotFile.parse,
        help="Look at this file instead of the host, as `rarms snapshot` or observe.ps1 wrote it; repeatable.",
        default=(),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanTargets:
    """What a plan is kept to."""

    targets: tuple[str, ...] = option(
        "--target",
        metavar="ADDRESS",
        help="Only this, as partition/vision or task/MotionControl; repeatable.",
        default=(),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanLimits(PlanTargets):
    """How far a plan may go."""

    max_disruption: Disruption | None = option(
        "--max-disruption", help="Hold back what disturbs more. [default: as the policy of the manifest says]"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """How a run of steps is begun."""

    auto_approve: bool = auto_approve_option()
    lock_timeout_ms: int = lock_timeout_option()
    event_timeout_ms: int = option(
        "--event-timeout",
        metavar="TIME",
        read=read_time,
        help="Wait so long for the next word of a Hyper-V host's script. [default: 10 min]",
        default=SILENCE_MS,
    )
    out: str | None = None  # only write the plan into this file; None: do it

    @property
    def waits(self) -> "WaitLimits":
        """How long a run waits for a host, and for a word from it."""
        from rarms_iac.providers.interface import WaitLimits  # a command that only reads does without

        return WaitLimits(lock_ms=self.lock_timeout_ms, silence_ms=self.event_timeout_ms)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanRunOptions(RunOptions):
    """How a run goes, for a command that makes its plan itself."""

    out: str | None = option("--out", metavar="FILE", help="Only write the plan file, for `rarms apply FILE`.")


def refuse_unknown(names: Sequence[str], existing: Mapping[str, object], kind: str) -> None:
    """Refuse names that are not in the manifest.

    Args:
        existing: What the manifest has of that kind, by name.
        kind: What messages call it: `component`, `interference`.

    Raises:
        RequestError: One of them is not there; the message offers the nearest.
    """
    for name in names:
        if name not in existing:
            raise RequestError(
                f"The manifest has no {kind} {quoted(name)}.{suggestion(name, tuple(existing))} "
                f"It has: {', '.join(sorted(existing, key=natural_order)) or 'none'}."
            )
