"""The one machine-readable form of what rarms says: `schemas/output.json` is made from these types.

Within `rarms-output/1` fields and kinds may be added; none changes its meaning or goes. Amounts are plain numbers:
memory in bytes, reserve and limit in whole per cent of each virtual processor.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.views.output_combining import AskedOutput, CombinedOutput
from rarms_iac.views.output_report import ReportCapacityOutput, ReportMeasurementOutput

Format = Literal["rarms-output/1"]
FORMAT_VERSION: Format = "rarms-output/1"

Value = bool | int | str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class AttributeOutput:
    """One attribute that a change touches; null where the resource is not there."""

    name: str
    before: Value
    after: Value
    forces: Literal["", "restart", "replacement"] = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangeOutput:
    """What happens at one address, and why. `replace`: removed and made again."""

    address: str
    action: Literal["create", "update", "replace", "delete", "adopt", "release"]
    disruption: Literal["live", "partition_stop", "host_restart", "removal"]
    reason: str
    place: Place | None
    attributes: tuple[AttributeOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldBackOutput:
    """A change that is not in the plan, because it disturbs more than is allowed."""

    change: ChangeOutput
    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class UndoOutput:
    """How much of a step `rarms undo` brings back, and what it does not."""

    level: Literal["full", "partial", "none"]
    says: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StepOutput:
    """One step, in the order in which they are done."""

    address: str
    title: str
    operation: str
    comment: str
    place: Place | None
    undo: UndoOutput


@dataclass(frozen=True, slots=True, kw_only=True)
class TotalsOutput:
    """What the host has promised once the plan is done; `percent` is of one logical processor (140: 1.4 LP).

    `idle` is that part of `reserved` which is promised to partitions that do not run then.
    """

    reserved_percent: int
    reserved_memory: int
    unmanaged_percent: int
    unmanaged_memory: int
    idle_percent: int
    idle_memory: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ThreadsOutput:
    """What the threads of a robotic task class run at, once its Windows has started again; `inside`: whose guest."""

    inside: str
    task: str
    category: str
    thread_priority: int
    components: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class HostOutput:
    """What a plan does on one host."""

    name: str
    provider: str
    logical_processors: int
    memory: int
    serial: int
    changes: tuple[ChangeOutput, ...]
    steps: tuple[StepOutput, ...]
    held_back: tuple[HeldBackOutput, ...]
    unused: tuple[str, ...]
    unchanged: int
    totals: TotalsOutput | None
    threads: tuple[ThreadsOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class CountsOutput:
    """What the last line of a plan counts; a replacement counts as added and as removed."""

    add: int
    change: int
    remove: int
    adopt: int
    release: int
    held_back: int


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanOutput:
    """`rarms plan`, `show`, `import`, `release`, `destroy`: a plan."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["plan"] = "plan"
    plan: str
    application: str
    purpose: Literal["apply", "destroy", "import", "release"]
    manifest: str
    today: str
    max_disruption: str
    has_changes: bool
    counts: CountsOutput
    hosts: tuple[HostOutput, ...]
    findings: tuple[Diagnostic, ...]
    accepted: tuple[Diagnostic, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class HostRunOutput:
    """What a run did on one host."""

    host: str
    plan: str
    run: Literal["apply", "undo"]
    ending: str
    changed: int
    unchanged: int
    total: int
    resumed: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOutput:
    """`rarms apply`, `undo`: how a run ended."""

    format_version: Format = FORMAT_VERSION
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
class RanIndexOutput:
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
class RanComponentOutput:
    """A component that was run on this machine."""

    component: str
    ending: str  # until, failures or closed
    elapsed_ms: float
    cpu_ms: float | None
    failed: int
    indexes: tuple[RanIndexOutput, ...]
    samples: tuple[SampleOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentRunOutput:
    """`rarms run`: what each component showed, without any reservation."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["component_run"] = "component_run"
    components: tuple[RanComponentOutput, ...]
    findings: tuple[Diagnostic, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftedOutput:
    """One address that is not as it should be; `before` of an attribute is what is there."""

    host: str
    address: str
    drift: Literal["host_changed", "not_applied", "both", "missing", "removed", "unused"]
    says: str
    attributes: tuple[AttributeOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftOutput:
    """`rarms drift`."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["drift"] = "drift"
    application: str
    drifted: tuple[DriftedOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FindingsOutput:
    """`rarms validate`, and any command that ends before it has an answer of its own."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["findings"] = "findings"
    findings: tuple[Diagnostic, ...]
    accepted: tuple[Diagnostic, ...]
    counts: Mapping[str, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class FormattedFileOutput:
    """A file that `rarms fmt` looked at."""

    file: str
    changed: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class FmtOutput:
    """`rarms fmt`."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["fmt"] = "fmt"
    files: tuple[FormattedFileOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class WrittenOutput:
    """`rarms init`, `snapshot`: files that were written."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["written"] = "written"
    files: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplanationOutput:
    """`rarms explain`: a page in Markdown."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["explanation"] = "explanation"
    subject: str
    page: str


@dataclass(frozen=True, slots=True, kw_only=True)
class WalkStepOutput:
    """A step from the APT to the per cent: what it is about, and its sentences."""

    topic: str
    says: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class WalkOutput:
    """`rarms explain COMPONENT`. `cr` is per cent of P1's virtual processors, null where nothing was looked up."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["walk"] = "walk"
    component: str
    partition: str
    host: str
    fits: bool  # false: there is no layout, and the host is the first by name that could have it
    data_log: str | None
    cr: int | None
    interpolated: bool
    wanted_processors: float  # LPs before rounding to the provider's grain
    reserved_processors: float  # LPs after it
    reserve: int  # whole per cent of each virtual processor
    processors: int
    limit: int
    weight: int
    steps: tuple[WalkStepOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExaminedOutput:
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
    rights: Literal["proven", "missing", "unknown"]
    powershell: str | None
    module: tuple[str, ...] | None
    machines: int
    managed: int
    running: int
    findings: tuple[Diagnostic, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class DoctorOutput:
    """`rarms doctor`: what makes a plan void or unsafe on each host."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["doctor"] = "doctor"
    application: str
    hosts: tuple[ExaminedOutput, ...]
    accepted: tuple[Diagnostic, ...]
    counts: Mapping[str, int]


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


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptOutput:
    """A script of a plan, to the byte; `guest` is empty where it runs on the host itself."""

    name: str
    host: str
    guest: str
    undo: bool
    sha256: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptsOutput:
    """`rarms show --script`."""

    plan: str
    scripts: tuple[ScriptOutput, ...]
    kind: Literal["scripts"] = "scripts"
    format_version: Format = FORMAT_VERSION


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptDetailOutput:
    """A reading, parameter or fact of the run that differs; null: it is not there."""

    name: str
    old: str | None
    new: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptStepOutput:
    """A step that differs; its number in each script, from 1, null where it is not there."""

    address: str
    action: str
    old: int | None
    new: int | None
    moved: bool
    details: tuple[ScriptDetailOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptDifferenceOutput:
    """`rarms show --script --against`: what differs step by step."""

    old: str
    new: str
    run: tuple[ScriptDetailOutput, ...]
    steps: tuple[ScriptStepOutput, ...]
    same: int
    kind: Literal["script_difference"] = "script_difference"
    format_version: Format = FORMAT_VERSION


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
    error: float | None
    planned: int | None
    interpolated: bool
    settings: tuple[SettingOutput, ...]
    new_settings: int


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasureOutput:
    """`rarms measure`."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["measure"] = "measure"
    experiments: tuple[ExperimentOutput, ...]
    findings: tuple[Diagnostic, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class TuneOutput:
    """`rarms tune`. Amounts are per cent of one logical processor (140: 1.4 LP); `written`: the manifest's file."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["tune"] = "tune"
    strategy: Literal["default", "paper"]
    ending: Literal["nothing_to_do", "successful", "unable", "stopped"]
    message: str
    capacity: int
    before: int
    after: int
    proved: bool  # that no other layout is better, if a compound needs at least what any part of it needs
    contradictions: tuple[str, ...]
    partitions: tuple[CombinedOutput, ...]
    trail: tuple[AskedOutput, ...]
    written: str
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


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportOutput:
    """`rarms report`: what was measured, and what each threshold reserves."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["report"] = "report"
    application: str
    measurements: tuple[ReportMeasurementOutput, ...]
    capacities: tuple[ReportCapacityOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeOutput:
    """Something in a graph."""

    id: str
    is_a: Literal["host", "partition", "component"]
    name: str
    inside: str
    label: str


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphOutput:
    """`rarms graph`."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["graph"] = "graph"
    application: str
    nodes: tuple[NodeOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateOutput:
    """A CoI as it is (no `parts`), or a compound that could reserve less than its parts.

    It needs `low` whole per cent of each virtual processor or more, and saves something up to `high`.
    """

    name: str
    members: tuple[str, ...]
    parts: tuple[str, ...]
    low: int
    high: int
    measured: bool
    is_gain: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidatesOutput:
    """`rarms graph --candidates`."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["candidates"] = "candidates"
    application: str
    candidates: tuple[CandidateOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class VersionOutput:
    """`rarms version`."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["version"] = "version"
    rarms: str
    python: str
    system: str
    libraries: Mapping[str, str]


Output = (
    PlanOutput
    | RunOutput
    | ComponentRunOutput
    | DriftOutput
    | DoctorOutput
    | FindingsOutput
    | FmtOutput
    | WrittenOutput
    | ExplanationOutput
    | WalkOutput
    | SelectionOutput
    | ScriptsOutput
    | ScriptDifferenceOutput
    | MeasureOutput
    | TuneOutput
    | ProveOutput
    | ReportOutput
    | GraphOutput
    | CandidatesOutput
    | VersionOutput
)
