"""The goal of each observed host: its desired state, and all that the comparison has to know beside it."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

from rarms_iac.applying.preconditions import ignored_reserves, unproven_rights
from rarms_iac.diff.claims import StepBudget, budget_of
from rarms_iac.diff.compare_partitions import FOREIGN_AT_NAME, machine_in_the_way
from rarms_iac.diff.comparison import ManifestRules
from rarms_iac.diff.disruption import HostContext
from rarms_iac.diff.partition_steps import DiskVerdict, judge_disks
from rarms_iac.diff.readings import count_disks
from rarms_iac.model.capacity import capacity_of, foreign_claims
from rarms_iac.model.changes import Address
from rarms_iac.model.commands import prose
from rarms_iac.model.diagnostics import Diagnostic, Place, Places, Related
from rarms_iac.model.host import HypervHost
from rarms_iac.model.layout import Layout
from rarms_iac.model.plan import ThreadClass
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.state import Disk, Partition, State, TaskClass
from rarms_iac.model.system import Disruption, System
from rarms_iac.planner.desired import desired_state
from rarms_iac.planner.findings import MEMORY, PACKING, RESERVATIONS
from rarms_iac.planner.groups import groups_of, most_critical_first
from rarms_iac.planner.layout import plan_layout
from rarms_iac.planner.problem import host_view
from rarms_iac.planner.reservations import FixedReservations, ReservationSource
from rarms_iac.planner.task_classes import ClassValues

FIXED = FixedReservations()


@dataclass(frozen=True, slots=True, kw_only=True)
class HostGoal:
    """One host: what is there, what is wanted, and the rules between the two."""

    name: str
    observed: State
    desired: State
    rules: ManifestRules
    context: HostContext
    budget: StepBudget
    by_hand: tuple[TaskClass, ...] = ()  # wanted in guests that could not be looked into
    threads: tuple[ThreadClass, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Goals:
    """The goals of all observed hosts, by name; none where no layout exists."""

    layout: Layout | None
    hosts: Mapping[str, HostGoal]
    findings: tuple[Diagnostic, ...]


def goals_of(
    system: System,
    observed: Mapping[str, State],
    places: Places,
    limit: Disruption,
    reservations: ReservationSource = FIXED,
) -> Goals:
    """Lay the manifest out on the observed hosts; no goals where a host may have more than can be seen.

    Args:
        system: what the manifest says.
        observed: the hosts by name.
        places: the manifest's lines.
        limit: the largest disruption that a change may cause.
        reservations: where reserves come from that the manifest does not fix.
    """
    if hidden := tuple(unproven_rights(observed.values(), places)):
        return Goals(layout=None, hosts={}, findings=hidden)
    views = {name: host_view(state, system.application.name) for name, state in sorted(observed.items())}
    planning = plan_layout(system, reservations, views, places, max_disruption=limit)
    layout = planning.answer
    if not isinstance(layout, Layout):
        namesakes = tuple(map(_without_place, _namesakes(system, observed, places)))
        lacking = map(_advise_namesake_first, planning.findings) if namesakes else planning.findings
        return Goals(layout=None, hosts={}, findings=(*namesakes, *lacking))
    hosts: dict[str, HostGoal] = {}
    findings = list(planning.findings)
    for name, state in sorted(observed.items()):
        desired = desired_state(system, layout, state, places)
        findings += [*desired.findings, *ignored_reserves(desired.state, places)]
        rules = ManifestRules(
            moved=system.moved,
            protected=desired.protected,
            replaceable=desired.replaceable,
            unused=desired.unused,
            locate=_locator(system, places, name, desired.classes),
        )
        context = replace(_context(system, state), making=desired.making, criticality=desired.criticality)
        members = {partition.name: partition.components for partition in layout.partitions if partition.host == name}
        members[""] = tuple(component for component, host in layout.on_hosts if host == name)
        hosts[name] = replace(
            _host_goal(system, state, desired.state, rules, context, limit),
            by_hand=desired.by_hand,
            threads=threads_of(desired.classes, system, members),
        )
    return Goals(layout=layout, hosts=hosts, findings=tuple(findings))


def goals_of_removal(
    system: System, observed: Mapping[str, State], places: Places, *, remove_disks: bool = False
) -> Goals:
    """Every observed host without anything of this application: the goal of `rarms destroy`.

    With `remove_disks` also without the disks that rarms made for it. Import and release take it too: they use its
    observed state, rules and budget, and bring their one change themselves; so do stop and start.
    """
    if hidden := tuple(unproven_rights(observed.values(), places)):
        return Goals(layout=None, hosts={}, findings=hidden)
    protected = frozenset(name for name, request in system.partitions.items() if request.protect)
    hosts = {
        name: _host_goal(
            system,
            state,
            replace(state, partitions=(), tasks=(), responsiveness=None),
            ManifestRules(protected=protected, locate=_locator(system, places, name, {})),
            replace(_context(system, state), disks=_removable_disks(system, state) if remove_disks else {}),
            Disruption.REMOVAL,
        )
        for name, state in sorted(observed.items())
    }
    return Goals(layout=None, hosts=hosts, findings=())


def _namesakes(system: System, observed: Mapping[str, State], places: Places) -> Iterator[Diagnostic]:
    """Machines of others with the name of a partition: one of them may be what there is no room beside."""
    names = {group.name for group in groups_of(system)}
    for _, state in sorted(observed.items()):
        for machine in state.partitions:
            is_managed = machine.mark is not None and machine.mark.application == system.application.name
            if not is_managed and machine.settings.name in names:
                yield machine_in_the_way(
                    machine, places.key(system.section_of(machine.settings.name), machine.settings.name)
                )


def _without_place(diagnostic: Diagnostic) -> Diagnostic:
    """The same without a line of its own, so that it comes first: findings are in the order of their lines."""
    if diagnostic.place is None:
        return diagnostic
    related = (*diagnostic.related, Related(place=diagnostic.place, message="wanted here"))
    return replace(diagnostic, place=None, related=related)


def _advise_namesake_first(diagnostic: Diagnostic) -> Diagnostic:
    """Other advice for what lacks room: ways out were sought beside the namesake, and taking it over may need none."""
    if diagnostic.code not in {RESERVATIONS.code, MEMORY.code, PACKING.code}:
        return diagnostic
    advice = f"First settle the machine that has a wanted name ({FOREIGN_AT_NAME.code}): it takes room, too."
    return replace(diagnostic, advice=prose(advice))


def _locator(
    system: System, places: Places, host: str, classes: Mapping[tuple[str, str], ClassValues]
) -> Callable[[Address], Place | None]:
    """Finds the line that asks for what is at an address: for a task class, the component that names it."""

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


def disk_verdicts(system: System, observed: State, machine: Partition) -> Iterator[DiskVerdict]:
    """The disks of a managed machine, with why each stays where its removal is asked for."""
    host = system.hosts[observed.facts.name].settings
    name = machine.mark.name if machine.mark else ""
    own = system.partitions[name].hyperv.vm_path if name in system.partitions else None
    default = host.vm_path if isinstance(host, HypervHost) else None
    folders = [folder for folder in (own, default, observed.facts.disk_folder) if folder]
    return judge_disks(machine, observed, folders)


def _removable_disks(system: System, observed: State) -> Mapping[str, tuple[Disk, ...]]:
    return {
        partition.id: tuple(
            verdict.disk for verdict in disk_verdicts(system, observed, partition) if not verdict.reason_to_keep
        )
        for partition in observed.of(system.application.name).partitions
    }


def _host_goal(
    system: System, observed: State, desired: State, rules: ManifestRules, context: HostContext, limit: Disruption
) -> HostGoal:
    application, name = system.application.name, observed.facts.name
    budget = budget_of(
        observed,
        application,
        capacity_of(system.hosts[name], observed.facts),
        foreign_claims(observed, application),
        criticality=context.criticality,
        max_disruption=limit,
        graces=context.graces,
    )
    return HostGoal(name=name, observed=observed, desired=desired, rules=rules, context=context, budget=budget)


def _context(system: System, observed: State) -> HostContext:
    graces = {name: request.grace for name, request in system.partitions.items()}
    stated = {name: request.guest.windows_build or 0 for name, request in system.partitions.items()}
    attached = {partition.id: count_disks(observed, partition.id) for partition in observed.partitions}
    builds: dict[str, int] = {}
    for partition in observed.of(system.application.name).partitions:
        assert partition.mark is not None, "what is ours has a mark"
        name = system.moved.get(partition.mark.name, partition.mark.name)
        builds[partition.id] = partition.guest_build or stated.get(name, 0)
        if partition.settings.running and not partition.can_be_asked:
            graces[name] = Milliseconds(Fraction(0))
    return HostContext(facts=observed.facts, guest_builds=builds, graces=graces, attached=attached)


Decided = Mapping[tuple[str, str], ClassValues]
"""By partition (empty: the host) and class."""


def threads_of(decided: Decided, system: System, members: Mapping[str, tuple[str, ...]]) -> tuple[ThreadClass, ...]:
    """The robotic classes of every operating system, the host's own first, the highest threads first.

    Args:
        decided: what the planner chose.
        system: what the manifest says.
        members: by partition (empty: the host) the components whose threads run there.
    """
    made = [
        ThreadClass(
            inside=inside,
            task=name,
            category=values.category.value,
            thread_priority=values.thread_priority,
            components=tuple(user for user in _users(system, members.get(inside, ()), name)),
        )
        for (inside, name), values in decided.items()
    ]
    return tuple(
        sorted(made, key=lambda thread_class: (thread_class.inside, -thread_class.thread_priority, thread_class.task))
    )


def _users(system: System, members: tuple[str, ...], task: str) -> Iterator[str]:
    users = [system.components[name] for name in members]
    named = [user for user in users if user.task is not None and user.task.lower() == task.lower()]
    yield from (component.name for component in most_critical_first(named))
