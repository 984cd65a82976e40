"""Components that share a partition may share a host."""

from collections.abc import Iterator

from rarms_iac.manifest.checks.common import companions, entry_of, hosts_for, may_run_on, members, some
from rarms_iac.model.diagnostics import Diagnostic, Finding, Place, Places, Severity
from rarms_iac.model.system import Component, System

FINDING = Finding(
    code="RARMS093", severity=Severity.ERROR, summary="Components of one partition have no host in common"
)


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of partitions and of `together` whose components allow no common host."""
    for partition in system.partitions.values():
        inside = members(system, partition)
        if inside and _without_host(system, inside):
            place = places.value("partitions", partition.name, "components")
            yield _told(place, system, inside, f"partition/{partition.name}")
    for inside in _bound(system):
        if _without_host(system, inside):
            place = places.value("components", inside[0].name, "together")
            yield _told(place, system, inside, f"component/{inside[0].name}")


def _bound(system: System) -> list[list[Component]]:
    listed = entry_of(system)
    groups: dict[str, list[Component]] = {}
    for name, group in sorted(companions(system).items()):
        if name not in listed:
            groups.setdefault(group, []).append(system.components[name])
    return [
        sorted(group, key=lambda component: (not component.together, component.name))
        for group in groups.values()
        if len(group) > 1
    ]


def _without_host(system: System, inside: list[Component]) -> bool:
    return all(may_run_on(system, component) for component in inside) and not hosts_for(system, inside)


def _told(place: Place, system: System, inside: list[Component], where: str) -> Diagnostic:
    each = some(
        f"{component.name} on {some(host.name for host in may_run_on(system, component))}" for component in inside
    )
    return FINDING.at(
        place,
        f"They share a partition, and no host is allowed to all of them: {each}.",
        "Allow them a common host, or part them.",
        address=where,
    )
