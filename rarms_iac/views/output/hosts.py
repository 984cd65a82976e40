"""What hosts are like (`rarms drift`, `doctor`), how runs ended (`apply`, `undo`), what components showed (`run`)."""

from dataclasses import dataclass
from typing import Literal

from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.outcomes import VerdictWord
from rarms_iac.views.output.common import Output


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleOutput:
    """What one job showed; a failed sample says why in `failure`, which is empty otherwise."""

    began_ms: float
    response_ms: float | None
    successful: bool
    count: float
    failure: str


@dataclass(frozen=True, slots=True, kw_only=True)
class IndexResultOutput:
    """A performance index beside its APT; null where the samples or the manifest do not say."""

    index: str
    unit: str
    value: float | None
    lower: float | None
    upper: float | None
    at_most: float | None
    at_least: float | None
    verdict: VerdictWord | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentResultOutput:
    """A component that was run on this machine."""

    component: str
    ending: str  # until, failures or closed
    elapsed_ms: float
    cpu_ms: float | None
    failed: int
    indexes: tuple[IndexResultOutput, ...]
    samples: tuple[SampleOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentRunOutput(Output):
    """`rarms run`: what each component showed, without any reservation."""

    kind: Literal["component_run"] = "component_run"
    components: tuple[ComponentResultOutput, ...]
    findings: tuple[Diagnostic, ...]
