"""Every small set of classes against all values that there are, counted without the code that chooses."""

from collections.abc import Iterator, Sequence
from itertools import pairwise, product

import pytest

from rarms_iac.model.class_values import LevelValues, values_within
from rarms_iac.model.system import TaskCategory, TaskWish
from rarms_iac.planner.leftover.ordering import chosen_values
from tests.builders import a_task
from tests.effort import LONG

HIGH, MEDIUM, LOW = TaskCategory.HIGH, TaskCategory.MEDIUM, TaskCategory.LOW
ALL_OPEN = a_task("Open")
SOME = [
    ALL_OPEN,
    a_task("Open", priority=2),
    a_task("Open", category=HIGH),
    a_task("Open", category=MEDIUM),
    a_task("Open", category=MEDIUM, priority=8),
    a_task("Open", category=MEDIUM, priority=1, background_priority=8),
    a_task("Open", category=LOW, background_priority=8),
]
MORE = [
    a_task("Open", priority=7),
    a_task("Open", background_priority=8),
    a_task("Open", category=MEDIUM, priority=7),
    a_task("Open", category=MEDIUM, priority=6),
    a_task("Open", category=LOW),
    a_task("Open", category=LOW, priority=8, background_priority=1),
    a_task("Open", category=LOW, priority=1),
]

Values = tuple[TaskCategory, int]
"""A category, and what its threads run at."""


def values(wish: TaskWish) -> list[Values]:
    """Everything that the manifest leaves open, tried: in Medium 8 is no more than 7 (none was seen above 23)."""
    every = product(TaskCategory, range(1, 9), range(1, 9))
    left = {
        (category, {HIGH: 26, MEDIUM: min(16 + priority, 23), LOW: 7 + background}[category])
        for category, priority, background in every
        if wish.category in {None, category}
        and wish.priority in {None, priority}
        and wish.background_priority in {None, background}
    }
    return sorted(left, key=lambda one: -one[1])


def pairs(levels: Sequence[Sequence[TaskWish]], chosen: Sequence[Values]) -> Iterator[tuple[Values, Values]]:
    """Every more critical class with every less critical one."""
    at = [number for number, level in enumerate(levels) for _ in level]
    for upper, above in zip(at, chosen, strict=True):
        for lower, below in zip(at, chosen, strict=True):
            if upper < lower:
                yield above, below


def in_order(levels: Sequence[Sequence[TaskWish]], chosen: Sequence[Values]) -> bool:
    return all(upper[1] > lower[1] for upper, lower in pairs(levels, chosen))


def weight(levels: Sequence[Sequence[TaskWish]], chosen: Sequence[Values]) -> tuple[int, int, int, int]:
    """Against the grain, close by in Medium, close by in Low, and in Low of its own accord."""
    free = [
        (wish, category)
        for wish, (category, _) in zip([wish for level in levels for wish in level], chosen, strict=True)
        if wish.category is None
    ]
    against = sum(category is HIGH or (category is LOW and wish.priority is not None) for wish, category in free)
    number = [0, 0]
    at = [at for at, level in enumerate(levels) for _ in level]
    for here, (category, thread) in zip(at, chosen, strict=True):
        above = [its for there, (_, its) in zip(at, chosen, strict=True) if there < here]
        number[category is LOW] += thread + 1 in above
    return against, number[0], number[1], sum(category is LOW for _, category in free)


def as_values(chosen: Sequence[Sequence[LevelValues]]) -> list[Values]:
    return [(level_values.category, level_values.thread_priority) for level in chosen for level_values in level]


def groups(wishes: Sequence[TaskWish]) -> Iterator[list[list[TaskWish]]]:
    """The same classes, of so many criticalities, neighbours equal or not."""
    for ends in product([False, True], repeat=len(wishes) - 1):
        levels = [[wishes[0]]]
        for wish, is_other in zip(wishes[1:], ends, strict=True):
            if is_other:
                levels.append([wish])
            else:
                levels[-1].append(wish)
        yield levels


@pytest.mark.parametrize("wishes", [SOME + MORE if LONG else SOME])
@pytest.mark.parametrize("number", [1, 2, 3])
def test_the_order_is_there_whenever_any_values_have_it_and_with_as_much_room(
    wishes: list[TaskWish], number: int
) -> None:
    left = {id(wish): values(wish) for wish in wishes}
    for drawn in product(wishes, repeat=number):
        for levels in groups(drawn):
            found = as_values(chosen_values(levels))
            assert all(one in left[id(wish)] for wish, one in zip(drawn, found, strict=True))
            every = [way for way in product(*(left[id(wish)] for wish in drawn)) if in_order(levels, way)]
            assert in_order(levels, found) == bool(every), (levels, found)
            if every:
                best = min(weight(levels, way) for way in every)
                assert weight(levels, found) == best, (levels, found)


@pytest.mark.parametrize("number", range(1, 18))
def test_sixteen_criticalities_are_all_that_can_be_in_order_and_eight_lie_two_apart(number: int) -> None:
    threads = [thread for _, thread in as_values(chosen_values([[ALL_OPEN]] * number))]

    steps = [upper - lower for upper, lower in pairwise(threads)]
    assert all(step >= 1 for step in steps) == (number <= len(values(ALL_OPEN)) == 16)
    assert all(step >= 2 for step in steps) == (number <= 8)


def test_where_no_values_keep_all_in_order_the_fewest_are_left_out() -> None:
    lowest = a_task("Lowest", category=LOW, background_priority=1)

    ((first,), (second,), (third,)) = chosen_values([[lowest], [ALL_OPEN], [ALL_OPEN]])

    assert [level_values.thread_priority for level_values in (first, second, third)] == [8, 23, 21]


def test_equals_run_alike_as_far_as_each_can() -> None:
    ((open_, other, fixed), (below,)) = chosen_values(
        [[ALL_OPEN, ALL_OPEN, a_task("Fixed", category=MEDIUM, priority=4)], [ALL_OPEN]]
    )

    assert [level_values.thread_priority for level_values in (open_, other, fixed, below)] == [23, 23, 20, 18]


@pytest.mark.parametrize("wish", SOME + MORE)
def test_what_a_wish_leaves_is_listed_once_each_the_highest_threads_first(wish: TaskWish) -> None:
    assert [(level_values.category, level_values.thread_priority) for level_values in values_within(wish)] == values(
        wish
    )


def test_the_number_that_a_category_does_not_go_by_follows_the_one_that_it_does() -> None:
    for level_values in values_within(ALL_OPEN):
        assert level_values.priority == level_values.background_priority
