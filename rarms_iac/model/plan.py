"""A Plan: the whole instruction, used once, and what it is made of."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import date
from enum import StrEnum
from typing import Literal

from rarms_iac.model.changes import Address, Change, count
from rarms_iac.model.claims import Claim
from rarms_iac.model.commands import RecommendedCommand, command
from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.model.facets import Readings
from rarms_iac.model.host import Host, ProviderKind
from rarms_iac.model.layout import ChosenLayout, Placement, RecordedAnswer
from rarms_iac.model.names import BETWEEN, is_name, is_task
from rarms_iac.model.operations import CreatePartition, Operation, Set
from rarms_iac.model.output import Internal, output
from rarms_iac.model.state import HostFacts, RegistryValue, State
from rarms_iac.model.system import Disruption
from rarms_iac.model.totals import HostTotals, Totals, host_totals


@dataclass(frozen=True, slots=True, kw_only=True)
class Scope:
    """Whose things names stand for: what carries the application's mark, and what this plan is making.

    Given with names where they are resolved, also when the run of another application is finished.
    """

    application: str
    plan: str  # id

    def pending(self, partition: str) -> str:
        """Return the name of a partition while this plan makes it; a dot cannot occur in a manifest's name."""
        return f"{partition}.rarms-{self.plan}"


class UndoLevel(StrEnum):
    """The part of a step that can be undone."""

    FULL = "full"
    PARTIAL = "partial"
    NONE = "none"


@dataclass(frozen=True, slots=True, kw_only=True)
class Undo:
    """The undo of a step, and what stays different afterwards."""

    level: UndoLevel
    operation: Operation | None  # None where nothing can be done
    message: str = ""  # what it cannot bring back


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One call with its guard: read, compare with `before`, set, read again and compare with `after`."""

    address: Address
    title: str  # for a person: `reserve 1.4 -> 0.8 LP (70 -> 40 % of each of 2 processors)`
    operation: Operation
    before: Readings
    after: Readings
    undo: Undo
    disruption: Disruption
    claim_before: Internal[Claim]  # of its partition
    claim_after: Internal[Claim]
    comment: str  # why here in the order; why at all is the reason of its change
    place: Place | None = None  # the manifest line behind it
    # Of the two steps that reserve more for a start and give it back: how long it waits first. None: any other step.
    wait_ms: int | None = None

    def reversed(self, title: str) -> "Step":
        """Return the step that undoes this one, which needs an undo; reversing that does this one again."""
        assert self.undo.operation is not None, "a step without an undo is not undone"
        return replace(
            self,
            title=title,
            operation=self.undo.operation,
            before=self.after,
            after=self.before,
            undo=replace(self.undo, operation=self.operation),
            claim_before=self.claim_after,
            claim_after=self.claim_before,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldBack:
    """A change that disturbs more than the policy allows, or depends on one that does: not in the plan."""

    change: Change
    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ThreadClass:
    """The priority of a task class's threads in one operating system, once its Windows has started again."""

    inside: str  # the partition whose guest it is; empty: the host itself
    task: str
    category: str
    thread_priority: int
    components: tuple[str, ...]  # those that name it, the most critical first


@dataclass(frozen=True, slots=True, kw_only=True)
class GuestTask:
    """A task class as wanted in a guest that could not be looked into: its script decides by what it finds."""

    partition: str
    name: str
    values: Mapping[str, RegistryValue]
    set: str  # digest of the values
    replace: bool  # one that was there before may be taken over
    machine: str = ""  # id of the partition's machine, where there is one
    place: Place | None = None

    @property
    def address(self) -> Address:
        """Where the class is to be."""
        return Address(partition=self.partition, task=self.name, machine=self.machine)


@dataclass(frozen=True, slots=True, kw_only=True)
class UnusedPartition:
    """A partition of ours that the manifest no longer names, stopped, and what it still holds on its host."""

    name: str
    memory_on_disk: int  # bytes that the host keeps on its disk for saving it; 0: none
    disks: tuple[str, ...]  # paths of its virtual disks


