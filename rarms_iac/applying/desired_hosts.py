"""The desired state of each observed host, what its comparison depends on, and a host once changes are made."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import chain
from typing import assert_never

from rarms_iac.applying.plan_request import PlanRequest
from rarms_iac.applying.preconditions import ignored_reserves, marks_of_other_robots, unproven_rights
from rarms_iac.diff.compare import machine_in_the_way
from rarms_iac.diff.partition_steps import judge_disks
from rarms_iac.diff.readings import count_disks
from rarms_iac.diff.step_context import NO_CLAIM, ManifestRules, StepContext, claim_of
from rarms_iac.model.capacity import foreign_claims
from rarms_iac.model.changes import Address, Adopt, Change, Create, Delete, Release, Update
from rarms_iac.model.commands import prose
from rarms_iac.model.diagnostics import Diagnostic, Place, Places, Related
from rarms_iac.model.host import HypervHost
from rarms_iac.model.layout import Layout
from rarms_iac.model.names import renaming
from rarms_iac.model.plan import Purpose, ThreadClass
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.seen_host import SeenHost, seen_hosts
from rarms_iac.model.state import Disk, Partition, State, TaskClass
from rarms_iac.model.system import Disruption, System
from rarms_iac.model.totals import Totals, totals_of
from rarms_iac.planner.desired import Desired, desired_state
from rarms_iac.planner.groups import groups_of, most_critical_first, unnamed_partitions
from rarms_iac.planner.layout import gather_unmeasured, plan_layout
from rarms_iac.planner.planning_findings import NO_ROOM
from rarms_iac.planner.sizes import starting_partitions
from rarms_iac.planner.task_classes import ClassValues
from rarms_iac.texts.findings import FOREIGN_AT_NAME
from rarms_iac.texts.messages import natural_order


def desired_hosts(
    request: PlanRequest, observed: Mapping[str, State]
) -> tuple[Mapping[str, Desired], tuple[Diagnostic, ...]]:
    """Work out what each observed host is to be.

    The manifest is laid out on the hosts. Where everything of the application goes, or a command brings its own
    changes (import  release, stop, start), nothing is laid out, and nothing of the application is desired.

    Returns:
        By name, none where no layout exists or where a host may have more than can be seen; and what was found.

    Raises:
        LayoutRefused: as of `plan_layout`.
    """
    system, places = request.system, request.places
    if refused := (
        *unproven_rights(observed.values(), places),
        *marks_of_other_robots(observed.values(), system.application),
    ):
        return {}, refused
    all_seen = seen_hosts(system.hosts, request.application, observed)
    seen = {name: all_seen[name] for name in sorted(observed, key=natural_order)}
    if request.purpose is not Purpose.APPLY:
        return {name: _without_layout(request, host) for name, host in seen.items()}, ()
    planning = plan_layout(
        system,
        request.reservations,
        observed,
        places,
        max_disruption=request.limit,
        explain=request.explain,
        chosen=request.layout,
    )
    layout = planning.answer
    if not isinstance(layout, Layout):
        namesakes = tuple(map(_without_place, _namesakes(system, observed, places)))
        findings = gather_unmeasured(planning.findings)
        return {}, (*namesakes, *(map(_advise_to_settle, findings) if namesakes else findings))
    hosts = {name: desired_state(system, layout, host, places, request.limit) for name, host in seen.items()}
    of_hosts = ((*desired.findings, *ignored_reserves(desired.state, places)) for desired in hosts.values())
    return hosts, (*planning.findings, *chain.from_iterable(of_hosts))


def _without_layout(request: PlanRequest, seen: SeenHost) -> Desired:
    names = {group.name for group in groups_of(request.system)}
    return Desired(
        seen=seen,
        state=replace(seen.state, partitions=(), tasks=(), responsiveness=None),
        unnamed=unnamed_partitions(names, request.system.moved, seen.own),
    )


def rules_of(request: PlanRequest, desired: Desired) -> ManifestRules:
    """Make the rules by which a host's difference is found: moves, protection, and the manifest's lines."""
    system = request.system
    return ManifestRules(
        moved=system.moved if request.purpose is Purpose.APPLY else {},
        protected=frozenset(name for name, partition in system.partitions.items() if partition.protect),
        replaceable=frozenset(name.lower() for name, task in system.tasks.items() if task.replace_shipped),
        unused=desired.unused,
        unnamed=desired.unnamed,
        locate=locator(system, request.places, desired.host, desired.classes),
    )


def context_of(request: PlanRequest, desired: Desired, present: Mapping[str, frozenset[str]]) -> StepContext:
    """Make what else the steps of a host depend on: capacity, guests, disks, grace periods and limits.

    Args:
        present: by host that was looked at, as of `partitions_present`.

    Returns:
        The context; what the plan does not remove from another host, it does not make on this one.
    """
    system, seen, observed = request.system, desired.seen, desired.seen.state
    stated = {name: partition.guest.windows_build or 0 for name, partition in system.partitions.items()}
    builds: dict[str, int] = {}
    for marked, partition in seen.present.items():
        name = system.moved.get(marked, marked)
        builds[partition.id] = partition.guest_build or stated.get(name, 0)
    return StepContext(
        seen=seen,
        guest_builds=builds,
        graces=graces_of(system, seen),
        attached={partition.id: count_disks(observed, partition.id) for partition in observed.partitions},
        restorable=_restorable(observed.of(request.application)),
        disks=_removable_disks(system, observed) if request.remove_disks else {},
        making={partition.name: partition.making for partition in desired.partitions},
        criticality=criticality_of(system),
        max_disruption=request.limit,
        remaining=_remaining(request, desired, present),
        starting=starting_partitions(system, seen.host),
    )


def graces_of(system: System, seen: SeenHost) -> Mapping[str, Milliseconds]:
    """Return the grace of each partition's guest to shut down: no time if it cannot be asked to."""
    graces = {name: partition.stop.grace for name, partition in system.partitions.items()}
    mute = (name for name, each in seen.present.items() if each.settings.running and not each.can_be_asked)
    return graces | {system.moved.get(name, name): Milliseconds(Fraction(0)) for name in mute}


