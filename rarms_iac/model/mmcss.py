"""MMCSS: what a task class's values make of its threads (windows.md 6.2), and SystemResponsiveness (windows.md 6.1).

While threads of a class have their share, they run at 26 in High, at Priority + 16 in Medium, and at
BackgroundPriority + 7 in Low. In Medium some were seen one higher and none above 23, so 8 counts as 7 does.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from rarms_iac.model.system import TaskCategory, TaskRequest

PRIORITIES = range(1, 9)
"""Priorities of a category."""

TOP_OF_MEDIUM = 7
"""The last that raises threads: none was seen above 23."""


def thread_priority(category: TaskCategory, priority: int, background_priority: int) -> int:
    """Return the priority of a class's threads while they have their share."""
    match category:
        case TaskCategory.HIGH:
            return 26
        case TaskCategory.MEDIUM:
            return 16 + min(priority, TOP_OF_MEDIUM)
        case TaskCategory.LOW:
            return 7 + background_priority


@dataclass(frozen=True, slots=True, kw_only=True)
class PriorityValues:
    """A category, and where in it."""

    category: TaskCategory
    priority: int
    background_priority: int

    @property
    def thread_priority(self) -> int:
        """What its threads run at while they have their share."""
        return thread_priority(self.category, self.priority, self.background_priority)


def values_within(request: TaskRequest) -> tuple[PriorityValues, ...]:
    """Return all values that the fixed ones allow, the highest threads first; of alike ones only one."""
    categories = tuple(TaskCategory) if request.category is None else (request.category,)
    found = {
        level_values.thread_priority: level_values
        for category in categories
        for level_values in _in_category(category, request)
    }
    return tuple(found[at] for at in sorted(found, reverse=True))


def _in_category(category: TaskCategory, request: TaskRequest) -> Iterator[PriorityValues]:
    """Yield from the highest down; of 8 and 7 in Medium, which are alike, the last.

    The number that the category does not go by is the other one, so that who read that would find the same order.
    """
    match category:
        case TaskCategory.HIGH:
            priority = request.priority or TOP_OF_MEDIUM
            yield _values(category, priority, request.background_priority or priority)
        case TaskCategory.MEDIUM:
            for priority in reversed(PRIORITIES if request.priority is None else (request.priority,)):
                yield _values(category, priority, request.background_priority or priority)
        case TaskCategory.LOW:
            for background in reversed(
                PRIORITIES if request.background_priority is None else (request.background_priority,)
            ):
                yield _values(category, request.priority or background, background)


def _values(category: TaskCategory, priority: int, background_priority: int) -> PriorityValues:
    return PriorityValues(category=category, priority=priority, background_priority=background_priority)


SYSTEM_RESPONSIVENESS = "SystemResponsiveness"
"""The registry value's name; rarms' record of it has the same, so no task class of the manifest may have it."""

USUAL = 20
"""What Windows takes for a value that is out of range, missing or of another type; per cent."""
OFF = 100
"""Switches MMCSS off."""


def taken_for(percent: int) -> int:
    """Return the number as Windows rounds it.

    Out of range it is 20, otherwise rounded down to tens (page of May 2025).
    """
    return percent // 10 * 10 if 10 <= percent <= OFF else USUAL


def is_taken_as_is(percent: int) -> bool:
    """Return whether it is 10, 20, ... 90: all versions of Microsoft's page agree on these."""
    return percent != OFF and taken_for(percent) == percent
