import pytest

from rarms_iac.model.system import Component, TaskCategory, TaskRequest
from rarms_iac.planner.task_classes import Classes, classes_of, registry_values
from tests.builders import a_component, a_task, codes
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
    assert "MotionControl goes first, and so does SpeechRecognition." in found.findings[0].detail


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
