"""The multimedia classes of Windows stay as they are."""

from collections.abc import Iterator

from rarms_iac.manifest.checks.common import task_wish
from rarms_iac.model.diagnostics import Diagnostic, Finding, Place, Places, Severity
from rarms_iac.model.names import ROBOTIC_TASKS, is_shipped_task
from rarms_iac.model.system import System

FINDING = Finding(code="RARMS053", severity=Severity.ERROR, summary="A task class of Windows would be replaced")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of classes that come with Windows and are wanted otherwise without `replace_shipped`."""
    for task in system.tasks.values():
        if is_shipped_task(task.name) and not task.replace_shipped:
            yield _told(places.key("tasks", task.name), task.name)
    for component in system.components.values():
        task_name = component.task
        if task_name is not None and is_shipped_task(task_name) and task_wish(system, task_name) is None:
            yield _told(places.value("components", component.name, "task"), task_name)


def _told(place: Place, name: str) -> Diagnostic:
    return FINDING.at(
        place,
        f'The class "{name}" comes with Windows and other programs rely on it; rarms would set its values.',
        f"Take a robotic class such as {ROBOTIC_TASKS[1]}, or say `replace_shipped: true` in `tasks.{name}`.",
        address=f"task/{name}",
    )
