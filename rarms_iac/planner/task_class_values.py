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
    """What a choice is weighed by, the gravest first; numbers of classes."""

    out_of_order: int = 0  # not below all more critical ones, or left out so that others can be
    against: int = 0  # in High, or out of Medium in spite of a fixed priority, where the manifest does not say so
    near_in_medium: int = 0  # one below a more critical one
    near_in_low: int = 0
    low: int = 0  # in Low where the manifest does not say so

    def plus(self, other: Sequence[int]) -> "Cost":
        """Add another cost to this one, number by number.

        Args:
            other: as many numbers.

        Returns:
            A new cost.
        """
        return Cost(*map(add, self, other))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Option:
    """Values that a class may have, and what is needed to weigh them."""

    values: PriorityValues
    thread: int
    is_against: bool  # the manifest does not say so, see `Cost`
    is_low: bool
    is_low_freely: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class _Way:
    """A choice for the levels so far; `order` is smaller where threads are higher."""

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
    ways = {_NOTHING_ABOVE: _Way()}
    for level in levels:
        options = [_options(request) for request in level]
        threads = {option.thread for each in options for option in each}
        found: dict[int, _Way] = {}
        for ceiling, way in ways.items():
            for floor in sorted({ceiling, *(thread for thread in threads if thread < ceiling)}):
                lowest, longer = _longer(way, options, ceiling, floor)
                if lowest not in found or longer.rank < found[lowest].rank:
                    found[lowest] = longer
        ways = _worth_following(found)
    return min(ways.values(), key=lambda way: way.rank).chosen


def _worth_following(ways: Mapping[int, _Way]) -> dict[int, _Way]:
    """Keep the ways that leave more room below than any better way.

    All levels that follow a dropped way can follow a kept one too, at no more cost.
    """
    best: dict[int, _Way] = {}
    for ceiling in sorted(ways, reverse=True):
        if all(ways[ceiling].rank < better.rank for better in best.values()):
            best[ceiling] = ways[ceiling]
    return best


def _longer(way: _Way, options: Sequence[Sequence[_Option]], ceiling: int, floor: int) -> tuple[int, _Way]:
    """With one level more, and what is to be kept below then; each class takes what is best between floor and ceiling.

    Below the floor and from the ceiling on it is out of the order: what comes next need not be below it.
    """
    picks = [min(each, key=lambda option: _weight(option, ceiling, floor)) for each in options]
    cost = way.cost
    for pick in picks:
        cost = cost.plus(_weight(pick, ceiling, floor))
    lowest = min([ceiling, *(pick.thread for pick in picks if pick.thread >= floor)])
    order = (*way.order, *(-pick.thread for pick in picks))
    return lowest, _Way(cost=cost, order=order, chosen=(*way.chosen, tuple(pick.values for pick in picks)))


def _options(request: TaskRequest) -> list[_Option]:
    """The highest threads first, so that of those that weigh the same the highest is taken."""
    is_free = request.category is None
    return [
        _Option(
            values=level_values,
            thread=level_values.thread_priority,
            is_against=is_free and _is_against(request, level_values.category),
            is_low=level_values.category is TaskCategory.LOW,
            is_low_freely=is_free and level_values.category is TaskCategory.LOW,
        )
        for level_values in values_within(request)
    ]


def _is_against(request: TaskRequest, category: TaskCategory) -> bool:
    return category is TaskCategory.HIGH or (category is TaskCategory.LOW and request.priority is not None)


def _weight(option: _Option, ceiling: int, floor: int) -> tuple[bool, bool, bool, bool, bool]:
    """One class's part of a `Cost`."""
    is_near = option.thread == ceiling - 1
    is_out = not floor <= option.thread < ceiling
    return is_out, option.is_against, is_near and not option.is_low, is_near and option.is_low, option.is_low_freely


ALL = 0
"""The mask that keeps a class to nothing (windows.md 6.1)."""

NAMED_UP_TO = 32
"""A mask has so many bits: of more processors not all can be named."""


def masks_of(users: Sequence[Sequence[Component]], processors: int) -> Mapping[str, int]:
    """The mask of each class that is kept to some, by its name in lower case.

    From the least critical up, each level gets its own processors beside those of the levels below, the last ones
    first. A level that finds no room beside them is not kept, and then none above it is.

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
    levels = [list(level) for _, level in groupby(sorted(users, key=_criticality), key=_criticality)]
    for level in levels[:-1]:
        width += sum(_wanted(users, processors) for users in level)
        if width >= processors:
            break
        for task_users in level:
            assert task_users[0].task is not None, "who names no class wants all"
            found[task_users[0].task.lower()] = _last(width, processors)
    return found


def _criticality(users: Sequence[Component]) -> int:
    return max(user.criticality for user in users)


def _wanted(users: Sequence[Component], processors: int) -> int:
    """Return how many processors all components of a class can use at once.

    It is all processors where a component has an APT, or no class, or does not say how many it uses.
    """
    if any(user.apt or user.task is None or user.processors is None for user in users):
        return processors
    return sum(user.processors or 0 for user in users)


def _last(width: int, processors: int) -> int:
    return ((1 << width) - 1) << (processors - width)
