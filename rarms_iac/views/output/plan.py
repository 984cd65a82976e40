"""What a plan does (`rarms plan`, `show`, `import`, `destroy`, `stop`), and its scripts (`show --script`)."""

from dataclasses import dataclass
from typing import Literal

from rarms_iac.model.changes import Attribute
from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.views.output.common import Output


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangeOutput:
    """What happens at one address, and why. `replace`: removed and made again."""

    address: str
    action: Literal["create", "update", "replace", "delete", "adopt", "release"]
    disruption: Literal["live", "partition_stop", "host_restart", "removal"]
    reason: str
    place: Place | None
    components: tuple[str, ...]  # of the partition, the most critical first; empty where the plan does not place it
    reserved_processors: float | None  # logical processors that the partition is guaranteed afterwards
    attributes: tuple[Attribute, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldBackOutput:
    """A change that is not in the plan, because it disturbs more than is allowed."""

    change: ChangeOutput
    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class UndoOutput:
    """How much of a step `rarms undo` brings back, and what it does not."""

    level: Literal["full", "partial", "none"]
    message: str


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

    logical_processors: int  # of the host
    reserved_processors: float
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
    stopped: tuple[str, ...]  # partitions that `rarms stop` stopped, and that stay so
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
class PlacementOutput:
    """How good the choice of hosts is. Reservations are in per cent of one logical processor, over all hosts."""

    verdict: Literal["optimal", "within the bound"]
    reserved: int
    reserved_bound: int
    moves: int
    moves_bound: int


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanOutput(Output):
    """`rarms plan`, `show`, `import`, `release`, `destroy`, `stop`, `start`: a plan."""

    kind: Literal["plan"] = "plan"
    plan: str
    application: str
    purpose: Literal["apply", "destroy", "import", "release", "stop", "start"]
    manifest: str
    today: str
    max_disruption: str
    has_changes: bool
    counts: CountsOutput
    hosts: tuple[HostOutput, ...]
    findings: tuple[Diagnostic, ...]
    accepted: tuple[Diagnostic, ...]
    placement: PlacementOutput | None


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
class ScriptsOutput(Output):
    """`rarms show --script`."""

    plan: str
    scripts: tuple[ScriptOutput, ...]
    kind: Literal["scripts"] = "scripts"


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
class ScriptDifferenceOutput(Output):
    """`rarms show --script --against`: what differs step by step."""

    old: str
    new: str
    run: tuple[ScriptDetailOutput, ...]
    steps: tuple[ScriptStepOutput, ...]
    same: int
    kind: Literal["script_difference"] = "script_difference"
