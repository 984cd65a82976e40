"""What threads run at once a plan is done: robotic task classes beside those of others, system by system."""

from collections.abc import Iterator, Mapping

from rarms_iac.model.mmcss import thread_priority
from rarms_iac.model.plan import ThreadClass
from rarms_iac.model.state import RegistryValue, State, TaskClass, ValueKind
from rarms_iac.model.system import System, TaskCategory
from rarms_iac.planner.groups import most_critical_first
from rarms_iac.planner.task_classes import ClassValues

Decided = Mapping[tuple[str, str], ClassValues]
"""By partition (empty: the host) and class."""


def threads_of(decided: Decided, system: System, members: Mapping[str, tuple[str, ...]]) -> tuple[ThreadClass, ...]:
    """The robotic classes of every operating system, the host's own first, the highest threads first.

    Args:
        decided: what the planner chose.
        system: what the manifest says.
        members: by partition (empty: the host) the components whose threads run there.
    """
    made = [
        ThreadClass(
            inside=inside,
            task=name,
            category=values.category.value,
            thread_priority=values.thread_priority,
            components=tuple(user for user in _users(system, members.get(inside, ()), name)),
        )
        for (inside, name), values in decided.items()
    ]
    return tuple(
        sorted(made, key=lambda thread_class: (thread_class.inside, -thread_class.thread_priority, thread_class.task))
    )


def _users(system: System, members: tuple[str, ...], task: str) -> Iterator[str]:
    users = [system.components[name] for name in members]
    named = [user for user in users if user.task is not None and user.task.lower() == task.lower()]
    yield from (component.name for component in most_critical_first(named))


def above(threads: tuple[ThreadClass, ...], observed: State, application: str) -> Iterator[tuple[str, TaskClass, int]]:
    """Classes of others, in Medium or High, whose threads run above a robotic class of the same operating system.

    Yields:
        the partition (empty: the host), the class, and what its threads run at.
    """
    lowest: dict[str, int] = {}
    for thread in threads:
        lowest[thread.inside] = min(thread.thread_priority, lowest.get(thread.inside, thread.thread_priority))
    wanted = {(thread.inside, thread.task.lower()) for thread in threads}
    for task in observed.tasks:
        is_ours = task.record is not None and task.record.application == application
        if is_ours or task.inside not in lowest or (task.inside, task.name.lower()) in wanted:
            continue
        runs_at = _runs_at(task.values)
        if runs_at is not None and runs_at > lowest[task.inside]:
            yield task.inside, task, runs_at


def _runs_at(values: Mapping[str, RegistryValue]) -> int | None:
    """What threads of a class that somebody else made run at; None where its values do not say, or in Low."""
    by_name = {name.lower(): value for name, value in values.items()}
    category = by_name.get("scheduling category")
    priority = by_name.get("priority")
    found = {one.value.lower(): one for one in TaskCategory}.get(str(category.data).lower() if category else "")
    level = priority.data if priority is not None and priority.kind is ValueKind.DWORD else None
    if found is TaskCategory.HIGH:
        return thread_priority(found, 1, 1)
    if found is TaskCategory.MEDIUM and isinstance(level, int):
        return thread_priority(found, level, 1)
    return None
