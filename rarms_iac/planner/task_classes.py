"""Values of robotic task classes, so that the wanted order of threads is really there (windows.md 6.1, 6.2).

The order is promised among the components of one operating system, while threads have the share that MMCSS gives them.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.mmcss import PriorityValues, thread_priority
from rarms_iac.model.state import RegistryValue, ValueKind
from rarms_iac.model.system import Component, TaskCategory, TaskRequest
from rarms_iac.planner.groups import most_critical_first
from rarms_iac.planner.task_class_values import ALL, REAL_TIME, chosen_values, criticality_of, masks_of
from rarms_iac.running.thread_priorities import ThreadRule
from rarms_iac.texts.findings import CLASS_ORDER, NEIGHBOURS

CLOCK_RATE = 10_000
"""In 100 ns: other values were seen to stop the task from working."""

GPU_PRIORITY = 8
"""Not used by Windows; what its own classes say."""

MOST_BUDGET = 90
"""The most of each processor, in per cent, that a control group of version 1 gets as its real-time budget."""


def budget_percent(reserve: int) -> int:
    """Return the real-time budget of a partition with task classes, in per cent of each processor, from its reserve."""
    return min(reserve, MOST_BUDGET)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClassValues:
    """The values of a class in one operating system."""

    name: str
    category: TaskCategory
    priority: int
    background_priority: int
    criticality: int  # the highest of those who name it
    user: str  # who that is
    affinity: int = ALL  # the processors of its operating system that its threads may use: a bit each; 0: all

    @property
    def thread_priority(self) -> int:
        """The priority of its threads while they have their share of the processor."""
        return thread_priority(self.category, self.priority, self.background_priority)


@dataclass(frozen=True, slots=True, kw_only=True)
class Classes:
    """The classes of one operating system, by name, and what they cannot express."""

    classes: tuple[ClassValues, ...]
    findings: tuple[Diagnostic, ...]


def classes_of(
    components: Iterable[Component],
    requests: Mapping[str, TaskRequest],
    inside: str,
    places: Places,
    *,
    processors: int = 0,
) -> Classes:
    """Decide the values of every task class that these components of one operating system name.

    Equally critical classes share a thread priority where the values that the manifest fixes allow it.

    Args:
        components: all that run in this operating system; those without a class matter for affinity only.
        requests: what `tasks` of the manifest says of a class, by name in any case; it is never overruled.
        inside: the partition whose guest it is; empty: the host's own Windows.
        places: lines of the manifest, for the findings.
        processors: how many this operating system has; 0: unknown, and then no class is kept to some of them.

    Returns:
        The classes by name, and findings on what their values cannot keep in order.
    """
    named: dict[str, list[Component]] = {}
    nameless: list[list[Component]] = []  # of no class: they are kept to nothing, and may use any processor
    for component in components:
        if component.task_class is None:
            nameless.append([component])
        else:
            named.setdefault(component.task_class.lower(), []).append(component)
    fixed = {name.lower(): request for name, request in requests.items()}
    by_weight = sorted(named.values(), key=lambda users: (-criticality_of(users), _called(users, fixed)))
    decided = _decide(by_weight, fixed)
    diagnostics = (*_out_of_order(decided, inside, places), *_remarks(decided, inside, places))
    masks = masks_of([*by_weight, *nameless], processors)
    decided = [replace(class_values, affinity=masks.get(class_values.name.lower(), ALL)) for class_values in decided]
    return Classes(classes=tuple(sorted(decided, key=lambda class_values: class_values.name)), findings=diagnostics)


def _called(users: Sequence[Component], fixed: Mapping[str, TaskRequest]) -> str:
    """Return the class's name as `tasks` writes it, or as its first user by name does."""
    first = min(users, key=lambda user: user.name).task_class
    assert first is not None
    return fixed[first.lower()].name if first.lower() in fixed else first


def _decide(by_weight: Sequence[Sequence[Component]], fixed: Mapping[str, TaskRequest]) -> list[ClassValues]:
    levels = [list(level) for _, level in groupby(by_weight, key=criticality_of)]
    names = [[_called(users, fixed) for users in level] for level in levels]
    requests = [[fixed.get(name.lower(), TaskRequest(name=name)) for name in level] for level in names]
    return [
        _class_values(request, users, values)
        for classes, level, chosen in zip(requests, levels, chosen_values(requests), strict=True)
        for request, users, values in zip(classes, level, chosen, strict=True)
    ]


def _class_values(request: TaskRequest, users: Sequence[Component], values: PriorityValues) -> ClassValues:
    return ClassValues(
        name=request.name,
        category=values.category,
        priority=values.priority,
        background_priority=values.background_priority,
        criticality=criticality_of(users),
        user=most_critical_first(users)[0].name,
    )


