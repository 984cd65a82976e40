"""Values of robotic task classes, so that the wanted order of threads is really there (FACTS 6.1, 6.2).

Only category Medium orders by Priority: its threads run at Priority + 16. In High every Priority counts as 2, so all
run at 26; in Low it is BackgroundPriority + 7. The order is promised among the components of one operating system.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.state import RegistryValue, ValueKind
from rarms_iac.model.system import Component, TaskCategory, TaskWish
from rarms_iac.planner import findings
from rarms_iac.planner.groups import most_critical_first
from rarms_iac.planner.leftover.affinity import ALL, masks_of

LEVELS = 8
"""Priorities of a category: 1 to 8."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Spacing:
    """Where in Medium the most critical class lies, and how far below it the next one."""

    top: int
    apart: int


SPACINGS = (Spacing(top=7, apart=2), Spacing(top=7, apart=1), Spacing(top=LEVELS, apart=1))
"""The first that keeps the order is taken.

Windows was seen to raise some threads of Medium by one, and none above 23 (FACTS 6.2): two apart are in order even
then, and priority 8 may be no more than 7 is.
"""

CLOCK_RATE = 10_000
"""In 100 ns: other values were seen to stop the task from working."""

GPU_PRIORITY = 8
"""Not used by Windows; what its own classes say."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClassValues:
    """What is decided about a class in one operating system."""

    name: str
    category: TaskCategory
    priority: int
    background_priority: int
    criticality: int  # the highest of those who name it
    user: str  # who that is
    affinity: int = ALL  # the processors of its operating system that its threads may use: a bit each; 0: all

    @property
    def thread_priority(self) -> int:
        """What its threads run at (FACTS 6.2, measured)."""
        return thread_priority(self.category, self.priority, self.background_priority)


def thread_priority(category: TaskCategory, priority: int, background_priority: int) -> int:
    """What threads of a class run at while they have their share (FACTS 6.2, measured)."""
    match category:
        case TaskCategory.HIGH:
            return 26
        case TaskCategory.MEDIUM:
            return 16 + priority
        case TaskCategory.LOW:
            return 7 + background_priority


@dataclass(frozen=True, slots=True, kw_only=True)
class Classes:
    """The classes of one operating system, by name, and what they cannot express."""

    classes: tuple[ClassValues, ...]
    findings: tuple[Diagnostic, ...]


def classes_of(
    components: Iterable[Component],
    wishes: Mapping[str, TaskWish],
    inside: str,
    places: Places,
    *,
    processors: int = 0,
) -> Classes:
    """Values for every class that these components of one operating system name.

    It has so many processors; of 0, an unknown number, no class is kept to some.

    The most critical class gets the highest priority that is left, equals share one; what the manifest fixes stands.
    """
    named: dict[str, list[Component]] = {}
    for one in components:
        if one.task is not None:
            named.setdefault(one.task.lower(), []).append(one)
    fixed = {name.lower(): wish for name, wish in wishes.items()}
    by_weight = sorted(named.values(), key=lambda users: (-_criticality(users), _called(users, fixed)))
    ways = [_decide(by_weight, fixed, spacing) for spacing in SPACINGS]
    decided = next((one for one in ways if not any(_out_of_order(one, fixed, inside, places))), ways[-1])
    told = (*_out_of_order(decided, fixed, inside, places), *_neighbours(decided, inside, places))
    masks = masks_of(by_weight, processors)
    decided = [replace(one, affinity=masks.get(one.name.lower(), ALL)) for one in decided]
    return Classes(classes=tuple(sorted(decided, key=lambda one: one.name)), findings=told)


def _criticality(users: Sequence[Component]) -> int:
    return max(one.criticality for one in users)


def _called(users: Sequence[Component], fixed: Mapping[str, TaskWish]) -> str:
    """The class's name as `tasks` writes it, or as its first user by name does."""
    first = min(users, key=lambda one: one.name).task
    assert first is not None
    return fixed[first.lower()].name if first.lower() in fixed else first


