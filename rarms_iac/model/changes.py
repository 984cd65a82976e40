"""The difference between what is wanted and what is there."""

from dataclasses import dataclass, field
from typing import Literal

from rarms_iac.model.diagnostics import Place
from rarms_iac.model.state import Partition, Responsiveness, TaskClass
from rarms_iac.model.system import Disruption

Resource = Partition | TaskClass | Responsiveness

SLASH = "\\"
"""Between the folders of a host's path."""


@dataclass(frozen=True, slots=True, kw_only=True, order=True)
class Address:
    """What a change is about: `partition/vision`, `task/MotionControl`, `partition/vision/task/MotionControl`.

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
        """As findings, plans and `--target` write it."""
        if self.responsiveness:
            return "mmcss/responsiveness"
        parts = [f"partition/{self.partition}"] if self.partition else []
        below = [f"task/{self.task}"] if self.task else []
        below += [f"disk/{self.disk.replace('/', SLASH).rpartition(SLASH)[2]}"] if self.disk else []
        return "/".join([*parts, *below])


RESPONSIVENESS = Address(responsiveness=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reason:
    """Why a change is wanted, told to people; no code decides by it."""

    message: str = field(metadata={"formerly": "says"})
    place: Place | None = None  # the manifest line that asks for it


@dataclass(frozen=True, slots=True, kw_only=True)
class Create:
    """A resource that is wanted and not there."""

    address: Address
    after: Resource
    reason: Reason
    disruption: Disruption = Disruption.LIVE
    kind: Literal["create"] = "create"


@dataclass(frozen=True, slots=True, kw_only=True)
class Update:
    """A resource that exists but differs from what the manifest wants."""

    address: Address
    before: Resource
    after: Resource
    reason: Reason
    disruption: Disruption
    kind: Literal["update"] = "update"


@dataclass(frozen=True, slots=True, kw_only=True)
class Delete:
    """A resource of ours that is to go. A task class goes back to what was there before us."""

    address: Address
    before: Resource
    reason: Reason
    disruption: Disruption
    kind: Literal["delete"] = "delete"


@dataclass(frozen=True, slots=True, kw_only=True)
class Adopt:
    """An unmanaged partition that becomes ours: a mark, and no other change."""

    address: Address
    before: Partition
    after: Partition
    reason: Reason
    disruption: Disruption = Disruption.LIVE
    kind: Literal["adopt"] = "adopt"


@dataclass(frozen=True, slots=True, kw_only=True)
class Release:
    """A partition of ours that goes on without us: the mark goes, the machine stays."""

    address: Address
    before: Partition
    after: Partition
    reason: Reason
    disruption: Disruption = Disruption.LIVE
    kind: Literal["release"] = "release"


Change = Create | Update | Delete | Adopt | Release