def _out_of_order(decided: Sequence[ClassValues], inside: str, places: Places) -> Iterator[Diagnostic]:
    """Compare each class with those that are to rank below it."""
    for upper in decided:
        wrong = [
            lower
            for lower in decided
            if lower.criticality < upper.criticality and lower.thread_priority >= upper.thread_priority
        ]
        if wrong:
            worst = max(
                wrong,
                key=lambda class_values: (class_values.criticality, class_values.thread_priority, class_values.name),
            )
            yield CLASS_ORDER.at(
                places.key("components", upper.user),
                "In {_where}, {upper} (criticality {upper_criticality}) needs a higher priority than {lower} "
                "(criticality {lower_criticality}). Their thread priorities are {upper_priority} and {lower_priority}.",
                (
                    "No values keep all these classes in order, because Windows ignores the priority in High. Do "
                    "not fix categories and priorities, or let components of similar criticality share a class."
                ),
                address=_address(inside, upper.name),
                **_pair_facts(upper, worst, inside),
            )


def _remarks(decided: Sequence[ClassValues], inside: str, places: Places) -> Iterator[Diagnostic]:
    """Report what may come between threads that are in order; each kind once, for the most critical pair."""
    pairs = [
        (upper, lower)
        for upper in sorted(decided, key=lambda class_values: (-class_values.criticality, class_values.name))
        for lower in sorted(decided, key=lambda class_values: (-class_values.criticality, class_values.name))
        if upper.criticality > lower.criticality
    ]
    near = [(upper, lower) for upper, lower in pairs if upper.thread_priority == lower.thread_priority + 1]
    if near:
        yield _near_diagnostic(near, inside, places)
    below = [
        (upper, lower)
        for upper, lower in pairs
        if lower.category is TaskCategory.LOW and upper.category is not TaskCategory.LOW
    ]
    if below:
        yield _low_diagnostic(below, inside, places)


def _near_diagnostic(pairs: Sequence[tuple[ClassValues, ClassValues]], inside: str, places: Places) -> Diagnostic:
    upper, lower = pairs[0]
    more = f", as may {len(pairs) - 1} more" if len(pairs) > 1 else ""
    raised = "raised some threads" if lower.thread_priority >= REAL_TIME else "may raise threads when they wake"
    return NEIGHBOURS.at(
        places.key("components", upper.user),
        (
            "In {_where}, {upper} runs at {upper_priority} and {lower} at {lower_priority}. Windows "
            "{_raised} by one, so that both have the same priority{_more}."
        ),
        (
            "If this is acceptable, no action is needed. With at most eight criticalities in one operating "
            "system, the priorities differ by more than one."
        ),
        address=_address(inside, upper.name),
        _raised=raised,
        _more=more,
        **_pair_facts(upper, lower, inside),
    )


def _low_diagnostic(pairs: Sequence[tuple[ClassValues, ClassValues]], inside: str, places: Places) -> Diagnostic:
    upper, lower = pairs[0]
    others = {class_values.name for _, class_values in pairs} - {lower.name}
    first = f"{', '.join([lower.name, *sorted(others)])} {'run' if others else 'runs'} first"
    return NEIGHBOURS.at(
        places.key("components", lower.user),
        (
            "In {_where}, {lower} (criticality {lower_criticality}) runs at {lower_priority} in category "
            "Low, which MMCSS never lowers. When {upper} (criticality {upper_criticality}) has used its "
            "share, MMCSS lowers it and {_first}."
        ),
        (
            "If this is acceptable, no action is needed. SystemResponsiveness leaves this time to other threads. "
            "Up to four criticalities in one operating system all fit in Medium."
        ),
        address=_address(inside, lower.name),
        _first=first,
        **_pair_facts(upper, lower, inside),
    )


def _pair_facts(upper: ClassValues, lower: ClassValues, inside: str) -> dict[str, Any]:
    return {
        "_where": f"partition {inside}" if inside else "the host's own Windows",
        "partition": inside,
        "upper": upper.name,
        "upper_criticality": upper.criticality,
        "upper_priority": upper.thread_priority,
        "lower": lower.name,
        "lower_criticality": lower.criticality,
        "lower_priority": lower.thread_priority,
    }


def _address(inside: str, name: str) -> str:
    return f"partition/{inside}/task/{name}" if inside else f"task/{name}"


def thread_rules(component: Component, classes: Iterable[ClassValues]) -> tuple[ThreadRule, ...]:
    """Return the priority of each name of a thread in the component's `task`.

    Args:
        classes: of the component's partition.
    """
    return tuple(
        ThreadRule(pattern=pattern, priority=values.thread_priority, affinity=values.affinity)
        for values in classes
        if component.task_class is not None and values.name.lower() == component.task_class.lower()
        for pattern in component.threads
    )


def registry_values(values: ClassValues) -> Mapping[str, RegistryValue]:
    """Write a class as its whole registry key, with types; the booleans are text (windows.md 6.1).

    `Background Only` is always true: otherwise threads would depend on which window has the focus (windows.md 6.2), and
    that is not an order of criticalities.

    Returns:
        By name of the value, in alphabetical order.
    """
    data: Mapping[str, int | str] = {
        "Affinity": values.affinity,
        "Background Only": "True",
        "BackgroundPriority": values.background_priority,
        "Clock Rate": CLOCK_RATE,
        "GPU Priority": GPU_PRIORITY,
        "Priority": values.priority,
        "Scheduling Category": values.category.value,
        "SFIO Priority": "Normal",
    }
    return {
        name: RegistryValue(kind=ValueKind.DWORD if isinstance(each, int) else ValueKind.SZ, data=each)
        for name, each in data.items()
    }
