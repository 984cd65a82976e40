"""No task class is called like the value whose record lies among the records of task classes."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Place, Places, Severity
from rarms_iac.model.responsiveness import SYSTEM_RESPONSIVENESS
from rarms_iac.model.system import System

FINDING = Finding(
    code="RARMS229", severity=Severity.ERROR, summary="A task class is called like a value that rarms sets"
)


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of classes of that name, whatever their case, where they are described and where they are named."""
    for name in system.tasks:
        if _is_taken(name):
            yield _told(places.key("tasks", name), name)
    for component in system.components.values():
        if component.task is not None and _is_taken(component.task):
            yield _told(places.value("components", component.name, "task"), component.task)


def _is_taken(name: str) -> bool:
    return name.lower() == SYSTEM_RESPONSIVENESS.lower()


def _told(place: Place, name: str) -> Diagnostic:
    return FINDING.at(
        place,
        f'The record of the class "{name}" would lie where rarms keeps that of `system_responsiveness`.',
        "Give the class another name; what the host keeps for others is said with `system_responsiveness`.",
        address=f"task/{name}",
    )
