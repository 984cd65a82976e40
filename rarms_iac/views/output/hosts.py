"""What hosts are like (`rarms drift`, `doctor`), how runs ended (`apply`, `undo`), what components showed (`run`)."""

from dataclasses import dataclass
from typing import Literal

from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.outcomes import VerdictWord
from rarms_iac.views.output.common import Output


@dataclass(frozen=True, slots=True, kw_only=True)
class PartitionRunOutput:
    """A partition that an apply made or changed, as it is planned to be."""

    name: str
    components: tuple[str, ...]  # the most critical first
    reserved_processors: float  # LPs that it is guaranteed


@dataclass(frozen=True, slots=True, kw_only=True)
class HostRunOutput:
    """What a run did on one host; what concerns its plan is empty or null for an undo."""

    host: str
    plan: str
    run: Literal["apply", "undo"]
    ending: str
    changed: int
    unchanged: int
    total: int
    resumed: bool
    addresses: tuple[str, ...]  # of the resources that an apply changes
    partitions: tuple[PartitionRunOutput, ...]
    host_processors: int | None  # LPs
    reserved_processors: float | None  # LPs of these that are reserved once all is done


@dataclass(frozen=True, slots=True, kw_only=True)
class StepEndedOutput(Output):
    """`rarms apply`, `undo`: a step that ended, on a line of its own as soon as it did."""

    kind: Literal["step"] = "step"
    host: str
    number: int  # from 1
    total: int
    address: str
    title: str
    status: Literal["changed", "unchanged"]


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOutput(Output):
    """`rarms apply`, `undo`: how a run ended; the last line, after those of its steps."""

    kind: Literal["run"] = "run"
    ending: Literal["done", "nothing", "refused", "failed", "interrupted"]
    hosts: tuple[HostRunOutput, ...]
    findings: tuple[Diagnostic, ...]


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
