"""A class in one operating system serves one criticality."""

from collections.abc import Iterator

from rarms_iac.manifest.checks.common import operating_systems
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import Component, System

FINDING = Finding(
    code="RARMS057", severity=Severity.WARNING, summary="Components of different criticality share a task class"
)


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of the less critical users of a class, whose threads get the priority of the most critical one."""
    for group in operating_systems(system):
        most: dict[str, Component] = {}
        for component in sorted(group, key=lambda component: (-component.criticality, component.name)):
            if component.task is None:
                continue
            leader = most.setdefault(component.task.lower(), component)
            if leader.criticality > component.criticality:
                yield FINDING.at(
                    places.value("components", component.name, "task"),
                    f'"{component.name}" (criticality {component.criticality}) and "{leader.name}" '
                    f"({leader.criticality}) share "
                    f"the class {component.task} in one operating system: their threads get one priority, that of the "
                    "more critical one.",
                    "Give the less critical one a class of its own.",
                    address=f"component/{component.name}",
                )
