"""Checks of task classes (RC SS): their names, their users, and whether priorities follow criticality."""

from collections.abc import Iterator

from rarms_iac.manifest.checks.names import KEPT_NAME, NOT_USED
from rarms_iac.manifest.checks.system_lookups import known_tasks, operating_systems, task_entry
from rarms_iac.manifest.checks.violation import Path, Violation, check, violation
from rarms_iac.model.diagnostics import Finding
from rarms_iac.model.mmcss import SYSTEM_RESPONSIVENESS
from rarms_iac.model.shared_findings import CLASS_ORDER, UNKNOWN_NAME
from rarms_iac.model.system import Component, System
from rarms_iac.model.task_names import ROBOTIC_TASKS, is_shipped_task
from rarms_iac.model.wording import Suggestions


@check(Finding.error("RARMS053", "A task class of Windows would be changed"))
def shipped_task(system: System) -> Iterator[Violation]:
    """Classes that come with Windows and would be changed without `replace_shipped`."""
    for task in system.tasks.values():
        if is_shipped_task(task.name) and not task.replace_shipped:
            yield _shipped_task_violation(("tasks", task.name), task.name)
    for component in system.components.values():
        name = component.task
        if name is not None and is_shipped_task(name) and task_entry(system, name) is None:
            yield _shipped_task_violation(("components", component.name, "task"), name)


def _shipped_task_violation(path: Path, name: str) -> Violation:
    return violation(
        path,
        'The class "{task}" comes with Windows, and other programs use it. rarms would change its values.',
        f"Use a robotic class such as {ROBOTIC_TASKS[1]}, or write `replace_shipped: true` in `tasks.{name}`.",
        at_key=path[0] == "tasks",
        address=f"task/{name}",
        task=name,
    )


@check(UNKNOWN_NAME)
def unknown_task(system: System) -> Iterator[Violation]:
    """Components whose class is neither robotic, nor of Windows, nor in `tasks`."""
    known = known_tasks(system)
    folded = {name.lower() for name in known}
    suggestions = Suggestions()
    for component in system.components.values():
        task = component.task
        if task is not None and task.lower() not in folded and not is_shipped_task(task):
            similar, suggestion = suggestions.find(task, known)
            yield violation(
                ("components", component.name, "task"),
                'There is no task class "{task}".{_suggestion}',
                f"Use one of {', '.join(ROBOTIC_TASKS)}, or add `{task}: {{}}` to `tasks`.",
                task=task,
                similar=similar,
                _suggestion=suggestion,
            )


@check(KEPT_NAME)
def task_differs_in_case(system: System) -> Iterator[Violation]:
    """Yield the later of two entries that the registry would take for one."""
    first: dict[str, str] = {}
    for name in system.tasks:
        before = first.setdefault(name.lower(), name)
        if before != name:
            yield violation(
                ("tasks", name),
                '"{task}" and "{other}" are the same registry key: Windows ignores case in these names.',
                "Keep one of the two.",
                at_key=True,
                related=((("tasks", before), True, "the other one"),),
                other=before,
            )


@check(CLASS_ORDER)
def shared_task(system: System) -> Iterator[Violation]:
    """Yield the less critical users of a class, whose threads get the priority of the most critical one."""
    for group in operating_systems(system):
        most_critical: dict[str, Component] = {}
        for component in sorted(group, key=lambda component: (-component.criticality, component.name)):
            if component.task is None:
                continue
            leader = most_critical.setdefault(component.task.lower(), component)
            if leader.criticality > component.criticality:
                yield violation(
                    ("components", component.name, "task"),
                    '"{component}" (criticality {criticality}) and "{other}" ({other_criticality}) share '
                    "the class {task} in one operating system. The threads of both get the same priority.",
                    "Give the less critical component a class of its own.",
                    task=component.task,
                    criticality=component.criticality,
                    other=leader.name,
                    other_criticality=leader.criticality,
                )


@check(NOT_USED)
def unused_task(system: System) -> Iterator[Violation]:
    """Entries of `tasks` that no component names."""
    used = {component.task.lower() for component in system.components.values() if component.task is not None}
    for name in system.tasks:
        if name.lower() not in used:
            yield violation(
                ("tasks", name),
                "No component has `task: {task}`. Nothing would run in this class.",
                "Write it at a component, or remove the class.",
                at_key=True,
            )


@check(KEPT_NAME)
def task_like_a_value(system: System) -> Iterator[Violation]:
    """Classes that have the name of the value whose record lies among the records of task classes."""
    for name in system.tasks:
        if name.lower() == SYSTEM_RESPONSIVENESS.lower():
            yield _reserved_name_violation(("tasks", name), name)
    for component in system.components.values():
        if component.task is not None and component.task.lower() == SYSTEM_RESPONSIVENESS.lower():
            yield _reserved_name_violation(("components", component.name, "task"), component.task)


def _reserved_name_violation(path: Path, name: str) -> Violation:
    return violation(
        path,
        'rarms stores the value of `system_responsiveness` under the name "{task}". A task class cannot '
        "have this name.",
        "Rename the class. To set the value itself, write `system_responsiveness` at the host.",
        at_key=path[0] == "tasks",
        address=f"task/{name}",
        task=name,
    )
