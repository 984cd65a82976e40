"""The packing problem, made of manifest and hosts; and its answer, turned into a layout."""

from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from rarms_iac.model.capacity import CheckedCapacity
from rarms_iac.model.claims import Claim, DeadlineClaim
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import Host, Mechanism, ProviderKind, SimulatedHost
from rarms_iac.model.layout import ChosenLayout, Infeasible, Layout, PlacedPartition, Placement
from rarms_iac.model.names import renaming
from rarms_iac.model.seen_host import SeenHost, seen_hosts
from rarms_iac.model.state import USUAL_DEADLINE_PERCENT, State
from rarms_iac.model.system import RunsOn, System
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.mechanism import cannot_be_made, cannot_have_reserve, deadline_percent, mechanism_of
from rarms_iac.planner.packing.pack import can_pack, pack
from rarms_iac.planner.packing.values import Bin, Item, NoPacking, Packing, hosts_can_hold, objective_of
from rarms_iac.planner.reservations import ReservationSource, depends_on_a_log
from rarms_iac.planner.sizes import size
from rarms_iac.texts.messages import natural_order


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """The partitions to place, and the hosts that each may run on."""

    system: System
    groups: tuple[Group, ...]
    reservations: ReservationSource
    sizes: Mapping[str, Mapping[str, PlacedPartition]]  # by partition, then host; hosts that are alike share one value
    claims: Mapping[str, Mapping[str, Claim]]  # likewise
    blocked: Mapping[str, tuple[Diagnostic, ...]]  # by partition: why a host that it may run on cannot take it
    items: tuple[Item, ...]  # without the hosts that a check would refuse, while a partition has others
    bins: tuple[Bin, ...]
    current_hosts: Mapping[str, str]  # by partition; those that are on none are left out
    states: Mapping[str, State]  # of the hosts that were looked at, by name
    seen: Mapping[str, SeenHost]  # every host of the system, by name
    may_move: bool

    def without_checks(self) -> "Problem":
        """Return the same problem where only room counts: a check may refuse its layout, and then names the reason."""
        items = (_item(group.name, self.claims[group.name], self) for group in self.groups)
        bins = (
            Bin(name=host.name, capacity=seen.capacity, foreign_claims=seen.claims)
            for host in by_name(self.system.hosts)
            for seen in [self.seen[host.name]]
        )
        return replace(self, items=tuple(items), bins=tuple(bins))

    def partition_on(self, partition: str, host: str) -> PlacedPartition:
        """Return the partition on this host, on which it may run.

        Args:
            host: one of those in its `sizes`.

        Returns:
            What it gets there.
        """
        return replace(self.sizes[partition][host], host=host)


def problem_of(
    system: System, reservations: ReservationSource, states: Mapping[str, State], *, may_move: bool
) -> Problem:
    """Put together what the search is given: who may go where, and what it claims there.

    A partition is sized once for all hosts on which it gets the same.

    Args:
        states: the hosts that were looked at, by name; the others count as the manifest has them.
        may_move: whether a partition may leave the host that it is on; if not, it is only offered that host.

    Returns:
        The problem, with the causes that need no search.
    """
    groups = groups_of(system)
    seen = seen_hosts(system.hosts, system.application.name, states)
    current_hosts = _current_hosts(system, groups, seen)
    alike = _kinds(system, _traits)
    alike_in_logs = _kinds(system, lambda host: (_traits(host), reservations.depends_on(host)))
    sizes: dict[str, Mapping[str, PlacedPartition]] = {}
    blocked: dict[str, tuple[Diagnostic, ...]] = {}
    for group in groups:
        kinds = alike_in_logs if depends_on_a_log(group) else alike
        sizes[group.name], blocked[group.name] = _sizes(group, kinds, reservations, seen)
    problem = Problem(
        system=system,
        groups=groups,
        reservations=reservations,
        sizes=sizes,
        claims={name: _claims(of) for name, of in sizes.items()},
        blocked=blocked,
        items=(),
        bins=(),
        current_hosts=current_hosts,
        states=states,
        seen=seen,
        may_move=may_move,
    )
    items = tuple(_item(group.name, _checked_claims(group, problem), problem) for group in groups)
    has_deadlines = any(isinstance(claim, DeadlineClaim) for item in items for claim in item.claims.values())
    bins = (_checked_bin(seen[host.name], has_deadlines=has_deadlines) for host in by_name(system.hosts))
    return replace(problem, items=items, bins=tuple(bins))


