"""What hosts are like (`rarms drift`, `doctor`), how runs ended (`apply`, `undo`), what components showed (`run`)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.views.output.common import Output
from rarms_iac.views.output.plan import AttributeOutput


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftedResourceOutput:
    """One address that is not as it should be; `before` of an attribute is what is there."""

    host: str
    address: str
    components: tuple[str, ...]  # of the partition, the most critical first; empty where the layout has no such one
    wanted_processors: float | None  # LPs that the manifest wants for it; null: nothing of that would change
    drift: Literal["host_changed", "not_applied", "both", "missing", "removed", "unused"]
    message: str
    attributes: tuple[AttributeOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftedHostOutput:
    """How many resources of a host differ, and how: changed there, not applied yet, or unused by the manifest."""

    name: str
    host_processors: int
    host_changed: int
    not_applied: int
    unused: int


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftOutput(Output):
    """`rarms drift`."""

    kind: Literal["drift"] = "drift"
    application: str
    compared: bool  # with the manifest; false: it has no layout, and only what was changed on the hosts is told
    hosts: tuple[DriftedHostOutput, ...]  # all that were looked at
    drifted: tuple[DriftedResourceOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExaminedHostOutput:
    """What `rarms doctor` looked at; null where it could not be read. `os_build` is 0 where there is no Windows."""

    name: str
    provider: str
    computer: str
    os_build: int
    client: bool
    scheduler: Literal["classic", "core", "root", "unknown", "none"]
    logical_processors: int
    seen_processors: int | None
    smt: bool
    memory: int
    memory_available: int | None
    rights: Literal["proven", "missing", "unknown"]
    powershell: str | None
    module: tuple[str, ...] | None
    machines: int
    managed: int
    running: int
    findings: tuple[Diagnostic, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class DoctorOutput(Output):
    """`rarms doctor`: what makes a plan ineffective or unsafe on each host."""

    kind: Literal["doctor"] = "doctor"
    application: str
    hosts: tuple[ExaminedHostOutput, ...]
    accepted: tuple[Diagnostic, ...]
    counts: Mapping[str, int]


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
    met: bool | None


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


@dataclass(frozen=True, slots=True, kw_only=True)
class PastRunOutput:
    """A run on a host."""

    host: str
    run: Literal["apply", "undo"]
    plan: str
    application: str
    started_by: str
    started_at: str  # `2026-01-31 12:00:00 UTC`; empty: an older rarms wrote it
    ending: Literal["done", "abandoned", "unfinished"]


@dataclass(frozen=True, slots=True, kw_only=True)
class HistoryOutput(Output):
    """`rarms history`: the oldest run of each host first."""

    kind: Literal["history"] = "history"
    application: str
    runs: tuple[PastRunOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PartitionStatusOutput:
    """A partition that is on a host; its `drift` is `none` where it is as applied and as wanted."""

    name: str
    components: tuple[str, ...]
    reserve: int  # per cent of each of its virtual processors
    processors: int
    reserved: float  # LPs
    running: bool
    stopped_by: Literal["", "stopped", "measuring"]
    drift: Literal["none", "host_changed", "not_applied", "both", "missing", "removed", "unused"]


@dataclass(frozen=True, slots=True, kw_only=True)
class HostStatusOutput:
    """A host; where there are problems it could not be looked at, and nothing else is known."""

    host: str
    capacity: float  # LPs that may be promised
    reserved: float  # LPs
    unmanaged: float  # LPs that machines of others reserve
    partitions: tuple[PartitionStatusOutput, ...]
    not_there: tuple[str, ...]  # addresses that are wanted and not as they should be, or task classes that drifted
    last_run: PastRunOutput | None
    problems: tuple[Diagnostic, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ThresholdStatusOutput:
    """What a component showed last when all ran together; outdated where there are reasons."""

    component: str
    index: str
    unit: str | None
    threshold: str
    value: float | None
    met: bool
    verdict: str
    outdated: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class StatusOutput(Output):
    """`rarms status`."""

    kind: Literal["status"] = "status"
    application: str
    hosts: tuple[HostStatusOutput, ...]
    proofs: tuple[ThresholdStatusOutput, ...]
    stale: Mapping[str, tuple[str, ...]]  # data log -> what changed since
    unmeasured: tuple[tuple[str, ...], ...]
    next_command: str | None  # null: nothing is left to do