def criticality_of(system: System) -> Mapping[str, int]:
    """Return the criticality of each partition: the highest of its components."""
    return {group.name: group.criticality for group in groups_of(system)}


def _remaining(request: PlanRequest, desired: Desired, present: Mapping[str, frozenset[str]]) -> Mapping[str, str]:
    """Return the partitions that are not made on a host, as they are or may be on another one.

    Returns:
        By partition, the reason as a part of a sentence.
    """
    removes = request.limit is Disruption.REMOVAL
    unseen = [host for host in sorted(request.system.hosts, key=natural_order) if host not in present]
    groups = {group.name: group for group in groups_of(request.system)}
    known = frozenset[str]().union(*present.values())
    reasons: dict[str, str] = {}
    for name in (partition.name for partition in desired.partitions):
        for host in unseen:
            if name not in known and groups[name].may_run_on(host):
                reasons[name] = f"it may be on {host}, which was not read"
        for host, names in present.items():
            is_left = name in names and not (removes and host in (request.hosts or present))
            if is_left and name not in present[desired.host]:
                reasons[name] = f"it is on {host}, and this plan does not remove it there"
    return reasons


def partitions_present(request: PlanRequest, observed: Mapping[str, State]) -> Mapping[str, frozenset[str]]:
    """Return the names of the manifest that the partitions of each host have, or get by its `moved`.

    The hosts are in order.
    """
    wanted = {group.name for group in groups_of(request.system)}
    present: dict[str, frozenset[str]] = {}
    for name, state in sorted(observed.items()):
        there = {partition.mark.name for partition in state.of(request.application).partitions if partition.mark}
        present[name] = frozenset(renaming(there, wanted, request.system.moved).new.values())
    return present


def _namesakes(system: System, observed: Mapping[str, State], places: Places) -> Iterator[Diagnostic]:
    """Find unmanaged machines with a partition's name: one of them may take the room that is missing."""
    names = {group.name for group in groups_of(system)}
    for _, state in sorted(observed.items()):
        for machine in state.partitions:
            is_managed = machine.mark is not None and machine.mark.application == system.application.name
            if not is_managed and machine.settings.name in names:
                yield machine_in_the_way(
                    machine, places.key(system.section_of(machine.settings.name), machine.settings.name)
                )


def _advise_to_settle(finding: Diagnostic) -> Diagnostic:
    """Put the advice to settle a namesake before any other, if hosts have too little."""
    advice = f"First resolve {FOREIGN_AT_NAME.code}. A machine with the name of a partition uses capacity of the host."
    return replace(finding, advice=prose(advice)) if finding.code in NO_ROOM else finding


def _without_place(diagnostic: Diagnostic) -> Diagnostic:
    """Return the finding without a line of its own, so that it comes first.

    Findings are in the order of their lines.
    """
    if diagnostic.place is None:
        return diagnostic
    related = (*diagnostic.related, Related(place=diagnostic.place, message="wanted here"))
    return replace(diagnostic, place=None, related=related)


def locator(
    system: System, places: Places, host: str, classes: Mapping[tuple[str, str], ClassValues]
) -> Callable[[Address], Place | None]:
    """Find the line that asks for what is at an address: for a task class, the component that names it."""

    def locate(address: Address) -> Place | None:
        if address.responsiveness:
            return places.value("hosts", host, "system_responsiveness")
        if address.task:
            values = classes.get((address.partition, address.task))
            return places.value("components", values.user, "task") if values else None
        if address.partition in system.moved:
            return places.key("moved", address.partition)
        return places.key(system.section_of(address.partition), address.partition)

    return locate


