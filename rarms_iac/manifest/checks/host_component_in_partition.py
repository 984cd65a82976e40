"""A component of the host is in no partition."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Place, Places, Severity
from rarms_iac.model.system import RunsOn, System

FINDING = Finding(
    code="RARMS046", severity=Severity.ERROR, summary="A component that runs on the host is in a partition"
)


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of partitions, and of `together`, that name a component with `runs_on: host`."""
    for partition in system.partitions.values():
        for number, name in enumerate(partition.components):
            if _on_host(system, name):
                place = places.value("partitions", partition.name, "components", number)
                yield _told(place, name, f"partition/{partition.name}")
    for component in system.components.values():
        for number, name in enumerate(component.together):
            if _on_host(system, name) and component.runs_on is RunsOn.PARTITION:
                place = places.value("components", component.name, "together", number)
                yield _told(place, name, f"component/{component.name}")


def _on_host(system: System, name: str) -> bool:
    return name in system.components and system.components[name].runs_on is RunsOn.HOST


def _told(place: Place, name: str, where: str) -> Diagnostic:
    return FINDING.at(
        place,
        f'"{name}" says `runs_on: host`: it runs in the operating system of the host itself, not in a partition.',
        "Take it out here, or remove its `runs_on`.",
        address=where,
    )
