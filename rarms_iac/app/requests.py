"""The requests that use cases share, and how their fields appear at the command line. No click here.

`option`, `flag` and `argument` make the fields of a request that the command line asks for; their names and types are
the dataclass's own. Readers of values raise ValueError with a sentence for people.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import MISSING, dataclass, field
from datetime import UTC, date, datetime
from functools import partial
from typing import TYPE_CHECKING, Any

from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.model.names import is_name
from rarms_iac.model.quantities import NotAQuantity, Unit, parse_quantity
from rarms_iac.model.system import Disruption
from rarms_iac.texts.messages import natural_order, quoted, suggestion

if TYPE_CHECKING:
    from rarms_iac.providers.interface import WaitLimits


Reader = Callable[[str], object]


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """An option, or without `flags` an argument, of every command that takes the request."""

    flags: tuple[str, ...] = ()
    help: str = ""
    metavar: str | None = None
    read: Reader | None = None  # None: as the field's type says
    least: int | None = None  # of a whole number
    most: int | None = None
    environment: str | None = None  # a variable that gives it, too


def option(
    *flags: str,
    help: str,  # noqa: A002 - the word of every command line
    default: object = None,
    required: bool = False,
    metavar: str | None = None,
    read: Reader | None = None,
    least: int | None = None,
    most: int | None = None,
    environment: str | None = None,
) -> Any:
    """Make a dataclass's field that is an option.

    Args:
        help: what it is for, in the `--help` of each command that takes the request.
        required: the command line has to give it, without a default.
        metavar: what stands for the value in the help; None: click's own word.
        read: makes the value of a word; None: as the field's type says.
        environment: a variable that gives it, too.

    Returns:
        The field, as `dataclasses.field` makes it.
    """
    described = Option(
        flags=flags, help=help, metavar=metavar, read=read, least=least, most=most, environment=environment
    )
    return field(default=MISSING if required else default, metadata={"option": described})


def flag(name: str, *, help: str) -> Any:  # noqa: A002 - as above
    """Make a dataclass's field that is False unless the option is given.

    Returns:
        The field, as `dataclasses.field` makes it.
    """
    return option(name, help=help, default=False)


def argument(metavar: str | None = None, *, default: object = MISSING) -> Any:
    """Make a dataclass's field that is an argument; a tuple takes any number.

    Args:
        metavar: what stands for it in the help; None: its name.
        default: of the field; without one the command line has to give it.

    Returns:
        The field, as `dataclasses.field` makes it.
    """
    return field(default=default, metadata={"option": Option(metavar=metavar)})


def read_time(text: str) -> int:
    """Read a time.

    Args:
        text: as `60s`, with its unit.

    Returns:
        Whole milliseconds.

    Raises:
        ValueError: it is none.
    """
    try:
        return int(parse_quantity(text, Unit.TIME)[1])
    except NotAQuantity as error:
        comma = " The decimal separator is a point." if "," in text else ""
        raise ValueError(
            f"{quoted(text)} is not a time such as 60s. Units: {', '.join(error.units)}.{comma}"
        ) from error


def read_percent(text: str) -> int:
    """Read a whole per cent from 1 to 100.

    Args:
        text: as `10%` or `10 %`.

    Returns:
        The number.

    Raises:
        ValueError: it is none.
    """
    try:
        value = parse_quantity(text, Unit.SHARE)[1]
    except NotAQuantity:
        value = None
    if value is None or value.denominator != 1 or not 1 <= value <= 100:
        raise ValueError(
            f"{quoted(text)} is not a whole per cent from 1% to 100%. Write it with the sign, such as 10%."
        )
    return int(value)


def read_day(text: str) -> date:
    """Read a day.

    Returns:
        The day.

    Raises:
        ValueError: it is none.
    """
    try:
        return date.fromisoformat(text)
    except ValueError as error:
        raise ValueError(f"{quoted(text)} is not a day such as 2026-01-31.") from error


def read_host_name(text: str) -> str:
    """Read the name of a host.

    Returns:
        The same.

    Raises:
        ValueError: it is none.
    """
    if not is_name(text):
        raise ValueError(f"{quoted(text)} cannot be the name of a host.")
    return text


lock_timeout_option = partial(
    option,
    "--lock-timeout",
    default=0,
    metavar="TIME",
    read=read_time,
    help="Wait this long for a host that another run has locked: 60s, 5min. [default: do not wait]",
)
auto_approve_option = partial(flag, "--auto-approve", help="Do not ask for confirmation.")
samples_option = partial(
    option,
    "--samples",
    least=2,
    help=(
        "Take at least this many samples of each component in a setting; with --from or --strategy "
        "paper, exactly this many. [default: `run.until`]"
    ),
)
busy_host_option = partial(flag, "--on-busy-host", help="Measure even if something else runs; the data logs record it.")
STOP_PARTITIONS = Option(
    flags=("--stop-partitions",), help="Stop the application's own partitions while measuring, then start them again."
)
"""Whether partitions may be stopped to measure: no field of a request, as a terminal and a page ask each their way."""

verbose_option = partial(option, "--verbose", "-v", default=False, help="Also show every attribute, reason and step.")
load_host_option = partial(
    flag, "--load-host", help="Allow full load on the hosts; required if standard input is not a terminal."
)


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
    """The choice of a manifest."""

    manifest: str = option(
        "-f",
        "--manifest",
        metavar="PATH",
        environment="RARMS_MANIFEST",
        help=(
            "The manifest: a file, or a folder with a rarms.yaml. [environment: RARMS_MANIFEST; default: "
            "rarms.yaml here, or in a parent folder of the same git repository]"
        ),
        default=DEFAULT_MANIFEST,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ManifestSource(ManifestFile):
    """The choice of a manifest and its overlays, and the day by which its acceptances are judged."""

    overlays: tuple[str, ...] = option(
        "--overlay",
        metavar="FILE",
        help="An overlay file with changes to the manifest; repeatable, the last one has priority.",
        default=(),
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
                help="The date for the end of acceptances, such as 2026-01-31. [default: today in UTC]",
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

        Returns:
            The file and what it stands for.

        Raises:
            ValueError: a host, and no file.
        """
        host, equals, file = text.partition("=")
        name, _, guest = host.partition(".guest.")
        if equals and is_name(name) and (not guest or is_name(guest)):
            if not file:
                raise ValueError(f"{quoted(text)} does not have a file: write {host}=FILE.")
            return cls(host=name, file=file, guest=guest)
        return cls(host="", file=text)


