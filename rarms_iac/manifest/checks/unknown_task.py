"""A component's task class is a known one."""

from collections.abc import Iterator

from rarms_iac.manifest.checks.common import known_tasks
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.names import ROBOTIC_TASKS, is_shipped_task
from rarms_iac.model.spelling import suggestion
from rarms_iac.model.system import System

FINDING = Finding(code="RARMS054", severity=Severity.ERROR, summary="A task class that nobody defines")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of components whose class is neither robotic, nor of Windows, nor in `tasks`."""
    known = known_tasks(system)
    folded = {name.lower() for name in known}
    for component in system.components.values():
        task = component.task
        if task is not None and task.lower() not in folded and not is_shipped_task(task):
            yield FINDING.at(
                places.value("components", component.name, "task"),
                f'There is no task class "{task}".{suggestion(task, known)}',
                f"Take one of {', '.join(ROBOTIC_TASKS)}, or add `{task}: {{}}` under `tasks`.",
                address=f"component/{component.name}",
            )
