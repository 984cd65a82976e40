"""From a System and what its hosts look like to a Plan: the pure middle of `rarms plan` (the picture in docs/).

Observed states come from live hosts or from snapshots; nothing here knows which.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date

from rarms_iac.applying.goals import FIXED, Goals, HostGoal, goals_of, goals_of_removal
from rarms_iac.applying.requested_changes import (
    EVERY_PARTITION,
    StopScope,
    adoption,
    releasing,
    start_changes,
    stop_changes,
)
from rarms_iac.applying.review import review_plan
from rarms_iac.applying.review.reviewed_plan import ReviewedPlan
from rarms_iac.applying.scripts import guest_scripts_by_hand, guest_task, of_the_host_itself, with_scripts
from rarms_iac.diff.claims import NO_CLAIM, claim_of
from rarms_iac.diff.compare import Difference, compare
from rarms_iac.diff.drift import part_digests
from rarms_iac.diff.hold_back import hold_back
from rarms_iac.diff.order import Deadlock, order
from rarms_iac.diff.steps import plan_changes
from rarms_iac.model.capacity import foreign_claims
from rarms_iac.model.changes import Address, Adopt, Change, Delete, Release
from rarms_iac.model.claims import load_of
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, has_errors, in_order
from rarms_iac.model.layout import Layout
from rarms_iac.model.plan import GuestTask, HostPlan, Plan, Purpose, Step, Totals
from rarms_iac.model.state import Partition, State, StoppedBy
from rarms_iac.model.system import Disruption, System
from rarms_iac.model.version import __version__
from rarms_iac.model.wording import suggestion
from rarms_iac.planner.reservations import ReservationSource
from rarms_iac.storage.plan_file import identified

Judge = Callable[[Sequence[Diagnostic]], tuple[tuple[Diagnostic, ...], tuple[Diagnostic, ...]]]
"""Which findings stay, and which the manifest's policy accepts."""


def accept_nothing(found: Sequence[Diagnostic]) -> tuple[tuple[Diagnostic, ...], tuple[Diagnostic, ...]]:
    """The judge of a manifest without acceptances."""
    return tuple(found), ()


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanningRequest:
    """The manifest, the purpose and the limits that a plan is made for."""

    system: System
    places: Places
    manifest: str  # path as given
    manifest_digest: str
    today: date
    purpose: Purpose = Purpose.APPLY
    max_disruption: Disruption | None = None  # None: as the manifest's policy says
    hosts: tuple[str, ...] = ()  # names; empty: all
    targets: tuple[str, ...] = ()  # addresses; empty: everything
    partition: str = ""  # of an import or release
    machine: str = ""  # id of the machine to import
    stop_scope: StopScope = EVERY_PARTITION  # of a stop or start
    remove_disks: bool = False  # of a destroy: also the disks that rarms made
    state_paths: Mapping[str, str] = field(default_factory=dict)  # host -> where a simulated one's file lies
    after_last_run: Mapping[str, frozenset[str] | None] = field(
        default_factory=dict
    )  # by host, its partitions when its last run ended, where that is known
    judge: Judge = accept_nothing
    reservations: ReservationSource = FIXED

    @property
    def limit(self) -> Disruption:
        """The largest disruption that a change may cause. Who destroys means removal, and who stops a stop."""
        if self.purpose is Purpose.DESTROY:
            return Disruption.REMOVAL
        if self.purpose in {Purpose.STOP, Purpose.START}:
            return Disruption.PARTITION_STOP
        return self.max_disruption or self.system.policy.max_disruption


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanningResult:
    """A plan, or None where errors forbid one; the findings either way, in order, and those that were accepted."""

    plan: Plan | None
    findings: tuple[Diagnostic, ...]
    accepted: tuple[Diagnostic, ...] = ()


def prepare(request: PlanningRequest, observed: Mapping[str, State]) -> PlanningResult:
    """The plan that makes the observed hosts what the manifest wants, or why there is none.

    Same input, same plan, to the byte.
    """
    goals = _goals(request, observed)
    findings = list(goals.findings)
    parts: list[_HostPart] = []
    for name, goal in goals.hosts.items():
        if name in (request.hosts or observed):
            parts.append(_host_part(request, goal, goals.layout))
            findings += parts[-1].findings
    findings += unknown_targets([address for part in parts for address in part.addresses], request.targets)
    remaining, accepted = request.judge(in_order(findings))
    if has_errors(remaining):
        return PlanningResult(plan=None, findings=remaining, accepted=accepted)
    bare = _plan(request, tuple(part.plan for part in parts), goals.layout, remaining, accepted)
    plan, wrong = with_scripts(bare)
    return PlanningResult(plan=None if wrong else plan, findings=in_order((*remaining, *wrong)), accepted=accepted)