@dataclass(frozen=True, slots=True, kw_only=True)
class HostSelection:
    """The choice of hosts, live or as snapshots.

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
        help="Use this file of `rarms snapshot` or observe.ps1 instead of the host; repeatable.",
        default=(),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanTargets:
    """The resources that a plan is kept to."""

    targets: tuple[str, ...] = option(
        "--target",
        metavar="ADDRESS",
        help="Only this address, such as partition/vision or task/MotionControl; repeatable.",
        default=(),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanLimits(PlanTargets):
    """The limits of a plan: its resources, and its disruption."""

    max_disruption: Disruption | None = option(
        "--max-disruption", help="Hold back changes that disrupt more than this. [default: `policy.max_disruption`]"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """Options for the start of a run."""

    auto_approve: bool = auto_approve_option()
    lock_timeout_ms: int = lock_timeout_option()
    event_timeout_ms: int = option(
        "--event-timeout",
        metavar="TIME",
        read=read_time,
        help="Wait this long for the next output of a script on a Hyper-V host. [default: 10 min]",
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
    """Options of a run, for a command that makes its plan itself."""

    out: str | None = option("--out", metavar="FILE", help="Only write the plan file, for `rarms apply FILE`.")


def refuse_unknown(names: Sequence[str], existing: Collection[str], kind: str, whose: str = "The manifest") -> None:
    """Refuse names that are not there.

    Args:
        existing: What the manifest has of that kind, by name.
        kind: What messages call it: `component`, `interference`.

    Raises:
        RequestError: One of them is not there; the message offers the nearest.
    """
    for name in names:
        if name not in existing:
            raise RequestError(
                f"{whose} does not have the {kind} {quoted(name)}.{suggestion(name, tuple(existing))} It has: "
                f"{', '.join(sorted(existing, key=natural_order)) or 'none'}."
            )