@dataclass(frozen=True, slots=True, kw_only=True)
class HostSteps:
    """The steps of a run on one host: the scripts of the host are made of them."""

    host: Internal[Host]
    facts: HostFacts
    serial: int  # of the application on this host, before the run
    changes: tuple[Change, ...]  # by address
    steps: tuple[Step, ...]  # in the order in which they are done
    # By partition, then name: what the scripts write in guests that could not be looked into.
    guest_tasks: tuple[GuestTask, ...] | None = None

    @property
    def changes_by_address(self) -> Mapping[Address, Change]:
        """The changes, each by its address."""
        return {change.address: change for change in self.changes}


@dataclass(frozen=True, slots=True, kw_only=True)
class HostPlan(HostSteps):
    """The part of a plan for one host: changes, and steps in their order."""

    state_path: str  # simulated hosts: where their file lies, relative to the manifest's folder
    serial: int  # of the application on this host, when the plan was made
    digests: Mapping[str, str]  # of each part of the observed state that must not have moved
    held_back: tuple[HeldBack, ...]
    unused: tuple[UnusedPartition, ...]  # by name; stopped already
    unchanged: int  # resources that are as wanted
    scripts: Mapping[str, str]  # file name -> text, one an operating system
    totals: Totals | None = None  # for the reader; nothing is decided by it
    threads: tuple[ThreadClass, ...] = ()  # by operating system, highest priority first; for the reader, too
    components: Mapping[str, tuple[str, ...]] = field(
        default_factory=dict
    )  # by partition of the layout; for the reader
    provisional: tuple[str, ...] = ()  # partitions whose reservation is of the first pass of `rarms measure` alone
    stopped: tuple[str, ...] = ()  # partitions that `rarms stop` stopped and that stay so; for the reader
    # By partition of a Linux host: how its reservation is kept and why; for the reader.
    mechanisms: Mapping[str, str] | None = None
    signature: Internal[str] = ""  # HMAC-SHA256 of what it does, in hex, where a key is set

    @output
    def name(self) -> str:
        """The name of the host in the manifest."""
        return self.host.name

    @output
    def commands(self) -> Mapping[str, RecommendedCommand]:
        """By partition: what removes one that is unused, and what starts one that stays stopped."""
        remove = {unused.name: command("destroy", target=f"partition/{unused.name}") for unused in self.unused}
        return {**remove, **{name: command("start", name) for name in self.stopped}}

    @property
    def needs_consent(self) -> bool:
        """Whether applying it sets provisional reservations on a host that is not simulated."""
        changed = {step.address.partition for step in self.steps if _sets_reserve(step.operation)}
        return not changed.isdisjoint(self.provisional) and self.host.provider is not ProviderKind.SIMULATED

    @property
    def host_totals(self) -> HostTotals | None:
        """What the host has, and has promised once the plan is done; None: not known."""
        return None if self.totals is None else host_totals(self.host, self.facts, self.totals)


def _sets_reserve(operation: Operation) -> bool:
    return isinstance(operation, CreatePartition) or (isinstance(operation, Set) and "reserve" in operation.after)


class Purpose(StrEnum):
    """The purpose of a plan: the whole manifest, removing everything, taking a partition in or out, stopping some."""

    APPLY = "apply"
    DESTROY = "destroy"
    IMPORT = "import"
    RELEASE = "release"
    STOP = "stop"
    START = "start"


