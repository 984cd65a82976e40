"""Measurements for programs: `rarms measure`, `prove`, `explain COMPONENT`, `select` and `report`."""

from dataclasses import dataclass
from typing import Literal

from rarms_iac.model.commands import Prose
from rarms_iac.views.output.common import Output


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplanationStepOutput:
    """A step from the APT to the per cent: what it is about, and its sentences."""

    topic: str
    sentences: tuple[Prose, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentExplanationOutput(Output):
    """`rarms explain COMPONENT`. `cr` is per cent of P1's virtual processors, null where nothing was looked up.

    What is reserved is null where nothing says how much; a component that runs on the host itself has steps only.
    """

    kind: Literal["walk"] = "walk"
    component: str
    partition: str | None = None
    host: str | None = None
    fits: bool = True  # false: there is no layout; the host is where it runs, or the first by name that could have it
    data_log: str | None = None
    cr: int | None = None
    interpolated: bool = False
    wanted_processors: float | None = None  # LPs before rounding to the provider's grain
    reserved_processors: float | None = None  # LPs after it
    reserve: int | None = None  # whole per cent of each virtual processor
    processors: int | None = None
    limit: int | None = None
    weight: int | None = None
    steps: tuple[ExplanationStepOutput, ...]
