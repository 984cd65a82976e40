from dataclasses import replace

from rarms_iac.model.plan import HostPlan, ThreadClass
from rarms_iac.views.threads import threads_lines
from tests import builders_plan as build


def a_class(task: str, priority: int, *components: str, inside: str = "") -> ThreadClass:
    return ThreadClass(inside=inside, task=task, category="Medium", thread_priority=priority, components=components)


CLASSES = (
    a_class("MotionControl", 23, "arm"),
    a_class("ObjectIdentification", 23, "camera", "lidar", inside="vision"),
    a_class("Localization", 21, "map", inside="vision"),
)


def shown(part: HostPlan) -> list[str]:
    return list(threads_lines(part, 80))


def test_each_operating_system_has_its_table_highest_first() -> None:
    part = replace(build.host_plan(changes=[build.create(build.task())]), threads=CLASSES)

    assert shown(part) == [
        "",
        "  Thread priorities, once its Windows has started again:",
        "    the host itself",
        "      23  MotionControl         Medium  arm",
        "    partition/vision",
        "      23  ObjectIdentification  Medium  camera, lidar",
        "      21  Localization          Medium  map",
    ]


def test_a_guest_whose_script_is_run_by_hand_has_one_too() -> None:
    part = replace(build.host_plan(scripts={"onboard.guest.vision.ps1": "..."}), threads=CLASSES)

    assert len(shown(part)) == 7


def test_a_plan_that_changes_no_class_says_nothing_of_threads() -> None:
    part = replace(build.host_plan(changes=[build.create(build.partition())]), threads=CLASSES)

    assert shown(part) == []
