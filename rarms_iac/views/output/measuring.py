"""Measurements for programs: `rarms measure`, `prove`, `explain COMPONENT`, `select` and `report`."""

from dataclasses import dataclass
from typing import Literal

from rarms_iac.model.commands import Prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.views.output.common import Output


@dataclass(frozen=True, slots=True, kw_only=True)
class IndexOutput:
    """A performance index beside its threshold, in the index's own unit (ms, %, a second); null: cannot be told.

    The truth lies outside of `lower` and `upper` with the probability `error`; null: the samples say nothing there.
    """

    component: str
    index: str
    unit: str
    at_most: float | None
    at_least: float | None
    value: float | None
    lower: float | None
    upper: float | None
    error: float | None
    samples: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingOutput:
    """One reservation of P1 with what was measured there; `beside`: what P2 reserved.

    `disturbances` says what disturbed its tries on the host; a disturbed one is measured again, at most three times.
    """

    reserve: int
    beside: int
    seed: int
    indexes: tuple[IndexOutput, ...]
    disturbances: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentOutput:
    """Components measured together in one partition; `reserve` is null where none was found or looked for.

    `failed` is the highest lower setting that is not enough, or is `undecided`: within the noise. Those above it that
    reached no steady state are `inconclusive`: nobody knows whether they are enough.
    `planned` is what a plan reserves by the curve; it is `interpolated` where it lies between measured settings.
    """

    components: tuple[str, ...]
    host: str
    host_processors: int  # LPs
    platform: str
    processors: int  # VPs, whose per cent a reserve is
    interference: str
    log: str
    ending: Literal["found", "not_achievable", "not_resolved", "no_verdict", "swept", "stopped"]
    reserve: int | None
    reserved_processors: float | None  # LPs of that
    failed: int | None
    undecided: bool
    inconclusive: tuple[int, ...]
    error: float | None
    planned: int | None
    interpolated: bool
    settings: tuple[SettingOutput, ...]
    new_settings: int


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasureOutput(Output):
    """`rarms measure`; `not_begun`: components whose turn an early end left out."""

    kind: Literal["measure"] = "measure"
    experiments: tuple[ExperimentOutput, ...]
    not_begun: tuple[tuple[str, ...], ...]
    findings: tuple[Diagnostic, ...]


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
