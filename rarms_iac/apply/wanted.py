"""What each observed host is to look like, and all that the difference has to know beside it."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

from rarms_iac.apply.threads import threads_of
from rarms_iac.apply.void import ignored, unproven
from rarms_iac.diff.comparing.partitions import in_the_way
from rarms_iac.diff.comparing.wishes import Wishes
from rarms_iac.diff.disks import Judged, judge_disks
from rarms_iac.diff.disruption import Surroundings
from rarms_iac.diff.findings import FOREIGN_AT_NAME
from rarms_iac.diff.stepping.order import Room, room_of
from rarms_iac.model.capacity import capacity_of, foreign_claims
from rarms_iac.model.changes import Address
from rarms_iac.model.diagnostics import Diagnostic, Place, Places, Related
from rarms_iac.model.layout import Layout
from rarms_iac.model.plan import ThreadClass
from rarms_iac.model.state import Disk, Partition, State, TaskClass
from rarms_iac.model.system import Disruption, HypervHost, SimulatedHost, System
from rarms_iac.model.where import partition_place
from rarms_iac.planner.desired import desired_state
from rarms_iac.planner.findings import MEMORY, PACKING, RESERVATIONS
from rarms_iac.planner.groups import groups_of
from rarms_iac.planner.layout import plan_layout
from rarms_iac.planner.problem import host_view
from rarms_iac.planner.reservations import FixedReservations, ReservationSource
from rarms_iac.planner.task_classes import ClassValues

FIXED = FixedReservations()


@dataclass(frozen=True, slots=True, kw_only=True)
class HostWish:
    """One host: what is there, what is wanted, and the rules between the two."""

    name: str
    observed: State
    desired: State
    wishes: Wishes
    around: Surroundings
    room: Room
    unused: frozenset[str]
    by_hand: tuple[TaskClass, ...] = ()  # wanted in guests that nobody could look into
    threads: tuple[ThreadClass, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """All observed hosts, by name; none of them where no layout exists."""

    layout: Layout | None
    hosts: Mapping[str, HostWish]
    findings: tuple[Diagnostic, ...]
    certificate: str = ""  # that no layout exists, where there is one


def wanted(
    system: System,
    observed: Mapping[str, State],
    places: Places,
    limit: Disruption,
    reservations: ReservationSource = FIXED,
) -> Wanted:
    """The layout that the manifest asks for, host by host; none where a host may have more than can be seen."""
    if hidden := tuple(unproven(observed.values(), places)):
        return Wanted(layout=None, hosts={}, findings=hidden)
    views = {name: host_view(state, system.application.name) for name, state in sorted(observed.items())}
    planning = plan_layout(system, reservations, views, places, max_disruption=limit)
    if not isinstance(planning.answer, Layout):
        namesakes = tuple(map(_told_first, _namesakes(system, observed, places)))
        lacking = map(_behind_a_namesake, planning.findings) if namesakes else planning.findings
        told = (*namesakes, *lacking)
        return Wanted(layout=None, hosts={}, findings=told, certificate=planning.answer.certificate)
    hosts: dict[str, HostWish] = {}
    found = planning.findings
    for name, state in sorted(observed.items()):
        desired = desired_state(system, planning.answer, state, places)
        found = (*found, *desired.findings, *ignored(desired.state, places))
        wishes = Wishes(
            moved=system.moved,
            protected=desired.protected,
            replaceable=desired.replaceable,
            unused=desired.unused,
            where=_where(system, places, name, desired.classes),
        )
        around = replace(_around(system, state), making=desired.making, criticality=desired.criticality)
        wish = _wish(system, state, desired.state, wishes, around, limit)
        members = {
            partition.name: partition.components for partition in planning.answer.partitions if partition.host == name
        }
        members[""] = tuple(one for one, place in planning.answer.on_hosts if place == name)
        threads = threads_of(desired.classes, system, members)
        hosts[name] = replace(wish, by_hand=desired.by_hand, threads=threads)
    return Wanted(layout=planning.answer, hosts=hosts, findings=found)


def _namesakes(system: System, observed: Mapping[str, State], places: Places) -> Iterator[Diagnostic]:
    """Machines of others called as our partitions: one of them may be what there is no room beside."""
    names = {group.name for group in groups_of(system)}
    for _, state in sorted(observed.items()):
        for partition in state.partitions:
            is_ours = partition.mark is not None and partition.mark.application == system.application.name
            if not is_ours and partition.settings.name in names:
                yield in_the_way(partition, partition_place(system, places, partition.settings.name))


def _told_first(diagnostic: Diagnostic) -> Diagnostic:
    """The same without a line of its own, because findings are told in the order of their lines."""
    if diagnostic.place is None:
        return diagnostic
    return replace(
        diagnostic, place=None, related=(*diagnostic.related, Related(place=diagnostic.place, says="wanted here"))
    )


def _behind_a_namesake(diagnostic: Diagnostic) -> Diagnostic:
    """What lacks room: ways out were sought beside the namesake, and taking it over may need none of them."""
    if diagnostic.code not in {RESERVATIONS.code, MEMORY.code, PACKING.code}:
        return diagnostic
    advice = f"First settle the machine that has a wanted name ({FOREIGN_AT_NAME.code}): it takes room, too."
    return replace(diagnostic, advice=advice)


def _where(
    system: System, places: Places, host: str, classes: Mapping[tuple[str, str], ClassValues]
) -> Callable[[Address], Place | None]:
    """Which line asks for what stands at an address: of a task class, the component that names it."""

    def where(address: Address) -> Place | None:
        if address.responsiveness:
            return places.value("hosts", host, "system_responsiveness")
        if address.task:
            values = classes.get((address.partition, address.task))
            return places.value("components", values.user, "task") if values else None
        if address.partition in system.moved:
            return places.key("moved", address.partition)
        return partition_place(system, places, address.partition)

    return where


def nothing_wanted(
    system: System, observed: Mapping[str, State], places: Places, *, remove_disks: bool = False
) -> Wanted:
    """Every observed host without anything of this application: what `rarms destroy` wants.

    With `remove_disks` also without the disks that rarms made for it.
    """
    if hidden := tuple(unproven(observed.values(), places)):
        return Wanted(layout=None, hosts={}, findings=hidden)
    protected = frozenset(name for name, wish in system.partitions.items() if wish.protect)
    hosts = {
        name: _wish(
            system,
            state,
            replace(state, partitions=(), tasks=(), responsiveness=None),
            Wishes(protected=protected, where=_where(system, places, name, {})),
            replace(_around(system, state), disks=_disks_to_go(system, state) if remove_disks else {}),
            Disruption.REMOVAL,
        )
        for name, state in sorted(observed.items())
    }
    return Wanted(layout=None, hosts=hosts, findings=())


def judged_disks(system: System, observed: State, machine: Partition) -> Iterator[Judged]:
    """The disks of a machine of ours, with why each stays where its removal is asked for."""
    host = system.hosts[observed.facts.name].settings
    name = machine.mark.name if machine.mark else ""
    own = system.partitions[name].hyperv.vm_path if name in system.partitions else None
    usual = host.vm_path if isinstance(host, HypervHost) else None
    return judge_disks(machine, observed, [one for one in (own, usual, observed.facts.disk_folder) if one])


def _disks_to_go(system: System, observed: State) -> Mapping[str, tuple[Disk, ...]]:
    return {
        partition.id: tuple(judged.disk for judged in judged_disks(system, observed, partition) if not judged.stays)
        for partition in observed.of(system.application.name).partitions
    }


def _wish(
    system: System, observed: State, desired: State, wishes: Wishes, around: Surroundings, limit: Disruption
) -> HostWish:
    application, name = system.application.name, observed.facts.name
    room = room_of(
        observed,
        application,
        capacity_of(system.hosts[name], observed.facts),
        foreign_claims(observed, application),
        criticality=around.criticality,
        max_disruption=limit,
        graces=around.graces,
    )
    return HostWish(
        name=name,
        observed=observed,
        desired=desired,
        wishes=wishes,
        around=around,
        room=room,
        unused=wishes.unused,
    )


def _around(system: System, observed: State) -> Surroundings:
    settings = system.hosts[observed.facts.name].settings
    guest_build = settings.guest_windows_build if isinstance(settings, SimulatedHost) else 0
    graces = {name: wish.grace for name, wish in system.partitions.items()}
    return Surroundings(facts=observed.facts, guest_build=guest_build, graces=graces)