def _goals(request: PlanningRequest, observed: Mapping[str, State]) -> Goals:
    match request.purpose:
        case Purpose.APPLY:
            return goals_of(request.system, observed, request.places, request.limit, request.reservations)
        case Purpose.DESTROY:
            return goals_of_removal(request.system, observed, request.places, remove_disks=request.remove_disks)
        case Purpose.IMPORT | Purpose.RELEASE | Purpose.STOP | Purpose.START:
            return goals_of_removal(request.system, observed, request.places)


def _plan(
    request: PlanningRequest,
    hosts: tuple[HostPlan, ...],
    layout: Layout | None,
    findings: tuple[Diagnostic, ...],
    accepted: tuple[Diagnostic, ...],
) -> Plan:
    return identified(
        Plan(
            id="",
            rarms_version=__version__,
            application=request.system.application.name,
            purpose=request.purpose,
            manifest=request.manifest,
            manifest_digest=request.manifest_digest,
            today=request.today.isoformat(),
            max_disruption=request.limit,
            hosts=hosts,
            findings=findings,
            accepted=accepted,
            placement=None if layout is None else layout.placement,
        )
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _HostPart:
    """One host's part of the plan, where changes were possible, and what was found on the way."""

    plan: HostPlan
    addresses: tuple[str, ...]
    findings: tuple[Diagnostic, ...]


def _host_part(request: PlanningRequest, goal: HostGoal, layout: Layout | None) -> _HostPart:
    application = request.system.application.name
    difference = _difference(request, goal)
    held = hold_back(targeted(difference.changes, request.targets), goal.budget)
    ordered = order(plan_changes(held.allowed, goal.context), goal.budget)
    steps, stuck = ((), (ordered.finding,)) if isinstance(ordered, Deadlock) else (ordered.steps, ())
    here = [partition for partition in (layout.partitions if layout else ()) if partition.host == goal.name]
    mechanisms = {partition.name: partition.mechanism for partition in here if partition.mechanism}
    guests = _guest_tasks(request, goal)
    plan = HostPlan(
        host=request.system.hosts[goal.name],
        facts=goal.observed.facts,
        state_path=request.state_paths.get(goal.name, ""),
        serial=goal.observed.serials.get(application, 0),
        digests=part_digests(of_the_host_itself(goal.observed), application),
        changes=held.allowed,
        steps=steps,
        held_back=held.held,
        unused=difference.unused,
        unchanged=difference.unchanged,
        scripts={},
        totals=totals_of(goal.observed, _wanted_of(request, goal), application, held.allowed, steps),
        threads=goal.threads,
        components={partition.name: partition.components for partition in here},
        mechanisms=mechanisms or None,
        stopped=_staying_stopped(request, goal),
        guest_tasks=guests or None,
    )
    reviewed = ReviewedPlan(
        system=request.system,
        places=request.places,
        purpose=request.purpose,
        remove_disks=request.remove_disks,
        layout=layout,
        observed=goal.observed,
        plan=plan,
        after_last_run=request.after_last_run.get(goal.name),
    )
    return _HostPart(
        plan=plan,
        addresses=tuple(str(change.address) for change in (*difference.changes, *guests)),
        findings=(
            *difference.findings,
            *stuck,
            *review_plan(reviewed),
            *guest_scripts_by_hand(plan, goal.rules.locate),
        ),
    )


def _guest_tasks(request: PlanningRequest, goal: HostGoal) -> tuple[GuestTask, ...]:
    """The classes that the guests' scripts write, as far as they are targets, by partition and name."""
    application, rules = request.system.application.name, goal.rules
    machines = {vm.mark.name: vm.id for vm in goal.observed.of(application).partitions if vm.mark}
    tasks = (guest_task(task, rules.replaceable, rules.locate, machines.get(task.inside, "")) for task in goal.by_hand)
    return tuple(
        task
        for task in sorted(tasks, key=lambda task: (task.partition, task.name))
        if is_below(str(task.address), request.targets)
    )


def _wanted_of(request: PlanningRequest, goal: HostGoal) -> State:
    """The State that the host is to have in the end; who stops or starts partitions wants all of them to stay."""
    keeps = request.purpose in {Purpose.STOP, Purpose.START}
    return goal.observed.of(request.system.application.name) if keeps else goal.desired


def _staying_stopped(request: PlanningRequest, goal: HostGoal) -> tuple[str, ...]:
    """The partitions of the manifest that `rarms stop` stopped, where the plan asks for all of the manifest."""
    if request.purpose is not Purpose.APPLY:
        return ()
    wanted = (partition.mark for partition in goal.desired.partitions if partition.mark)
    return tuple(sorted(mark.name for mark in wanted if mark.stopped_by is StoppedBy.USER))


def _difference(request: PlanningRequest, goal: HostGoal) -> Difference:
    """The changes of the host for this purpose."""
    application = request.system.application.name
    match request.purpose:
        case Purpose.APPLY | Purpose.DESTROY:
            return compare(goal.desired, goal.observed, application, goal.context, goal.rules)
        case Purpose.IMPORT:
            place = goal.rules.locate(Address(partition=request.partition))
            return _single_change(adoption(goal.observed, application, request.partition, request.machine, place))
        case Purpose.RELEASE:
            place = goal.rules.locate(Address(partition=request.partition))
            return _single_change(releasing(goal.observed, application, request.partition, place))
        case Purpose.STOP:
            return _some_changes(*stop_changes(goal.observed, application, request.stop_scope, goal.rules.locate))
        case Purpose.START:
            return _some_changes(*start_changes(goal.observed, application, request.stop_scope, goal.rules.locate))


def _some_changes(changes: tuple[Change, ...], findings: tuple[Diagnostic, ...]) -> Difference:
    return Difference(changes=changes, unchanged=0, unused=(), findings=findings)


def _single_change(change: Adopt | Release | Diagnostic | None) -> Difference:
    if change is None:
        return Difference(changes=(), unchanged=1, unused=(), findings=())
    if isinstance(change, Diagnostic):
        return Difference(changes=(), unchanged=0, unused=(), findings=(change,))
    return Difference(changes=(change,), unchanged=0, unused=(), findings=())


NO_SUCH_TARGET = Finding.error("RARMS194", "Nothing changes at this target")


def is_below(address: str, targets: Sequence[str]) -> bool:
    """Whether the address is one of the targets, or lies below one; without targets everything is meant."""
    return not targets or any(address == target or address.startswith(f"{target}/") for target in targets)


def targeted(changes: Sequence[Change], targets: Sequence[str]) -> tuple[Change, ...]:
    """The changes that are meant."""
    return tuple(change for change in changes if is_below(str(change.address), targets))


def unknown_targets(addresses: Sequence[str], targets: Sequence[str]) -> tuple[Diagnostic, ...]:
    """A finding for each target at which no host changes anything: most often a slip of the pen."""
    return tuple(
        NO_SUCH_TARGET.at(
            None,
            f"`--target {target}`: no change has this address or lies below it.{_suggestion(target, addresses)}",
            "Give an address such as partition/vision (`rarms plan --verbose` lists them), or leave the option out.",
            address=target,
        )
        for target in targets
        if not any(is_below(address, [target]) for address in addresses)
    )


def _suggestion(target: str, addresses: Sequence[str]) -> str:
    """As `suggestion`; a name alone is looked for among partitions and task classes, too."""
    words = [target, f"partition/{target}", f"task/{target}"]
    for word in words:
        if word in addresses:
            return f' Did you mean "{word}"?'
    return next((message for word in words if (message := suggestion(word, addresses))), "")


def totals_of(
    observed: State, desired: State, application: str, changes: Sequence[Change], steps: Sequence[Step]
) -> Totals:
    """The promises to this application's partitions after these steps, and those to all others then.

    A machine that is taken over or let go of changes sides, and keeps what it has. One that is wanted, or that
    `rarms stop` stopped, and does not run is promised what the layout or its settings give it, as the planner counts.
    """
    claims = {
        partition.mark.name: claim_of(partition) for partition in observed.of(application).partitions if partition.mark
    }
    renamed: dict[str, str] = {
        partition.id: partition.mark.name for partition in observed.of(application).partitions if partition.mark
    }
    for step in steps:
        address = step.address
        if address.partition and not address.task:
            claims.pop(renamed.get(address.machine, ""), None)
            claims[address.partition] = step.claim_after
    others = list(foreign_claims(observed, application))
    for change in changes:
        match change:
            case Adopt(before=Partition(claims_resources=True) as before):
                others.remove(before.claim)
            case Release(before=Partition() as before):
                claims.pop(change.address.partition, None)
                others += [before.claim] if before.claims_resources else []
            case _:
                pass
    removed = {change.address.partition for change in changes if isinstance(change, Delete)}
    stopped = {
        partition.mark.name: partition.claim
        for partition in observed.of(application).partitions
        if partition.mark and partition.mark.stopped_by is not StoppedBy.NO_USER and partition.mark.name not in removed
    }
    layout = stopped | {partition.settings.name: partition.claim for partition in desired.partitions}
    idle = load_of(layout[name] for name, claim in claims.items() if claim == NO_CLAIM and name in layout)
    own, foreign = load_of(claims.values()), load_of(others)
    return Totals(
        percent=own.percent + idle.percent,
        memory=own.memory + idle.memory,
        others_percent=foreign.percent,
        others_memory=foreign.memory,
        idle_percent=idle.percent,
        idle_memory=idle.memory,
    )