@dataclass(frozen=True, slots=True, kw_only=True)
class InputText:
    """The text of a manifest or overlay, without what must stay in it."""

    file: str  # as messages name it
    lines: tuple[str, ...]  # without LF


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanOrder:
    """The request for a plan, as far as a plan file holds it."""

    manifest: str  # path as given
    manifest_digest: str
    today: date
    overlays: tuple[str, ...] = ()  # paths as given
    texts: tuple[InputText, ...] = ()  # of the manifest and its overlays, in order
    purpose: Purpose = Purpose.APPLY
    max_disruption: Disruption | None = None  # None: as the manifest's policy says
    hosts: tuple[str, ...] = ()  # names; empty: all
    targets: tuple[str, ...] = ()  # addresses; empty: everything
    gone: frozenset[str] = frozenset()  # addresses that a target may name although nothing is there any more
    partitions: tuple[str, ...] = ()  # to import or release (one), to stop or start; empty: all that it applies to
    machine: str = ""  # id of the machine to import
    remove_disks: bool = False  # of a destroy: also the disks that rarms made
    accept_provisional: bool = False  # provisional reservations may be applied on hosts that are not simulated
    state_paths: Mapping[str, str] = field(default_factory=dict)  # by host: the file of a simulated one
    snapshot_findings: tuple[Diagnostic, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanInputs(PlanOrder):
    """All that a plan is made of. The same inputs make the same plan, without solving."""

    versions: Mapping[str, str]  # of rarms and what it solves with
    observed: Mapping[str, State]  # by host
    after_last_run: Mapping[str, frozenset[str] | None]  # by host that was asked: as of `PlanRequest`
    reservations: tuple[RecordedAnswer, ...]
    layout: ChosenLayout | None  # None: nothing is laid out


@dataclass(frozen=True, slots=True, kw_only=True)
class RunIdentity:
    """The facts of a run that the scripts of all its hosts have."""

    id: str  # 12 hex digits of a digest of what it does
    rarms_version: str
    application: str
    purpose: Purpose
    manifest: str  # path as given
    manifest_digest: str
    accepted: tuple[Diagnostic, ...]
    robot: str = ""  # of `Application`


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan(RunIdentity):
    """Everything that `rarms apply PLAN` does. `id`: digest of it without scripts."""

    today: str  # ISO date that acceptances were judged by
    max_disruption: Disruption
    hosts: tuple[HostPlan, ...]  # by name
    findings: tuple[Diagnostic, ...]  # warnings and notes that the reviewer should see
    overlays: tuple[str, ...] = ()  # paths as given, the last one names the robot
    needs_key: bool = False  # `Policy.signed_plans`
    placement: Placement | None = None  # how good the choice of hosts is; None where there was nothing to choose
    signature: Internal[str] = ""  # HMAC-SHA256 of its file, in hex, where a key was set when it was made
    inputs: Internal[PlanInputs]

    @output
    def kind(self) -> Literal["plan"]:
        """Which answer of a command it is."""
        return "plan"

    @output
    def counts(self) -> Mapping[str, int]:
        """How many changes of each kind there are, as the last line of a plan has them, and how many are held back."""
        held_back = sum(len(host.held_back) for host in self.hosts)
        return {**count(change for host in self.hosts for change in host.changes), "held_back": held_back}

    @output
    def accepts_provisional(self) -> bool:
        """Whether provisional reservations may be applied on hosts that are not simulated."""
        return self.inputs.accept_provisional

    @property
    def provisional(self) -> tuple[str, ...]:
        """The partitions whose reservation is provisional, by host, then by name."""
        return tuple(name for host in self.hosts for name in host.provisional)

    @output
    def has_changes(self) -> bool:
        """Whether applying it would do anything, or something was held back."""
        return any(host.steps or host.held_back for host in self.hosts)


def owner_of(step: Step) -> str:
    """Return the partition that a step belongs to, or the address of a task class of the system itself."""
    return step.address.partition or str(step.address)


def wrong_name(part: HostPlan) -> str | None:
    """Return a name in a host's part of a plan that no manifest can give; None: there is none.

    Names that machines have on their host are not looked at: others than rarms give them.
    """
    held_back = [held.change for held in part.held_back]
    addresses = [each.address for each in (*part.changes, *held_back, *part.steps, *(part.guest_tasks or ()))]
    operations = [operation for step in part.steps for operation in (step.operation, step.undo.operation)]
    partitions = [address.partition for address in addresses]
    partitions += [getattr(each, "partition", "") or getattr(each, "inside", "") for each in operations]
    tasks = [address.task for address in addresses] + [getattr(each, "task", "") for each in operations]
    wrong = [
        *([] if is_name(part.host.name) else [part.host.name]),
        *(name for name in partitions if name and not is_name(name.removesuffix(BETWEEN))),
        *(name for name in tasks if name and not is_task(name)),
    ]
    return wrong[0] if wrong else None
