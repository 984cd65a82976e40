"""The difference between what is wanted and what is there."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Literal, cast

from rarms_iac.model.diagnostics import Place
from rarms_iac.model.facets import FACETS, MAYBE_OFF, WHILE_OFF, differing, setting_values
from rarms_iac.model.output import Internal, OutputText, output
from rarms_iac.model.quantities import guaranteed
from rarms_iac.model.state import Partition, Responsiveness, TaskClass
from rarms_iac.model.system import Disruption

Resource = Partition | TaskClass | Responsiveness

SLASH = "\\"
"""Between the folders of a host's path."""


@dataclass(frozen=True, slots=True, kw_only=True, order=True)
class Address(OutputText):
    """The resource of a change: `partition/vision`, `task/MotionControl`, `partition/vision/task/MotionControl`.

    SystemResponsiveness of the host itself is at `mmcss/responsiveness`.
    A step may also be about a partition's disk: `partition/vision/disk/vision-0123456789ab.vhdx`.
    """

    partition: str = ""
    task: str = ""
    disk: str = ""  # path of its file on the host
    machine: str = field(default="", compare=False)  # id, where the mark does not say it: import and release
    responsiveness: bool = False  # SystemResponsiveness of the host itself; then there is no partition and no task

    @property
    def is_in_guest(self) -> bool:
        """Whether it is a task class inside a partition."""
        return bool(self.partition and self.task)

    def __str__(self) -> str:
        """Write the address as findings, plans and `--target` do."""
        return f"partition/{self.in_short}" if self.partition else self.in_short

    @property
    def in_short(self) -> str:
        """The address without the word `partition`, for lists of partitions."""
        if self.responsiveness:
            return "mmcss/responsiveness"
        parts = [self.partition] if self.partition else []
        below = [f"task/{self.task}"] if self.task else []
        below += [f"disk/{self.disk.replace('/', SLASH).rpartition(SLASH)[2]}"] if self.disk else []
        return "/".join([*parts, *below])


RESPONSIVENESS = Address(responsiveness=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reason:
    """The reason for a change, for people; no code decides by it."""

    message: str
    place: Place | None = None  # the manifest line that asks for it


Value = bool | int | str | None
Forced = Literal["", "restart", "replacement"]
Action = Literal["create", "update", "replace", "delete", "adopt", "release"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Attribute:
    """An attribute that a change touches, in the provider's units; None: the resource is not there.

    A registry value is a text that says its type: `dword:5`.
    """

    name: str
    before: Value
    after: Value
    forces: Forced  # what touching it makes happen that the other attributes would not


class _AnyChange:
    """Base of the changes: their action, reservation and attributes."""

    __slots__ = ()

    @output
    def action(self) -> Action:
        """What becomes of the resource; `replace`: it is removed and made again."""
        change = cast("Change", self)
        return "replace" if change.kind == "update" and change.disruption is Disruption.REMOVAL else change.kind

    @output
    def reserved_lp(self) -> Fraction | None:
        """The LPs that a partition is guaranteed once the change is done; None: no partition then."""
        after = cast("Change", self).after
        return guaranteed(after.settings.reserve, after.settings.processors) if isinstance(after, Partition) else None

    @output
    def attributes(self) -> tuple[Attribute, ...]:
        """What it touches; of taking over and letting go, the mark."""
        change = cast("Change", self)
        if isinstance(change, Adopt | Release):
            before: Mapping[str, Value] = {"mark": _mark(change.before)}
            after: Mapping[str, Value] = {"mark": _mark(change.after)}
        else:
            before, after = _values(change.before), _values(change.after)
        return tuple(
            Attribute(name=name, before=before.get(name), after=after.get(name), forces=_forced_by(change, name))
            for name in dict.fromkeys([*before, *after])
            if before.get(name) != after.get(name)
        )


def _mark(partition: Partition) -> Value:
    return f"{partition.mark.application}/{partition.mark.name}" if partition.mark else None


def _values(resource: Resource | None) -> Mapping[str, Value]:
    match resource:
        case None:
            return {}
        case Partition(settings=settings):
            return setting_values(settings)
        case TaskClass(values=registry) | Responsiveness(values=registry):
            return {name: f"{value.kind.value}:{value.data}" for name, value in sorted(registry.items())}


def _forced_by(change: "Change", name: str) -> Forced:
    old, new = change.before, change.after
    if not (isinstance(change, Update) and isinstance(old, Partition) and isinstance(new, Partition)):
        return ""
    if name == "generation":
        return "replacement"
    if change.disruption is not Disruption.PARTITION_STOP or not new.settings.running:
        return ""
    # NOTE: memory may change live (windows.md 3); if another setting changes too, only that is known to need the stop.
    stopping = {each for facet in FACETS for each in differing(facet, old.settings, new.settings)} & WHILE_OFF
    return "restart" if name in (stopping or MAYBE_OFF) else ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Create(_AnyChange):
    """A resource that is wanted and not there."""

    address: Address
    after: Internal[Resource]
    reason: Reason
    disruption: Disruption = Disruption.LIVE
    kind: Internal[Literal["create"]] = "create"

    @property
    def before(self) -> None:
        """Nothing is there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Update(_AnyChange):
    """A resource that exists but differs from what the manifest wants."""

    address: Address
    before: Internal[Resource]
    after: Internal[Resource]
    reason: Reason
    disruption: Disruption
    kind: Internal[Literal["update"]] = "update"


@dataclass(frozen=True, slots=True, kw_only=True)
class Delete(_AnyChange):
    """A resource of ours that is to go. A task class goes back to what was there before us."""

    address: Address
    before: Internal[Resource]
    reason: Reason
    disruption: Disruption
    kind: Internal[Literal["delete"]] = "delete"

    @property
    def after(self) -> None:
        """Nothing stays."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Adopt(_AnyChange):
    """An unmanaged partition that becomes ours: a mark, and no other change."""

    address: Address
    before: Internal[Partition]
    after: Internal[Partition]
    reason: Reason
    disruption: Disruption = Disruption.LIVE
    kind: Internal[Literal["adopt"]] = "adopt"


@dataclass(frozen=True, slots=True, kw_only=True)
class Release(_AnyChange):
    """A partition of ours that goes on without us: the mark goes, the machine stays."""

    address: Address
    before: Internal[Partition]
    after: Internal[Partition]
    reason: Reason
    disruption: Disruption = Disruption.LIVE
    kind: Internal[Literal["release"]] = "release"


Change = Create | Update | Delete | Adopt | Release

_COUNT_NAMES = {
    "create": ("add",),
    "update": ("change",),
    "replace": ("add", "remove"),
    "delete": ("remove",),
    "adopt": ("adopt",),
    "release": ("release",),
}


def count(changes: Iterable[Change]) -> dict[str, int]:
    """Count changes: add, change, remove, adopt, release.

    Returns:
        All five numbers; a replacement counts as removed and as added.
    """
    numbers = Counter(name for change in changes for name in _COUNT_NAMES[change.action])
    return {name: numbers[name] for name in ("add", "change", "remove", "adopt", "release")}
