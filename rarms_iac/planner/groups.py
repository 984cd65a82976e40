"""Which components share a partition, before anything is searched: what `partitions` and `together` say."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

from rarms_iac.model.names import renaming
from rarms_iac.model.state import Partition
from rarms_iac.model.system import Component, Headroom, PartitionRequest, RunsOn, System, bound_together


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """The members of a partition, the most critical first, and what the manifest says of the partition."""

    name: str
    members: tuple[Component, ...]
    request: PartitionRequest
    headroom: Headroom = Headroom.BY_CRITICALITY

    @property
    def criticality(self) -> int:
        """The highest of its members'."""
        return max((member.criticality for member in self.members), default=0)

    @property
    def has_apt(self) -> bool:
        """Whether a member has an APT, so that neither a cap nor a low weight may falsify what was measured."""
        return any(member.apt for member in self.members)

    def may_run_on(self, host: str) -> bool:
        """Return whether the manifest allows all members on the host of this name.

        Returns:
            True where they name no hosts, too.
        """
        return all(member.may_run_on(host) for member in self.members)


def groups_of(system: System) -> tuple[Group, ...]:
    """Group the components into partitions.

    What `partitions` of the manifest says stands. Each other component gets a partition of its own name; those that
    must be together share one, called after the most critical, ties by name.

    Args:
        system: the manifest. Components that run on a host, outside of partitions, are left out.

    Returns:
        The groups, by name.
    """
    inside = {name: component for name, component in system.components.items() if component.runs_on is RunsOn.PARTITION}
    spoken_for: set[str] = set()
    headroom = system.policy.headroom

    def group(name: str, members: list[Component], request: PartitionRequest) -> Group:
        ordered = most_critical_first(members)
        return Group(name=name, members=ordered, request=request, headroom=headroom)

    groups = []
    for request in system.partitions.values():
        members = [inside[name] for name in request.components if name in inside]
        spoken_for.update(request.components)
        if members:
            groups.append(group(request.name, members, request))
    free = {name: component for name, component in inside.items() if name not in spoken_for}
    for together in _together(free):
        name = most_critical_first(together)[0].name
        groups.append(group(name, together, PartitionRequest(name=name, components=())))
    return tuple(sorted(groups, key=lambda group: group.name))


def unnamed_partitions(wanted: Collection[str], moved: Mapping[str, str], own: Iterable[Partition]) -> frozenset[str]:
    """Find the partitions on a host that the manifest no longer names.

    Args:
        own: the machines there with the application's mark.

    Returns:
        The names in their marks.
    """
    there = {partition.mark.name for partition in own if partition.mark}
    new = renaming(there, wanted, moved).new
    return frozenset(name for name in there if new[name] not in wanted)


def may_share(*groups: Group) -> bool:
    """Tell whether the manifest allows that these groups become one partition.

    `apart` and `dedicated` of a member forbid it. So does `protect` of any group but the most critical: the new
    partition takes that one's name, and the others are no longer wanted.

    Returns:
        False where a rule of any member forbids it; whether it fits a host is not looked at.

    Raises:
        ValueError: there are none.
    """
    members = [member for group in groups for member in group.members]
    names = {member.name for member in members}
    if any(member.dedicated or names & set(member.apart) for member in members):
        return False
    _, *others = sorted(groups, key=lambda group: (-group.criticality, group.name))
    return not any(group.request.protect for group in others)


def most_critical_first(components: Iterable[Component]) -> tuple[Component, ...]:
    """Sort components by criticality, equal ones by name.

    Returns:
        All of them, the most critical first.
    """
    return tuple(sorted(components, key=lambda component: (-component.criticality, component.name)))


def _together(free: Mapping[str, Component]) -> Iterable[list[Component]]:
    """Return the components that share a partition; the manifest's checks tell of other names in `together`."""
    parts: dict[str, list[Component]] = {}
    for name, first in bound_together(free).items():
        parts.setdefault(first, []).append(free[name])
    return parts.values()