def system_around(problem: Problem, hosts: Collection[str]) -> System:
    """Return the part of a manifest that shares hosts with these, directly or through another partition.

    What is left out neither takes room there nor can make room there. Where the partitions that cannot be on these
    hosts do not fit the other hosts, those have no room for anything else: then only these hosts are in the part, and
    all partitions that may be on them.

    Args:
        hosts: Names of hosts of the problem; all of them are in the part.

    Returns:
        The manifest with the hosts, the partitions and the components of that part only.
    """
    homes = {group.name: _homes(group, problem) for group in problem.groups}
    reached = set(hosts)
    while more := set().union(*(names for names in homes.values() if names & reached)) - reached:
        reached |= more
    elsewhere = [item for item in problem.items if homes[item.name] & reached and not homes[item.name] & set(hosts)]
    if not can_pack(elsewhere, [each for each in problem.bins if each.name in reached.difference(hosts)]):
        reached = set(hosts)
    system, part = problem.system, [group for group in problem.groups if homes[group.name] & reached]
    members = {member.name for group in part for member in group.members}
    names = {group.name for group in part}
    return replace(
        system,
        hosts={name: host for name, host in system.hosts.items() if name in reached},
        components={name: each for name, each in system.components.items() if name in members},
        partitions={name: each for name, each in system.partitions.items() if name in names},
    )


def _homes(group: Group, problem: Problem) -> set[str]:
    """Return the hosts on which the search may place a partition; if its size is unknown, those of the manifest."""
    item = next((item for item in problem.items if item.name == group.name and item.claims), None)
    return set(item.claims) if item else {name for name in problem.system.hosts if group.may_run_on(name)}


def _current_hosts(system: System, groups: Sequence[Group], seen: Mapping[str, SeenHost]) -> Mapping[str, str]:
    """Return the host of each partition that is on one, by the name that it is to have."""
    wanted = {group.name for group in groups}
    return {
        name: host
        for host in sorted(seen, reverse=True)
        for name in renaming(seen[host].present, wanted, system.moved).new.values()
    }


def _checked_bin(seen: SeenHost, *, has_deadlines: bool) -> Bin:
    """Return the host with all that its checks bound; as `without_checks` has it, where they bound nothing."""
    capacity, provider, admitted = seen.capacity, seen.host.provider, seen.facts.deadline_percent
    by_script, by_deadline = provider is ProviderKind.HYPERV, has_deadlines and provider is ProviderKind.LINUX
    if by_script or by_deadline:
        percent = USUAL_DEADLINE_PERCENT if admitted is None else admitted
        capacity = CheckedCapacity(
            logical_processors=capacity.logical_processors,
            processors=capacity.processors,
            memory=capacity.memory,
            sharing=capacity.sharing,
            by_script=by_script,
            deadline=percent * seen.facts.logical_processors if by_deadline else None,
        )
    return Bin(name=seen.name, capacity=capacity, foreign_claims=seen.claims)


def _checked_claims(group: Group, problem: Problem) -> Mapping[str, Claim]:
    """Return a partition's claims on the hosts where no check refuses it.

    Where every host is refused, return all of them.
    """
    sizes, hosts = problem.sizes[group.name], problem.system.hosts
    claims = {
        name: _with_deadline(claim, sizes[name], group, hosts[name])
        for name, claim in problem.claims[group.name].items()
    }
    current = problem.current_hosts.get(group.name, "")
    request = problem.system.partitions.get(group.name)
    if current in claims and (problem.seen[current].is_pinned(group.name) or (request and request.protect)):
        return {current: claims[current]}
    allowed: dict[str, Claim] = {}
    for name, claim in claims.items():
        seen, partition = problem.seen[name], sizes[name]
        if name != current and (group.name in seen.taken_names or cannot_be_made(partition, seen.state)):
            continue
        if not cannot_have_reserve(partition.settings, group, seen, problem.system.policy):
            allowed[name] = claim
    return allowed or claims


def _with_deadline(claim: Claim, partition: PlacedPartition, group: Group, host: Host) -> Claim:
    settings = partition.settings
    if not settings.reserve or mechanism_of(group, host)[0] is not Mechanism.DEADLINE:
        return claim
    percent = deadline_percent(settings.reserve, settings.processors)
    return DeadlineClaim(
        processors=claim.processors, reserve=claim.reserve, memory=claim.memory, idle=claim.idle, deadline=percent
    )


def by_name(hosts: Mapping[str, Host]) -> Iterable[Host]:
    """Iterate over the hosts by name, so that the same manifest gives the same order.

    Returns:
        The hosts, sorted by name.
    """
    return (hosts[name] for name in sorted(hosts, key=natural_order))


def _kinds(system: System, depends_on: Callable[[Host], Hashable]) -> Mapping[str, tuple[Host, ...]]:
    """Group hosts on which partitions get the same, by the name of the first."""
    kinds: dict[str, list[Host]] = {}
    first: dict[Hashable, str] = {}
    for host in by_name(system.hosts):
        alike = first.setdefault(depends_on(host), host.name)
        kinds.setdefault(alike, []).append(host)
    return {name: tuple(hosts) for name, hosts in kinds.items()}


def _traits(host: Host) -> Hashable:
    """Return the facts of a host, apart from its data logs, that decide a partition's settings there."""
    settings = None if isinstance(host.settings, SimulatedHost) else host.settings
    return host.logical_processors, host.provider, settings


