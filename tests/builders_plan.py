"""Small builders of states, changes, steps and plans for tests: whole values that take what a test is about."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from datetime import date

from rarms_iac.model.changes import Address, Change, Create, Delete, Reason, Resource, Update
from rarms_iac.model.claims import Claim
from rarms_iac.model.commands import prose
from rarms_iac.model.diagnostics import Diagnostic, Place, Severity
from rarms_iac.model.facets import Readings
from rarms_iac.model.host import Host, ProviderKind, SchedulerType
from rarms_iac.model.layout import PlacedPartition
from rarms_iac.model.operations import Operation, set_to
from rarms_iac.model.plan import HeldBack, HostPlan, Plan, PlanInputs, Purpose, Step, Undo, UndoLevel, UnusedPartition
from rarms_iac.model.state import (
    Checkpoints,
    HostFacts,
    Mark,
    Partition,
    PartitionSettings,
    RegistryValue,
    Responsiveness,
    Rights,
    RunState,
    StartAction,
    StopAction,
    TaskClass,
    ValueKind,
)
from rarms_iac.model.system import Disruption
from rarms_iac.model.totals import Totals
from rarms_iac.storage.marks import set_of_settings
from rarms_iac.storage.plan_file import versions
from tests.builders import a_host, memory


def facts(name: str = "onboard", *, logical_processors: int = 2, ram: str = "4 GiB") -> HostFacts:
    """A simulated server with proven rights."""
    return HostFacts(
        name=name,
        id=f"id-of-{name}",
        provider=ProviderKind.SIMULATED,
        computer_name=name.upper(),
        os_build=26100,
        client=False,
        scheduler=SchedulerType.CLASSIC,
        smt=False,
        logical_processors=logical_processors,
        memory=memory(ram),
        rights=Rights.PROVEN,
    )


def settings(
    name: str = "vision",
    *,
    processors: int = 2,
    reserve: int = 40,
    limit: int = 100,
    weight: int = 100,
    ram: str = "512 MiB",
    generation: int = 2,
    running: bool = True,
) -> PartitionSettings:
    """A partition that runs and starts with its host."""
    return PartitionSettings(
        name=name,
        generation=generation,
        processors=processors,
        reserve=reserve,
        limit=limit,
        weight=weight,
        memory=memory(ram),
        dynamic_memory=False,
        start_action=StartAction.START,
        stop_action=StopAction.SHUT_DOWN,
        checkpoints=Checkpoints.DISABLED,
        running=running,
    )


def partition(of: PartitionSettings | None = None, *, application: str | None = "robot") -> Partition:
    """A machine with that mark, as rarms wrote it, or with none."""
    own = of or settings()
    mark = (
        Mark(application=application, name=own.name, machine="01234567", set=set_of_settings(own))
        if application
        else None
    )
    state = RunState.RUNNING if own.running else RunState.OFF
    return Partition(settings=own, id=f"id-of-{own.name}", state=state, mark=mark)


def task(name: str = "MotionControl", *, inside: str = "", priority: int = 5) -> TaskClass:
    """A task class with two typed values."""
    values = {
        "Priority": RegistryValue(kind=ValueKind.DWORD, data=priority),
        "Scheduling Category": RegistryValue(kind=ValueKind.SZ, data="Medium"),
    }
    return TaskClass(name=name, inside=inside, values=values)


def because(message: str = "the manifest wants it", *, line: int | None = 31, file: str = "rarms.yaml") -> Reason:
    """A reason with its manifest line."""
    return Reason(message=message, place=None if line is None else Place(file=file, line=line, column=5))


def address_of(resource: Resource) -> Address:
    """Where a resource lies."""
    match resource:
        case Partition(settings=own):
            return Address(partition=own.name)
        case TaskClass(name=name, inside=inside):
            return Address(partition=inside, task=name)
        case Responsiveness():
            return Address(responsiveness=True)


def create(after: Resource, reason: Reason | None = None) -> Create:
    """It is not there yet."""
    return Create(address=address_of(after), after=after, reason=reason or because())


def update(
    before: Resource,
    after: Resource,
    *,
    disruption: Disruption = Disruption.LIVE,
    reason: Reason | None = None,
) -> Update:
    """It is there and differs."""
    return Update(
        address=address_of(after), before=before, after=after, reason=reason or because(), disruption=disruption
    )


def delete(before: Resource) -> Delete:
    """It is to go."""
    return Delete(
        address=address_of(before),
        before=before,
        reason=because("it is not wanted", line=None),
        disruption=Disruption.REMOVAL,
    )


def step(
    address: Address | None = None,
    *,
    title: str = "reserve 70 -> 40 %",
    operation: Operation | None = None,
    before: Readings | None = None,
    undo: UndoLevel = UndoLevel.FULL,
    lost: str = "",
    comment: str = "shrinks first",
) -> Step:
    """A call that lowers a reserve."""
    where = address or Address(partition="vision")
    call = operation or set_to(where.partition, reserve=40, limit=100, weight=100)
    back = None if undo is UndoLevel.NONE else set_to(where.partition, reserve=70, limit=100, weight=100)
    return Step(
        address=where,
        title=title,
        operation=call,
        before=before or {"exists": True, "reserve": 70},
        after={"exists": True, "reserve": 40},
        undo=Undo(level=undo, operation=back, message=lost),
        disruption=Disruption.LIVE,
        claim_before=Claim(processors=2, reserve=70, memory=2**29),
        claim_after=Claim(processors=2, reserve=40, memory=2**29),
        comment=comment,
        place=because().place,
    )


def held(change: Change) -> HeldBack:
    """A change that the policy does not allow."""
    return HeldBack(change=change, why="it needs partition_stop, and the policy allows live")


def host_plan(
    *,
    host: Host | None = None,
    changes: Iterable[Change] = (),
    steps: Iterable[Step] | None = None,
    held_back: Iterable[HeldBack] = (),
    unused: Iterable[str] = (),
    unchanged: int = 0,
    scripts: Mapping[str, str] | None = None,
    totals: Totals | None = None,
) -> HostPlan:
    """What is to be done on one host; a step for each change where no steps are given."""
    wanted = tuple(changes)
    on = host or a_host()
    return HostPlan(
        host=on,
        facts=replace(facts(on.name), logical_processors=on.logical_processors, memory=on.memory),
        state_path=".rarms/hosts/onboard.json",
        serial=3,
        digests={"host": "0" * 12},
        changes=wanted,
        steps=tuple(step(change.address, title=change.kind) for change in wanted) if steps is None else tuple(steps),
        held_back=tuple(held_back),
        unused=tuple(UnusedPartition(name=name, memory_on_disk=0, disks=()) for name in unused),
        unchanged=unchanged,
        scripts=scripts or {},
        totals=totals,
    )


def plan(
    *hosts: HostPlan,
    purpose: Purpose = Purpose.APPLY,
    max_disruption: Disruption = Disruption.HOST_RESTART,
    findings: Iterable[Diagnostic] = (),
) -> Plan:
    """A plan for these hosts, or for one where all is as wanted."""
    return Plan(
        id="0123456789ab",
        rarms_version="0.1.0",
        application="robot",
        purpose=purpose,
        manifest="rarms.yaml",
        manifest_digest="0" * 64,
        today="2026-11-21",
        max_disruption=max_disruption,
        hosts=hosts or (host_plan(),),
        findings=tuple(findings),
        accepted=(),
        inputs=PlanInputs(
            manifest="rarms.yaml",
            manifest_digest="0" * 64,
            today=date(2026, 11, 21),
            versions=versions(),
            observed={},
            after_last_run={},
            reservations=(),
            layout=None,
        ),
    )


def a_rich_plan() -> Plan:
    """One of everything that a plan can say, on two hosts."""
    smaller = update(partition(settings(reserve=70)), partition(settings(reserve=40)))
    wider = update(
        partition(settings("speech", processors=1)),
        partition(settings("speech", processors=2)),
        disruption=Disruption.PARTITION_STOP,
    )
    gone = delete(partition(settings("old")))
    return plan(
        host_plan(
            changes=[smaller, wider, create(partition(settings("planning", processors=1, reserve=30))), gone],
            steps=[
                step(),
                step(gone.address, title="remove it", undo=UndoLevel.NONE, lost="it is not made again"),
            ],
            held_back=[held(update(partition(settings("video")), partition(settings("video", generation=1))))],
            unused=["former"],
            unchanged=3,
            totals=Totals(percent=190, memory=2**31, others_percent=0, others_memory=0),
        ),
        host_plan(host=a_host("workshop", logical_processors=4), changes=[create(task())]),
        findings=[
            Diagnostic(
                code="RARMS041",
                severity=Severity.WARNING,
                summary="A change restarts or stops a partition",
                detail="speech stops for a moment.",
                advice=prose("Do it when nobody needs it."),
                address="partition/speech",
            )
        ],
    )


def placed_partition(name: str = "vision", *, components: Iterable[str] | None = None) -> PlacedPartition:
    """A partition of the component of its own name, unless they are given."""
    return PlacedPartition(
        host="onboard",
        components=(name,) if components is None else tuple(components),
        criticality=10,
        settings=settings(name),
    )