def _decide(
    by_weight: Sequence[Sequence[Component]], fixed: Mapping[str, TaskWish], spacing: Spacing
) -> list[ClassValues]:
    """From the most critical down; each level as high as those above allow, which leaves the most room below."""
    decided: list[ClassValues] = []
    ceiling, level, last = spacing.top, spacing.top, None
    for users in by_weight:
        weight, name = _criticality(users), _called(users, fixed)
        if weight != last:
            level, last = ceiling, weight
        wish = fixed.get(name.lower(), TaskWish(name=name))
        priority = wish.priority if wish.priority is not None else max(1, level)
        background = wish.background_priority if wish.background_priority is not None else priority
        category = wish.category or TaskCategory.MEDIUM
        decided.append(
            ClassValues(
                name=name,
                category=category,
                priority=priority,
                background_priority=background,
                criticality=weight,
                user=most_critical_first(users)[0].name,
            )
        )
        if category is TaskCategory.MEDIUM:
            ceiling = min(ceiling, priority - spacing.apart)
    return decided


def _out_of_order(
    decided: Sequence[ClassValues], fixed: Mapping[str, TaskWish], inside: str, places: Places
) -> Iterator[Diagnostic]:
    """Every class against those that are to rank below it, unless the manifest's own checks tell of the pair."""
    for upper in decided:
        wrong = [
            one
            for one in decided
            if one.criticality < upper.criticality
            and one.thread_priority >= upper.thread_priority
            and not (_is_fixed(upper, fixed) and _is_fixed(one, fixed))
        ]
        if wrong:
            worst = max(wrong, key=lambda one: (one.criticality, one.thread_priority, one.name))
            yield findings.CLASS_ORDER.at(
                places.key("components", upper.user),
                f"In {_where(inside)}, {upper.name} (criticality {upper.criticality}) runs at {upper.thread_priority}, "
                f"not above {worst.name} (criticality {worst.criticality}) at {worst.thread_priority}.",
                f"Category Medium has {LEVELS} levels and is the only one that orders: leave priorities open, "
                f"or let components of similar criticality share a class.",
                address=_address(inside, upper.name),
            )


def _neighbours(decided: Sequence[ClassValues], inside: str, places: Places) -> Iterator[Diagnostic]:
    """Classes whose threads may meet where Windows raises the lower one by one."""
    ordered = sorted(decided, key=lambda one: (-one.criticality, one.name))
    pairs = [
        (upper, lower)
        for upper, lower in pairwise(ordered)
        if upper.criticality > lower.criticality
        and upper.category is lower.category is TaskCategory.MEDIUM
        and upper.thread_priority == lower.thread_priority + 1
    ]
    if pairs:
        upper, lower = pairs[0]
        more = f", as may {len(pairs) - 1} more" if len(pairs) > 1 else ""
        yield findings.NEIGHBOURS.at(
            places.key("components", upper.user),
            f"In {_where(inside)}, {upper.name} runs at {upper.thread_priority} and {lower.name} at "
            f"{lower.thread_priority}: Windows was seen to raise some threads by one, and then the two meet{more}.",
            "Nothing, if that can be borne. Four criticalities in one operating system leave room between them.",
            address=_address(inside, upper.name),
        )


def _is_fixed(one: ClassValues, fixed: Mapping[str, TaskWish]) -> bool:
    """Whether the manifest leaves nothing of its thread priority to us; of two such ones its own checks tell."""
    wish = fixed.get(one.name.lower())
    if wish is None:
        return False
    match wish.category:
        case TaskCategory.HIGH:
            return True
        case TaskCategory.MEDIUM:
            return wish.priority is not None
        case TaskCategory.LOW:
            return wish.background_priority is not None
        case None:
            return False


def _where(inside: str) -> str:
    return f"partition {inside}" if inside else "the host's own Windows"


def _address(inside: str, name: str) -> str:
    return f"partition/{inside}/task/{name}" if inside else f"task/{name}"


def registry_values(one: ClassValues) -> Mapping[str, RegistryValue]:
    """The class's whole key, with types: the booleans are text (FACTS 6.1)."""
    return {
        "Affinity": _number(one.affinity),
        "Background Only": _text("False"),
        "BackgroundPriority": _number(one.background_priority),
        "Clock Rate": _number(CLOCK_RATE),
        "GPU Priority": _number(GPU_PRIORITY),
        "Priority": _number(one.priority),
        "Scheduling Category": _text(one.category.value),
        "SFIO Priority": _text("Normal"),
    }


def _number(data: int) -> RegistryValue:
    return RegistryValue(kind=ValueKind.DWORD, data=data)


def _text(data: str) -> RegistryValue:
    return RegistryValue(kind=ValueKind.SZ, data=data)