def disk_verdicts(system: System, observed: State, machine: Partition) -> Iterator[tuple[Disk, str]]:
    """Yield the disks of a managed machine, with why each stays where its removal is asked for."""
    host = system.hosts[observed.facts.name].settings
    name = machine.mark.name if machine.mark else ""
    own = system.partitions[name].hyperv.vm_path if name in system.partitions else None
    default = host.vm_path if isinstance(host, HypervHost) else None
    folders = [folder for folder in (own, default, observed.facts.disk_folder) if folder]
    return judge_disks(machine, observed, folders)


def _removable_disks(system: System, observed: State) -> Mapping[str, tuple[Disk, ...]]:
    return {
        partition.id: tuple(disk for disk, reason in disk_verdicts(system, observed, partition) if not reason)
        for partition in observed.of(system.application.name).partitions
    }


def _restorable(own: State) -> Mapping[str, tuple[TaskClass, ...]]:
    """Return the machines that can be removed and made again, by id, with rarms' task classes in their guests."""
    machines = [partition.id for partition in own.partitions if own.holds_nothing(partition.id)]
    return {machine: tuple(task for task in own.tasks if task.machine == machine) for machine in machines}


def threads_of(desired: Desired, system: System) -> tuple[ThreadClass, ...]:
    """Return the robotic classes of every operating system of a host, the host's own first, the highest threads first.

    Args:
        desired: the host, with the values that the planner chose.
    """
    members = {partition.name: partition.components for partition in desired.partitions}
    on_hosts = desired.layout.on_hosts if desired.layout else ()
    members[""] = tuple(component for component, host in on_hosts if host == desired.host)
    made = [
        ThreadClass(
            inside=inside,
            task=name,
            category=values.category.value,
            thread_priority=values.thread_priority,
            components=tuple(_users(system, members.get(inside, ()), name)),
        )
        for (inside, name), values in desired.classes.items()
    ]
    return tuple(
        sorted(made, key=lambda thread_class: (thread_class.inside, -thread_class.thread_priority, thread_class.task))
    )


def _users(system: System, members: tuple[str, ...], task: str) -> Iterator[str]:
    users = [system.components[name] for name in members]
    named = [user for user in users if user.task_class is not None and user.task_class.lower() == task.lower()]
    yield from (component.name for component in most_critical_first(named))


def partitions_after(observed: State, application: str, changes: Sequence[Change]) -> tuple[Partition, ...]:
    """List this application's partitions on a host once the changes are made, by name."""
    partitions: dict[str, Partition] = {}
    names: dict[str, str] = {}  # by machine id
    for partition in observed.of(application).partitions:
        if partition.mark:
            partitions[partition.mark.name] = partition
            names[partition.id] = partition.mark.name
    for change in changes:
        if change.address.partition and not change.address.task:
            partitions.pop(names.get(change.address.machine, change.address.partition), None)
    for change in changes:
        if after := partition_after_change(change):
            partitions[change.address.partition] = after
    return tuple(after for _, after in sorted(partitions.items()))


def partition_after_change(change: Change) -> Partition | None:
    """Return a partition after its change; None where it is removed or released, or where it is not a partition."""
    match change:
        case Create(after=after) | Update(after=after) | Adopt(after=after):
            return after if isinstance(after, Partition) else None
        case Delete() | Release():
            return None
        case _:
            assert_never(change)


def totals_after(observed: State, application: str, changes: Sequence[Change], named: Collection[str]) -> Totals:
    """Add up what a host has promised once the changes are made.

    A machine that is imported or released changes sides and keeps what it has.

    Args:
        application: whose partitions are `own`; all other machines are `others`.
        changes: what is changed there; none: the host stays as it is.

    Returns:
        The sums, as the planner counts them. A partition that does not run counts as idle where the manifest names it,
        and otherwise not at all.
    """
    own = partitions_after(observed, application, changes)
    claims = [claim_of(partition) for partition in own]
    idle = [
        partition.claim
        for partition, claim in zip(own, claims, strict=True)
        if claim == NO_CLAIM and partition.mark and partition.mark.name in named
    ]
    taken = {change.before.id for change in changes if isinstance(change, Adopt)}
    strangers = [
        machine
        for machine in observed.partitions
        if machine.id not in taken and (machine.mark is None or machine.mark.application != application)
    ]
    released = [replace(change.before, mark=None) for change in changes if isinstance(change, Release)]
    others = foreign_claims(replace(observed, partitions=(*strangers, *released)), application)
    return totals_of(claims, others, idle)
