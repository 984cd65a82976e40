"""What was measured, and what a layout showed: `rarms measure` and `prove`."""

from dataclasses import dataclass
from typing import Literal

from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.views.output.common import FORMAT_VERSION, Format


@dataclass(frozen=True, slots=True, kw_only=True)
class IndexOutput:
    """A performance index beside its threshold, in the index's own unit (ms, %, a second); null: cannot be told.

    The truth lies outside of `lower` and `upper` with the probability `error`; null: the samples say nothing there.
    """

    component: str
    index: str
    at_most: float | None
    at_least: float | None
    value: float | None
    lower: float | None
    upper: float | None
    error: float | None
    samples: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingOutput:
    """One reservation of P1 with what was measured there; `beside`: what P2 reserved."""

    reserve: int
    beside: int
    seed: int
    indexes: tuple[IndexOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentOutput:
    """Components measured together in one partition; `reserve` is null where none was found or looked for.

    `failed` is the highest lower setting that is not enough, or is `undecided`: within the noise. Those above it that
    reached no steady state are `untold`: nobody knows whether they are enough.
    `planned` is what a plan reserves by the curve; it is `interpolated` where it lies between measured settings.
    """

    components: tuple[str, ...]
    host: str
    platform: str
    interference: str
    log: str
    ending: Literal["found", "not_achievable", "not_resolved", "no_verdict", "swept", "stopped"]
    reserve: int | None
    failed: int | None
    undecided: bool
    untold: tuple[int, ...]
    error: float | None
    planned: int | None
    interpolated: bool
    settings: tuple[SettingOutput, ...]
    new_settings: int


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasureOutput:
    """`rarms measure`; `not_begun`: components whose turn an early end left out."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["measure"] = "measure"
    experiments: tuple[ExperimentOutput, ...]
    not_begun: tuple[tuple[str, ...], ...]
    findings: tuple[Diagnostic, ...]


ProvenVerdict = Literal["met", "missed", "within the noise", "no steady state", "cannot be told"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ProvenIndexOutput(IndexOutput):
    """A performance index that was seen in the layout, with the verdict on it.

    The verdict is wrong with the probability `verdict_error`; null: none could be given, and `why` may say the reason.
    """

    host: str
    verdict: ProvenVerdict
    verdict_error: float | None
    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ProveOutput:
    """`rarms prove`: every component in the applied layout; `met`: each index was shown to meet its threshold."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["prove"] = "prove"
    interference: str | None
    met: bool
    indexes: tuple[ProvenIndexOutput, ...]
    findings: tuple[Diagnostic, ...]
