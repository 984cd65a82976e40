"""How a component comes to what it gets: `rarms explain COMPONENT` and `rarms select`."""

from dataclasses import dataclass
from typing import Literal

from rarms_iac.views.output.common import FORMAT_VERSION, Format


@dataclass(frozen=True, slots=True, kw_only=True)
class WalkStepOutput:
    """A step from the APT to the per cent: what it is about, and its sentences."""

    topic: str
    says: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class WalkOutput:
    """`rarms explain COMPONENT`. `cr` is per cent of P1's virtual processors, null where nothing was looked up.

    What is reserved is null where nothing says how much; a component that runs on the host itself has steps only.
    """

    format_version: Format = FORMAT_VERSION
    kind: Literal["walk"] = "walk"
    component: str
    partition: str | None
    host: str | None
    fits: bool  # false: there is no layout, and the host is where it runs, or the first by name that could have it
    data_log: str | None
    cr: int | None
    interpolated: bool
    wanted_processors: float | None  # LPs before rounding to the provider's grain
    reserved_processors: float | None  # LPs after it
    reserve: int | None  # whole per cent of each virtual processor
    processors: int | None
    limit: int | None
    weight: int | None
    steps: tuple[WalkStepOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelOutput:
    """What a partition gets on a platform, in per cent of each of its processors; the index there with its band."""

    platform: str
    partition: str
    reserve: int
    processors: int
    interpolated: bool
    value: float | None
    lower: float | None
    upper: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadroomOutput:
    """What a host has left, in logical processors."""

    host: str
    processors: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SelectionOutput:
    """`rarms select`: an APT that was chosen, in the index's own unit (ms, %, /s), and what follows from it."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["selection"] = "selection"
    component: str
    index: str
    before: float | None
    after: float
    file: str
    written: bool
    levels: tuple[LevelOutput, ...]
    headrooms: tuple[HeadroomOutput, ...]
    fits: bool
