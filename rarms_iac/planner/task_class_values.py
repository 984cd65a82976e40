"""Which of its possible values each task class gets, so that threads are in the wanted order, with room between them.

What is preferred is decided in docs/decisions/0024: order before all, then what the manifest seems to want, then two
levels between threads in Medium, then in Low, then few classes in Low, then high threads.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import add
from typing import NamedTuple

from rarms_iac.model.mmcss import PriorityValues, values_within
from rarms_iac.model.system import Component, TaskCategory, TaskRequest

REAL_TIME = 16
"""Threads from here on are above all that Windows raises for a while."""

_NOTHING_ABOVE = 32  # and not next to any class: the highest is 26


class Cost(NamedTuple):
    """The cost of a choice, the gravest part first; numbers of classes."""

    out_of_order: int = 0  # not below all more critical ones, or left out so that others can be
    against: int = 0  # in High, or out of Medium in spite of a fixed priority, where the manifest does not say so
    near_in_medium: int = 0  # one below a more critical one
    near_in_low: int = 0
    low: int = 0  # in Low where the manifest does not say so

    def plus(self, other: Sequence[int]) -> "Cost":
        """Add another cost to this one, number by number.

        Returns:
            A new cost.
        """
        return Cost(*map(add, self, other))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Option:
    """Values that a class may have, and what is needed to weigh them."""

    values: PriorityValues
    thread: int
    is_against: bool  # as `Cost.against` counts
    is_low: bool
    is_free_and_low: bool  # the manifest does not ask for Low


@dataclass(frozen=True, slots=True, kw_only=True)
class _ChosenValues:
    """Values for the levels so far; `order` is smaller where threads are higher."""

    cost: Cost = Cost()
    order: tuple[int, ...] = ()
    chosen: tuple[tuple[PriorityValues, ...], ...] = ()

    @property
    def rank(self) -> tuple[Cost, tuple[int, ...]]:
        return self.cost, self.order


def chosen_values(levels: Sequence[Sequence[TaskRequest]]) -> tuple[tuple[PriorityValues, ...], ...]:
    """Choose the values of all classes of one operating system.

    Threads are out of order only where no values could put them in order. All that matters of the levels above is the
    lowest thread that the next level must stay below, so the best choice for each such thread is followed (dynamic
    programming).

    Args:
        levels: the requests for the classes of each level of criticality, the most critical level first.

    Returns:
        Values in the same shape: for each level, for each of its classes. Equal costs go to higher threads.
    """
    choices = {_NOTHING_ABOVE: _ChosenValues()}
    for level in levels:
        options = [_options(request) for request in level]
        threads = {option.thread for each in options for option in each}
        found: dict[int, _ChosenValues] = {}  # by the lowest thread that the next level must stay below
        for ceiling, choice in choices.items():
            for floor in sorted({ceiling, *(thread for thread in threads if thread < ceiling)}):
                lowest, longer = _with_level(choice, options, ceiling, floor)
                if lowest not in found or longer.rank < found[lowest].rank:
                    found[lowest] = longer
        choices = _worth_keeping(found)
    return min(choices.values(), key=lambda choice: choice.rank).chosen


def _worth_keeping(choices: Mapping[int, _ChosenValues]) -> dict[int, _ChosenValues]:
    """Keep the choices that leave more room below than any better choice.

    All levels that follow a dropped choice can follow a kept one too, at no more cost.
    """
    best: dict[int, _ChosenValues] = {}
    for ceiling in sorted(choices, reverse=True):
        if all(choices[ceiling].rank < better.rank for better in best.values()):
            best[ceiling] = choices[ceiling]
    return best


def _with_level(
    choice: _ChosenValues, options: Sequence[Sequence[_Option]], ceiling: int, floor: int
) -> tuple[int, _ChosenValues]:
    """Return the lowest thread that the next level must stay below, and the choice with one level more.

    Each class takes its best value from the floor to below the ceiling; a value elsewhere is out of order, and
    its thread is not one of these.
    """
    picks = [min(each, key=lambda option: _weight(option, ceiling, floor)) for each in options]
    cost = choice.cost
    for pick in picks:
        cost = cost.plus(_weight(pick, ceiling, floor))
    lowest = min([ceiling, *(pick.thread for pick in picks if pick.thread >= floor)])
    order = (*choice.order, *(-pick.thread for pick in picks))
    return lowest, _ChosenValues(cost=cost, order=order, chosen=(*choice.chosen, tuple(pick.values for pick in picks)))


def _options(request: TaskRequest) -> list[_Option]:
    """Return the highest threads first, so that of those that weigh the same the highest is taken."""
    is_free = request.category is None
    return [
        _Option(
            values=level_values,
            thread=level_values.thread_priority,
            is_against=is_free and _is_unwanted(request, level_values.category),
            is_low=level_values.category is TaskCategory.LOW,
            is_free_and_low=is_free and level_values.category is TaskCategory.LOW,
        )
        for level_values in values_within(request)
    ]


def _is_unwanted(request: TaskRequest, category: TaskCategory) -> bool:
    return category is TaskCategory.HIGH or (category is TaskCategory.LOW and request.priority is not None)


def _weight(option: _Option, ceiling: int, floor: int) -> tuple[bool, bool, bool, bool, bool]:
    """Return one class's part of a `Cost`."""
    is_near = option.thread == ceiling - 1
    is_out = not floor <= option.thread < ceiling
    return is_out, option.is_against, is_near and not option.is_low, is_near and option.is_low, option.is_free_and_low


ALL = 0
"""The mask that keeps a class to nothing (windows.md 6.1)."""

NAMED_UP_TO = 32
"""A mask has so many bits: of more processors not all can be named."""


def masks_of(users: Sequence[Sequence[Component]], processors: int) -> Mapping[str, int]:
    """Return the mask of each class that is kept to some, by its name in lower case.

    From the least critical up, each level gets its own processors apart from those of the levels below, the last ones
    first. A level that finds no room with them is not kept, and then none above it is.

    Args:
        users: of each class the components that name it, and each component that names none, in any order; all of
            one operating system.
        processors: how many this has; 0 where that is unknown.

    Returns:
        A bit for each logical processor that the class may use; a class that may use all is missing.
    """
    if not 1 < processors <= NAMED_UP_TO:
        return {}
    found: dict[str, int] = {}
    width = 0
    levels = [list(level) for _, level in groupby(sorted(users, key=criticality_of), key=criticality_of)]
    for level in levels[:-1]:
        width += sum(_usable_processors(task_users, processors) for task_users in level)
        if width >= processors:
            break
        for task_users in level:
            assert task_users[0].task_class is not None, "who names no class wants all"
            found[task_users[0].task_class.lower()] = _last_bits(width, processors)
    return found


def criticality_of(users: Sequence[Component]) -> int:
    """Return the highest criticality of those who name a class."""
    return max(user.criticality for user in users)


def _usable_processors(users: Sequence[Component], processors: int) -> int:
    """Return the number of processors that all components of a class can use at once.

    It is all processors where a component has an APT, or no class, or does not say how many it uses.
    """
    if any(user.apt or user.task_class is None or user.processors is None for user in users):
        return processors
    return sum(user.processors or 0 for user in users)


def _last_bits(width: int, processors: int) -> int:
    return ((1 << width) - 1) << (processors - width)
