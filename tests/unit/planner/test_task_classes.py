"""Every small set of classes against all values that there are, counted without the code that chooses."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, pairwise, product

import pytest

from rarms_iac.model.mmcss import PriorityValues, values_within
from rarms_iac.model.system import Component, TaskCategory, TaskRequest
from rarms_iac.planner.task_class_values import ALL, chosen_values, masks_of
from rarms_iac.planner.task_classes import Classes, classes_of, registry_values
from tests.builders import a_component, a_task, at_most, codes
from tests.effort import LONG
from tests.planning import PLACES


def decided(components: list[Component], *requests: TaskRequest) -> Classes:
    return classes_of(components, {request.name: request for request in requests}, "media", PLACES)


def users(**criticalities: int) -> list[Component]:
    """A component each, called after its class."""
    return [a_component(name.lower(), task=name, criticality=value) for name, value in criticalities.items()]


def threads(found: Classes) -> dict[str, int]:
    return {task_class.name: task_class.thread_priority for task_class in found.classes}


def test_threads_follow_criticalities() -> None:
    found = decided(users(Localization=10, MotionControl=40, SpeechRecognition=10))

    assert threads(found) == {"MotionControl": 23, "Localization": 21, "SpeechRecognition": 21}
    assert found.findings == ()


def test_shared_class_counts_as_its_most_critical_component() -> None:
    shared = [*users(Localization=20), a_component("a", task="MotionControl", criticality=5)]

    found = decided([*shared, a_component("b", task="motioncontrol", criticality=50)])

    assert threads(found) == {"MotionControl": 23, "Localization": 21}


def test_fixed_values_stand() -> None:
    found = decided(users(Localization=30, MotionControl=20, SpeechRecognition=10), a_task("MotionControl", priority=3))

    assert threads(found) == {"Localization": 23, "MotionControl": 19, "SpeechRecognition": 17}


def of_all(number: int) -> Classes:
    return decided([a_component(f"c{at:02}", task=f"Class{at:02}", criticality=-at) for at in range(number)])


def test_more_criticalities_than_windows_has_levels_are_told() -> None:
    assert codes(of_all(16).findings) == ["RARMS129", "RARMS129"]
    assert "RARMS128" in codes(of_all(17).findings)


def test_fixed_top_class_is_reported_once() -> None:
    high = a_task("MotionControl", category=TaskCategory.HIGH)
    found = decided(users(Localization=30, MotionControl=20), high)
    both = decided(users(Localization=30, MotionControl=20), high, a_task("Localization", category=TaskCategory.MEDIUM))

    assert codes(found.findings) == ["RARMS128"]
    assert codes(both.findings) == ["RARMS128"]
    assert threads(found) == {"Localization": 23, "MotionControl": 26}


def test_fixed_below_drives_open_into_high() -> None:
    for priority, wanted in ((6, 23), (7, 26), (8, 26)):
        fixed = a_task("MotionControl", category=TaskCategory.MEDIUM, priority=priority)

        assert threads(decided(users(Localization=30, MotionControl=20), fixed))["Localization"] == wanted


def test_roomless_fixed_classes_are_told_once() -> None:
    found = decided(
        users(Localization=30, MotionControl=20, SpeechRecognition=10),
        a_task("Localization", category=TaskCategory.MEDIUM, priority=2),
        a_task("SpeechRecognition", category=TaskCategory.MEDIUM, priority=1),
    )

    assert codes(found.findings).count("RARMS128") == 1
    assert "MotionControl" in found.findings[0].detail


def test_open_below_low_goes_into_low() -> None:
    found = decided(
        users(Localization=30, MotionControl=20, SpeechRecognition=10),
        a_task("Localization", category=TaskCategory.MEDIUM, priority=2),
        a_task("MotionControl", category=TaskCategory.LOW),
    )

    assert threads(found) == {"Localization": 18, "MotionControl": 15, "SpeechRecognition": 13}
    assert codes(found.findings) == ["RARMS129"]
    assert found.findings[0].address == "partition/media/task/MotionControl"
    assert "MMCSS lowers it and MotionControl, SpeechRecognition run first." in found.findings[0].detail


def test_two_fixed_in_high_are_equal() -> None:
    high = [a_task(name, category=TaskCategory.HIGH) for name in ("Localization", "MotionControl")]

    assert codes(decided(users(Localization=30, MotionControl=20), *high).findings) == ["RARMS128"]


def test_all_values_have_their_types() -> None:
    (decided_class,) = decided(users(Localization=30)).classes

    assert {name: (value.kind.value, value.data) for name, value in registry_values(decided_class).items()} == {
        "Affinity": ("dword", 0),
        "Background Only": ("sz", "True"),
        "BackgroundPriority": ("dword", 7),
        "Clock Rate": ("dword", 10000),
        "GPU Priority": ("dword", 8),
        "Priority": ("dword", 7),
        "Scheduling Category": ("sz", "Medium"),
        "SFIO Priority": ("sz", "Normal"),
    }


@pytest.mark.parametrize(
    ("count", "spread", "expected"),
    [
        (4, [23, 21, 19, 17], []),
        (5, [23, 21, 19, 17, 15], ["RARMS129"]),
        (8, [23, 21, 19, 17, 15, 13, 11, 9], ["RARMS129"]),
        (9, [23, 21, 19, 17, 15, 14, 12, 10, 8], ["RARMS129", "RARMS129"]),
        (13, [23, 22, 21, 19, 17, 15, 14, 13, 12, 11, 10, 9, 8], ["RARMS129", "RARMS129"]),
    ],
)
def test_four_criticalities_fit_medium_and_low(count: int, spread: list[int], expected: list[str]) -> None:
    found = of_all(count)

    assert sorted(threads(found).values(), reverse=True) == spread
    assert codes(found.findings) == expected


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


def values(request: TaskRequest) -> list[Values]:
    """Everything that the manifest leaves open, tried: in Medium 8 is not more than 7 (none was seen above 23)."""
    every = product(TaskCategory, range(1, 9), range(1, 9))
    possible = {
        (category, {HIGH: 26, MEDIUM: min(16 + priority, 23), LOW: 7 + background}[category])
        for category, priority, background in every
        if request.category in {None, category}
        and request.priority in {None, priority}
        and request.background_priority in {None, background}
    }
    return sorted(possible, key=lambda option: -option[1])


def pairs(levels: Sequence[Sequence[TaskRequest]], chosen: Sequence[Values]) -> Iterator[tuple[Values, Values]]:
    """Every more critical class with every less critical one."""
    at = [number for number, level in enumerate(levels) for _ in level]
    for upper, above in zip(at, chosen, strict=True):
        for lower, below in zip(at, chosen, strict=True):
            if upper < lower:
                yield above, below


def in_order(levels: Sequence[Sequence[TaskRequest]], chosen: Sequence[Values]) -> bool:
    return all(upper[1] > lower[1] for upper, lower in pairs(levels, chosen))


def weight(levels: Sequence[Sequence[TaskRequest]], chosen: Sequence[Values]) -> tuple[int, int, int, int]:
    """Against the grain, close by in Medium, close by in Low, and in Low of its own accord."""
    free = [
        (request, category)
        for request, (category, _) in zip([request for level in levels for request in level], chosen, strict=True)
        if request.category is None
    ]
    against = sum(category is HIGH or (category is LOW and request.priority is not None) for request, category in free)
    number = [0, 0]
    at = [at for at, level in enumerate(levels) for _ in level]
    for here, (category, thread) in zip(at, chosen, strict=True):
        above = [its for there, (_, its) in zip(at, chosen, strict=True) if there < here]
        number[category is LOW] += thread + 1 in above
    return against, number[0], number[1], sum(category is LOW for _, category in free)


def as_values(chosen: Sequence[Sequence[PriorityValues]]) -> list[Values]:
    return [(level_values.category, level_values.thread_priority) for level in chosen for level_values in level]


def groups(requests: Sequence[TaskRequest]) -> Iterator[list[list[TaskRequest]]]:
    """These classes, of so many criticalities, neighbours equal or not."""
    for ends in product([False, True], repeat=len(requests) - 1):
        levels = [[requests[0]]]
        for request, is_other in zip(requests[1:], ends, strict=True):
            if is_other:
                levels.append([request])
            else:
                levels[-1].append(request)
        yield levels


@pytest.mark.parametrize("requests", [SOME + MORE if LONG else SOME])
@pytest.mark.parametrize("number", [1, 2, 3])
def test_possible_order_is_found_with_room(requests: list[TaskRequest], number: int) -> None:
    possible = {id(request): values(request) for request in requests}
    for drawn in product(requests, repeat=number):
        for levels in groups(drawn):
            found = as_values(chosen_values(levels))
            assert all(chosen in possible[id(request)] for request, chosen in zip(drawn, found, strict=True))
            every = [way for way in product(*(possible[id(request)] for request in drawn)) if in_order(levels, way)]
            assert in_order(levels, found) == bool(every), (levels, found)
            if every:
                best = min(weight(levels, way) for way in every)
                assert weight(levels, found) == best, (levels, found)


@pytest.mark.parametrize("number", range(1, 18))
def test_sixteen_criticalities_are_the_maximum(number: int) -> None:
    threads = [thread for _, thread in as_values(chosen_values([[ALL_OPEN]] * number))]

    steps = [upper - lower for upper, lower in pairwise(threads)]
    assert all(step >= 1 for step in steps) == (number <= len(values(ALL_OPEN)) == 16)
    assert all(step >= 2 for step in steps) == (number <= 8)


def test_fewest_are_left_out_of_order() -> None:
    lowest = a_task("Lowest", category=LOW, background_priority=1)

    ((first,), (second,), (third,)) = chosen_values([[lowest], [ALL_OPEN], [ALL_OPEN]])

    assert [level_values.thread_priority for level_values in (first, second, third)] == [8, 23, 21]


def test_equals_run_alike_as_far_as_each_can() -> None:
    ((open_, other, fixed), (below,)) = chosen_values(
        [[ALL_OPEN, ALL_OPEN, a_task("Fixed", category=MEDIUM, priority=4)], [ALL_OPEN]]
    )

    assert [level_values.thread_priority for level_values in (open_, other, fixed, below)] == [23, 23, 20, 18]


@pytest.mark.parametrize("task_request", SOME + MORE)
def test_leftovers_are_listed_highest_first(task_request: TaskRequest) -> None:
    assert [
        (level_values.category, level_values.thread_priority) for level_values in values_within(task_request)
    ] == values(task_request)


def test_unused_number_follows_the_used_one() -> None:
    for level_values in values_within(ALL_OPEN):
        assert level_values.priority == level_values.background_priority


APT = {"mean_response_time": at_most(100)}


def a_class(name: str, criticality: int, processors: int | None = None, *, apt: bool = False) -> Component:
    return a_component(
        name, criticality=criticality, processors=processors, task=name.title(), reserve=None, apt=APT if apt else None
    )


def of_no_class(criticality: int) -> Component:
    return replace(a_class("plain", criticality, 1), task=None)


def test_less_critical_keep_to_last_processors() -> None:
    arm, log, map_ = a_class("arm", 30, 2, apt=True), a_class("log", 10, 1), a_class("map", 20, 2)

    found = classes_of([arm, log, map_], {}, "body", PLACES, processors=4).classes

    assert {class_values.name: class_values.affinity for class_values in found} == {
        "Arm": ALL,
        "Log": 0b1000,
        "Map": 0b1110,
    }
    assert {class_values.name: registry_values(class_values)["Affinity"].data for class_values in found} == {
        "Arm": 0,
        "Log": 8,
        "Map": 14,
    }


def test_most_critical_may_use_what_none_above_wants() -> None:
    x, y = a_class("x", 90, 1), a_class("y", 10, 2)

    assert masks_of([[x], [y]], 4) == {"y": 0b1100}
    assert masks_of([[y]], 4) == {}
    assert masks_of([], 4) == {}


def test_without_room_all_above_may_use_all() -> None:
    classes = [[a_class("a", 40, 1)], [a_class("b", 30, 1)], [a_class("c", 20, 2)], [a_class("d", 10, 2)]]

    assert masks_of(classes, 4) == {"d": 0b1100}


def test_unrestricted_component_frees_all_above() -> None:
    free, promised, log, top = (
        a_class("free", 20),
        a_class("promised", 20, 1, apt=True),
        a_class("log", 30, 1),
        [a_class("top", 40)],
    )

    assert masks_of([[free], [log], top], 4) == {}
    assert masks_of([[promised], [log], top], 4) == {}
    assert masks_of([[log], top], 4) == {"log": 0b1000}


def test_unnamed_class_frees_those_above() -> None:
    log = a_class("log", 20, 1)

    assert _masks(log, of_no_class(10)) == {"Log": ALL}
    assert _masks(log, of_no_class(30)) == {"Log": 0b1000}


def _masks(*components: Component) -> dict[str, int]:
    found = classes_of(components, {}, "body", PLACES, processors=4).classes
    return {class_values.name: class_values.affinity for class_values in found}


def test_who_shares_a_class_shares_its_processors() -> None:
    first, second, top = a_class("log", 10, 1), replace(a_class("map", 20, 1), task="LOG"), a_class("top", 30)

    assert masks_of([[first, second], [top]], 4) == {"log": 0b1100}


def test_mask_names_only_its_bits() -> None:
    classes = [[a_class("log", 10, 1)], [a_class("top", 30)]]

    assert masks_of(classes, 33) == {}
    assert masks_of(classes, 32) == {"log": 1 << 31}
    assert masks_of(classes, 1) == {}
    assert masks_of(classes, 0) == {}


WIDEST = 5 if LONG else 4

RunningOn = tuple[int | None, ...]
"""Which component, by its number, has a thread on each processor."""


def systems(processors: int) -> Iterator[tuple[list[Component], list[int]]]:
    """Up to three components in every order of criticalities, equals too; and what each may use, as a mask."""
    everything = (1 << processors) - 1
    kinds: list[int | None] = [None, *range(1, processors + 1)]
    for number in (1, 2, 3):
        for criticalities in product(range(number), repeat=number):
            for wanted in product(kinds, repeat=number):
                drawn = zip(criticalities, wanted, strict=True)
                components = [a_class(f"c{at}", weight, width) for at, (weight, width) in enumerate(drawn)]
                masks = masks_of([[component] for component in components], processors)
                yield components, [masks.get(component.name) or everything for component in components]


@pytest.mark.parametrize("processors", range(2, WIDEST + 1))
def test_no_thread_waits_while_less_critical_one_runs(processors: int) -> None:
    """However threads are laid out, once none is left that waits and could go ahead of another, or to a free one."""
    seen = {
        (tuple(component.criticality for component in components), tuple(masks))
        for components, masks in systems(processors)
    }
    for criticalities, masks in seen:
        for running in product([None, *range(len(masks))], repeat=processors):
            if _is_allowed(running, masks):
                waiting = [at for at in range(len(masks)) if not _can_go(at, running, masks, criticalities)]
                for component, other in product(waiting, [other for other in running if other is not None]):
                    assert criticalities[other] >= criticalities[component], (criticalities, masks, running)


def _is_allowed(running: RunningOn, masks: Sequence[int]) -> bool:
    return all(component is None or masks[component] >> at & 1 for at, component in enumerate(running))


def _can_go(component: int, running: RunningOn, masks: Sequence[int], criticalities: Sequence[int]) -> bool:
    """Whether a thread more of this component would find a processor: free, or of a less critical one."""
    return any(
        other is None or criticalities[other] < criticalities[component]
        for at, other in enumerate(running)
        if masks[component] >> at & 1
    )


@pytest.mark.parametrize("processors", range(2, 6 if LONG else 5))
def test_more_critical_never_has_less(processors: int) -> None:
    for components, masks in systems(processors):
        everything = (1 << processors) - 1
        by_weight = sorted(zip(components, masks, strict=True), key=lambda pair: pair[0].criticality)
        assert by_weight[-1][1] == everything
        for (lower, narrow), (upper, wide) in pairwise(by_weight):
            assert narrow & wide == narrow, "what the less critical may use, the more critical may"
            assert lower.criticality != upper.criticality or narrow == wide
        narrowed = [(component.processors or 0, mask) for component, mask in by_weight if mask != everything]
        for number in range(1, len(narrowed) + 1):
            for some in combinations(narrowed, number):
                together = 0
                for _, mask in some:
                    together |= mask
                assert sum(wanted for wanted, _ in some) <= together.bit_count(), "Hall's condition: each finds its own"


def test_explicit_number_is_kept_if_possible() -> None:
    for components, masks in systems(4):
        narrowed = {component.name: mask for component, mask in zip(components, masks, strict=True) if mask != 0b1111}
        assert narrowed == {
            component.name: 0b1111 & ~((1 << (4 - below)) - 1)
            for component in components
            if component.criticality < max(each.criticality for each in components)
            for below in [sum(each.processors or 4 for each in components if each.criticality <= component.criticality)]
            if below < 4
        }


def test_masks_are_found_in_any_order_of_classes() -> None:
    classes = [[a_class("arm", 30)], [a_class("log", 10, 1)], [a_class("map", 20, 1)]]
    wanted: Mapping[str, int] = {"log": 0b1000, "map": 0b1100}

    assert all(masks_of(order, 4) == wanted for order in (classes, classes[::-1], [classes[1], classes[0], classes[2]]))
