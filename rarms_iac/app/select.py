"""Choosing a level of performance: an APT, what reservation follows from it, and the edit of the manifest."""

from dataclasses import dataclass
from fractions import Fraction

from rarms_iac.model.system import Threshold


@dataclass(frozen=True, slots=True, kw_only=True)
class SelectedLevel:
    """What a partition gets on a platform, so that the level holds there."""

    platform: str
    partition: str
    reserve: int  # whole per cent of each virtual processor
    processors: int  # virtual ones
    host: str  # the first of the platform
    host_processors: int
    interpolated: bool
    expected: tuple[float, float, float] | None  # the index there, and its band; None: not measured there


@dataclass(frozen=True, slots=True, kw_only=True)
class HostHeadroom:
    """What a host has left, once every partition has its reservation; less than nothing: it does not fit."""

    host: str
    processors: Fraction
    host_processors: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """A level that was chosen, and what follows."""

    component: str
    index: str
    before: Threshold | None
    after: Threshold
    levels: tuple[SelectedLevel, ...]  # by platform
    rests_on_a_log: bool  # else the manifest fixes the reserve
    headrooms: tuple[HostHeadroom, ...]  # none where there is no layout
    why_no_headroom: str
