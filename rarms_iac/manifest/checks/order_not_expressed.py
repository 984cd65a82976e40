"""Fixed task priorities express the criticalities."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations

from rarms_iac.manifest.checks.common import operating_systems, task_wish
from rarms_iac.model.class_values import values_within
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Related, Severity
from rarms_iac.model.system import Component, System, TaskCategory, TaskWish

FINDING = Finding(
    code="RARMS056", severity=Severity.WARNING, summary="The fixed priorities do not keep the order of criticality"
)


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of two classes in one operating system whose fixed values put the less critical one level or above."""
    told: set[tuple[str, str]] = set()
    for group in operating_systems(system):
        classes = _classes(system, group)
        for higher, lower in permutations(classes, 2):
            pair = (higher.wish.name, lower.wish.name)
            if higher.criticality > lower.criticality and higher.best <= lower.worst and pair not in told:
                told.add(pair)
                yield _told(places, higher, lower)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Class:
    """A class in one operating system, with the thread priorities that its fixed values leave possible."""

    wish: TaskWish
    component: str  # its most critical user
    criticality: int
    worst: int
    best: int


def _classes(system: System, group: list[Component]) -> list[_Class]:
    found: dict[str, _Class] = {}
    for component in sorted(group, key=lambda component: (-component.criticality, component.name)):
        wish = None if component.task is None else task_wish(system, component.task)
        if wish is not None and wish.name not in found:
            worst, best = thread_priorities(wish)
            found[wish.name] = _Class(
                wish=wish, component=component.name, criticality=component.criticality, worst=worst, best=best
            )
    return list(found.values())


def thread_priorities(wish: TaskWish) -> tuple[int, int]:
    """The lowest and highest thread priority that the fixed values leave possible (FACTS 6.2)."""
    possible = values_within(wish)
    return possible[-1].thread_priority, possible[0].thread_priority


def _told(places: Places, higher: _Class, lower: _Class) -> Diagnostic:
    same = "the same thread priority as" if higher.best == lower.worst else "a lower thread priority than"
    both_high = higher.wish.category is lower.wish.category is TaskCategory.HIGH
    reason = " In category High, Windows takes every priority for the same." if both_high else ""
    return FINDING.at(
        places.key("tasks", higher.wish.name),
        f'"{higher.component}" (criticality {higher.criticality}) is more critical than "{lower.component}" '
        f"({lower.criticality}), but {higher.wish.name} gives it {same} {lower.wish.name}.{reason}",
        "Leave category and priority open, so that rarms chooses them, or put both into Medium in the right order.",
        address=f"task/{higher.wish.name}",
        related=(Related(place=places.key("tasks", lower.wish.name), says="the less critical class"),),
    )
