"""Task classes have users."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import System

FINDING = Finding(code="RARMS087", severity=Severity.NOTE, summary="A task class that no component joins")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of entries of `tasks` that no component names."""
    used = {component.task.lower() for component in system.components.values() if component.task is not None}
    for name in system.tasks:
        if name.lower() not in used:
            yield FINDING.at(
                places.key("tasks", name),
                f"No component says `task: {name}`: nothing would run in it.",
                "Name it at a component, or remove it.",
                address=f"task/{name}",
            )
