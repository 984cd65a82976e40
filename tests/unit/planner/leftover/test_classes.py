import pytest

from rarms_iac.model.system import Component, TaskCategory, TaskWish
from rarms_iac.planner.leftover.classes import Classes, classes_of, registry_values
from tests.builders import a_component, a_task, codes
from tests.planning import PLACES


def decided(components: list[Component], *wishes: TaskWish) -> Classes:
    return classes_of(components, {one.name: one for one in wishes}, "media", PLACES)


def users(**criticalities: int) -> list[Component]:
    """A component each, called after its class."""
    return [a_component(name.lower(), task=name, criticality=value) for name, value in criticalities.items()]


def threads(found: Classes) -> dict[str, int]:
    return {one.name: one.thread_priority for one in found.classes}


def test_threads_run_in_the_order_of_criticalities_and_equals_alike() -> None:
    found = decided(users(Localization=10, MotionControl=40, SpeechRecognition=10))

    assert threads(found) == {"MotionControl": 23, "Localization": 21, "SpeechRecognition": 21}
    assert found.findings == ()


def test_a_shared_class_counts_as_its_most_critical_component() -> None:
    shared = [*users(Localization=20), a_component("a", task="MotionControl", criticality=5)]

    found = decided([*shared, a_component("b", task="motioncontrol", criticality=50)])

    assert threads(found) == {"MotionControl": 23, "Localization": 21}


def test_what_is_fixed_stands_and_the_rest_goes_around_it() -> None:
    found = decided(users(Localization=30, MotionControl=20, SpeechRecognition=10), a_task("MotionControl", priority=3))

    assert threads(found) == {"Localization": 23, "MotionControl": 19, "SpeechRecognition": 17}


def test_more_levels_than_medium_has_are_told() -> None:
    nine = [a_component(f"c{at}", task=f"Class{at}", criticality=at) for at in range(9)]

    found = decided(nine)

    assert codes(found.findings) == ["RARMS128", "RARMS129"]
    assert threads(decided(nine[1:])) == {f"Class{at}": 16 + at for at in range(1, 9)}


def test_a_fixed_class_that_leaves_no_room_above_is_told_once() -> None:
    found = decided(users(Localization=30, MotionControl=20), a_task("MotionControl", category=TaskCategory.HIGH))

    assert codes(found.findings) == ["RARMS128"]
    assert found.findings[0].address == "partition/media/task/Localization"


def test_two_fixed_classes_are_the_affair_of_the_manifests_own_checks() -> None:
    high = [a_task(name, category=TaskCategory.HIGH) for name in ("Localization", "MotionControl")]

    assert decided(users(Localization=30, MotionControl=20), *high).findings == ()


def test_all_values_have_their_types() -> None:
    (one,) = decided(users(Localization=30)).classes

    assert {name: (value.kind.value, value.data) for name, value in registry_values(one).items()} == {
        "Affinity": ("dword", 0),
        "Background Only": ("sz", "False"),
        "BackgroundPriority": ("dword", 7),
        "Clock Rate": ("dword", 10000),
        "GPU Priority": ("dword", 8),
        "Priority": ("dword", 7),
        "Scheduling Category": ("sz", "Medium"),
        "SFIO Priority": ("sz", "Normal"),
    }


@pytest.mark.parametrize(("count", "spread"), [(4, [23, 21, 19, 17]), (5, [23, 22, 21, 20, 19])])
def test_up_to_four_criticalities_keep_a_level_between_them(count: int, spread: list[int]) -> None:
    found = decided([a_component(f"c{at}", task=f"Class{at}", criticality=-at) for at in range(count)])

    assert sorted(threads(found).values(), reverse=True) == spread
    assert codes(found.findings) == ([] if count == 4 else ["RARMS129"])