def _sizes(
    group: Group,
    kinds: Mapping[str, tuple[Host, ...]],
    reservations: ReservationSource,
    seen: Mapping[str, SeenHost],
) -> tuple[Mapping[str, PlacedPartition], tuple[Diagnostic, ...]]:
    """Return the group's size on each host that all its members may run on, or why it cannot be there."""
    limits = [member.hosts for member in group.members if member.hosts is not None]
    found: dict[str, PlacedPartition] = {}
    causes: dict[Diagnostic, None] = {}
    for hosts in kinds.values():
        allowed = [host for host in hosts if all(host.name in names for names in limits)]
        if not allowed:
            continue
        answer = size(group, hosts[0], reservations)
        if isinstance(answer, Diagnostic):
            causes[answer] = None
            continue
        for host in allowed:
            sharing = seen[host.name].sharing(group.name)
            found[host.name] = answer if sharing is answer.sharing else replace(answer, sharing=sharing)
    return dict(sorted(found.items())), tuple(causes)


def _claims(sizes: Mapping[str, PlacedPartition]) -> Mapping[str, Claim]:
    """Return its claims on each host, worked out once for hosts that share a size."""
    distinct = {id(partition): partition for partition in sizes.values()}
    claims = {key: partition.claim for key, partition in distinct.items()}
    return {host: claims[id(partition)] for host, partition in sizes.items()}


def _item(name: str, claims: Mapping[str, Claim], problem: Problem) -> Item:
    """Return a partition that stays where it is, also where a check refuses it there, unless it may move."""
    current = problem.current_hosts.get(name, "")
    everywhere = problem.claims[name]
    stays = current in everywhere and not problem.may_move
    return Item(
        name=name,
        claims={current: claims.get(current, everywhere[current])} if stays else claims,
        current_host=current,
    )


def solve(problem: Problem) -> Layout | Infeasible:
    """Find the best layout.

    Returns:
        The layout, one that no check refuses where there is such a one; or that there is none, with the causes that
            need no search, and whether that is proven.
    """
    if causes := tuple(_causes(problem)):
        return Infeasible(proven=True, causes=causes, relaxations=())
    packing = pack(problem.items, problem.bins)
    if isinstance(packing, NoPacking):
        unchecked = problem.without_checks()
        is_other = unchecked.bins != problem.bins and packing.undecided  # where a script places, no more may be known
        if is_other or unchecked.items != problem.items:
            packing = pack(unchecked.items, unchecked.bins)
    if isinstance(packing, NoPacking):
        return Infeasible(proven=packing.proven, causes=(), relaxations=())
    return _layout(problem, packing)


class LayoutRefused(ValueError):
    """A layout that was chosen before does not fit."""


def check_layout(problem: Problem, chosen: ChosenLayout) -> Layout:
    """Make a layout of hosts that were chosen before, without solving.

    Raises:
        LayoutRefused: a partition is missing or may not be on its host, a host has no room, or a bound is above what
            the layout reserves or moves.
    """
    for each in (problem, problem.without_checks()):
        items, hosts = each.items, chosen.hosts
        if hosts.keys() != {item.name for item in items} or any(hosts[item.name] not in item.claims for item in items):
            continue
        reserved, moves = objective_of(items, hosts)
        is_bound = chosen.reserved_bound <= reserved and chosen.moves_bound <= moves
        if is_bound and hosts_can_hold(items, each.bins, hosts):
            placement = Placement(
                reserved=reserved,
                reserved_bound=chosen.reserved_bound,
                moves=moves,
                moves_bound=chosen.moves_bound,
            )
            return _layout(problem, Packing(host_of=hosts, placement=placement))
    raise LayoutRefused


def _layout(problem: Problem, packing: Packing) -> Layout:
    partitions = [problem.partition_on(name, host) for name, host in packing.host_of.items()]
    return Layout(
        partitions=tuple(sorted(partitions, key=lambda partition: (partition.host, partition.name))),
        on_hosts=_on_hosts(problem.system),
        placement=None if all(len(item.claims) == 1 for item in problem.items) else packing.placement,
    )


def first_fit_finds_layout(problem: Problem) -> bool:
    """Say whether first fit finds a layout, however good; if not, there may be one all the same."""
    return not any(_causes(problem)) and can_pack(problem.items, problem.bins, by_first_fit=True) is True


def _causes(problem: Problem) -> Iterator[Diagnostic]:
    """Yield the obstacles of partitions that can be on none of their hosts, in any placement of the others."""
    for group in problem.groups:
        if not problem.claims[group.name]:
            yield from problem.blocked[group.name]


def _on_hosts(system: System) -> tuple[tuple[str, str], ...]:
    """Return components outside partitions with each host that they may run on: each may need their class."""
    return tuple(
        (component.name, host)
        for component in sorted(system.components.values(), key=lambda component: component.name)
        if component.runs_on is RunsOn.HOST
        for host in sorted(component.hosts if component.hosts is not None else system.hosts)
    )
