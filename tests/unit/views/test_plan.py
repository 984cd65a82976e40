from dataclasses import replace

import pytest

from rarms_iac.model.changes import Change
from rarms_iac.model.operations import RemovePartition, StopPartition
from rarms_iac.model.plan import HostPlan, Plan, Purpose, ThreadClass, Undo, UndoLevel
from rarms_iac.model.system import Disruption
from rarms_iac.views.console import render
from rarms_iac.views.plan import plan_summary, plan_text
from tests.builders import a_component, a_host, a_system
from tests.builders_plan import (
    a_rich_plan,
    because,
    create,
    delete,
    host_plan,
    partition,
    plan,
    settings,
    step,
    task,
    update,
)
from tests.lab import a_lab


def lines_of(shown: Plan, *, verbose: bool = False, width: int = 80) -> list[str]:
    return render(plan_text(shown, verbose=verbose), width).splitlines()


def shown_alone(change: Change, *, verbose: bool = False) -> list[str]:
    """The text of a plan with this change alone."""
    return lines_of(plan(host_plan(changes=[change])), verbose=verbose)


def test_no_changes_is_one_line() -> None:
    assert lines_of(plan()) == ["No changes. The host is as in the manifest."]
    assert (
        plan_summary(plan(purpose=Purpose.DESTROY)) == "No changes. No resource of this application exists on the host."
    )


def test_new_partition_is_one_line() -> None:
    part = replace(
        host_plan(changes=[create(partition(settings(processors=1, reserve=30))), create(task(inside="vision"))]),
        components={"vision": ("vision", "speech")},
    )

    lines = lines_of(plan(part))

    assert "  + vision [vision, speech]       0.3 LP  512 MiB  task MotionControl" in lines
    assert lines[-1] == "Plan: 2 to add (1 task class with its partition), 0 to change, 0 to remove."
    assert lines_of(plan(host_plan(changes=[create(task())])))[-1] == "Plan: 1 to add, 0 to change, 0 to remove."


def test_change_shows_difference_and_verbose_reason() -> None:
    change = update(partition(settings(reserve=70)), partition(settings(reserve=40)), reason=because("asked", line=7))

    assert "  ~ vision  1.4 LP -> 0.8 LP  512 MiB" in shown_alone(change)
    shown = shown_alone(change, verbose=True)
    start = shown.index("  ~ vision  (rarms.yaml:7)")
    assert [line.split() for line in shown[start + 1 : start + 3]] == [["asked"], ["name", "vision"]]
    reserve = next(line.split() for line in shown if line.strip().startswith("reserve"))
    assert " ".join(reserve).startswith("reserve 1.4 LP -> 0.8 LP (40 % of its 2 VPs, 40 % of")


def test_what_forces_a_restart_stands_beside_its_attribute() -> None:
    before, after = partition(settings(processors=1, reserve=20)), partition(settings(processors=2, reserve=10))

    shown = shown_alone(update(before, after, disruption=Disruption.PARTITION_STOP), verbose=True)

    assert "  ~ vision, stops the partition  (rarms.yaml:31)" in shown
    assert any(line.split() == ["processors", "1", "->", "2", "(forces", "restart)"] for line in shown)


def test_remaking_is_said_and_counts_twice() -> None:
    before, after = partition(settings(generation=1)), partition(settings(generation=2))

    shown = shown_alone(update(before, after, disruption=Disruption.REMOVAL))

    assert "  -/+ vision       0.8 LP  512 MiB  generation 1 -> 2; made again" in shown
    assert shown[-1] == "Plan: 1 to add, 0 to change, 1 to remove."


def test_reserve_is_lps_with_share() -> None:
    narrow = shown_alone(create(partition(settings(processors=1, reserve=30))), verbose=True)
    wide = shown_alone(create(partition(settings(processors=2, reserve=30))), verbose=True)

    assert "reserve 0.3 LP (30 % of its 1 VP, 15 % of onboard)" in [" ".join(line.split()) for line in narrow]
    assert "reserve 0.6 LP (30 % of its 2 VPs, 30 % of onboard)" in [" ".join(line.split()) for line in wide]


def test_changed_reserve_is_in_lps() -> None:
    narrow = update(partition(settings(processors=1, reserve=80)), partition(settings(processors=1, reserve=60)))
    wide = update(partition(settings(processors=2, reserve=80)), partition(settings(processors=2, reserve=60)))

    assert "  ~ vision  0.8 LP -> 0.6 LP  512 MiB" in shown_alone(narrow)
    assert "  ~ vision  1.6 LP -> 1.2 LP  512 MiB" in shown_alone(wide)


def test_lost_parts_are_not_listed_as_restored() -> None:
    change = delete(partition(settings()))
    stop = StopPartition(partition="vision", grace_ms=60_000)
    partly = Undo(level=UndoLevel.PARTIAL, operation=None, message="it starts again")
    lost = Undo(level=UndoLevel.NONE, operation=None, message="it is not made again")
    removal = step(change.address, operation=RemovePartition(partition="vision", machine="an id"))
    steps = [
        replace(step(change.address, operation=stop), undo=partly),
        replace(removal, undo=lost, after={"exists": False}),
    ]

    shown = " ".join(" ".join(lines_of(plan(host_plan(changes=[change], steps=steps)))).split())

    assert "cannot be undone; it is not made again" in shown
    assert "it starts again" not in shown


def test_task_class_shows_types_and_effect() -> None:
    change = update(task(priority=3), task(priority=5), disruption=Disruption.HOST_RESTART)

    text = " ".join(" ".join(shown_alone(change)).split())

    assert "~ task/MotionControl Priority 3 (dword) -> 5 (dword); when the host starts again" in text


@pytest.mark.parametrize(
    "line",
    [
        "Host onboard (simulated, 2 LP, 4 GiB)",
        "Host workshop (simulated, 4 LP, 4 GiB)",
        "  partition/former is no longer in the manifest and is stopped. Remove it with",
        "  partition/old, remove it: cannot be undone; it is not made again",
        "  ~ speech    0.4 LP -> 0.8 LP  512 MiB  processors 1 -> 2; stops the partition",
        "  Afterwards: 1.9 LP of 2 LP reserved, 0.1 LP free.",
        "warning[RARMS041] A change restarts or stops a partition",
    ],
)
def test_a_reviewer_sees_what_else_matters(line: str) -> None:
    assert line in lines_of(a_rich_plan())


def test_steps_are_shown_on_request_in_their_order() -> None:
    shown = lines_of(a_rich_plan(), verbose=True)

    assert "  1. partition/vision: reserve 70 -> 40 %  (rarms.yaml:31)" in shown
    assert "  2. partition/old: remove it  (rarms.yaml:31)" in shown
    assert "  1. partition/vision: reserve 70 -> 40 %  (rarms.yaml:31)" not in lines_of(a_rich_plan())


def test_step_does_not_repeat_reason_of_its_change() -> None:
    change = create(partition(), because("asked"))

    steps = [step(change.address, comment="why here")]
    shown = lines_of(plan(host_plan(changes=[change], steps=steps)), verbose=True)

    assert [line.strip() for line in shown].count("asked") == 1
    assert "     why here" in shown


def test_nothing_is_wider_than_80_columns() -> None:
    long = replace(because("a reason with many words " * 12))
    change = create(partition(), long)
    titled = step(
        change.address, title="mark it as an-application/with-a-long-name, set 0123456789ab", comment="why " * 40
    )
    shown = lines_of(plan(host_plan(changes=[change], steps=[titled])), verbose=True)

    assert max(map(len, [*shown, *lines_of(a_rich_plan(), verbose=True)])) <= 80


def test_hostile_names_cannot_act_on_a_terminal() -> None:
    hostile = update(partition(settings("\x1b[2Jboom")), partition(settings("vision")))

    assert "\x1b" not in "".join(lines_of(plan(host_plan(changes=[hostile])), verbose=True))


def test_hosts_without_changes_are_one_line_together() -> None:
    changed = host_plan(changes=[create(partition(settings()))])
    quiet = [host_plan(host=a_host(name), unchanged=3) for name in ("spare", "workshop")]

    lines = lines_of(plan(changed, *quiet))

    assert [line for line in lines if line.startswith("Host ")] == ["Host onboard (simulated, 2 LP, 4 GiB)"]
    assert "No changes on 2 more hosts: spare, workshop." in lines
    assert lines_of(plan(*quiet)) == ["No changes. The hosts are as in the manifest."]


def test_step_speaks_of_host_in_words_of_plan() -> None:
    with a_lab(a_system(components=[a_component("eyes")])) as lab:
        shown = "\n".join(lines_of(lab.plan(), verbose=True, width=120))

    assert "partition/eyes: automatic start yes, stop action shut down, checkpoints disabled" in shown


def a_class(task: str, priority: int, *components: str, inside: str = "") -> ThreadClass:
    return ThreadClass(inside=inside, task=task, category="Medium", thread_priority=priority, components=components)


CLASSES = (
    a_class("MotionControl", 23, "arm"),
    a_class("ObjectIdentification", 23, "camera", "lidar", inside="vision"),
    a_class("Localization", 21, "map", inside="vision"),
)


def threads_of(part: HostPlan) -> list[str]:
    lines = lines_of(plan(part), verbose=True)
    start = next((at for at, line in enumerate(lines) if "Thread priorities" in line), len(lines))
    return [line for line in lines[start : start + 5] if line.startswith("  ")]


def test_thread_priorities_stand_by_operating_system_highest_first() -> None:
    part = replace(host_plan(changes=[create(task())]), threads=CLASSES)

    assert threads_of(part) == [
        "  Thread priorities, after its Windows has restarted:",
        "    where             priority  task class            category  components",
        "    the host itself         23  MotionControl         Medium    arm",
        "    partition/vision        23  ObjectIdentification  Medium    camera, lidar",
        "    partition/vision        21  Localization          Medium    map",
    ]


def test_guest_script_by_hand_is_shown() -> None:
    part = replace(host_plan(scripts={"onboard.guest.vision.ps1": "..."}, unused=["old"]), threads=CLASSES)

    assert len(threads_of(part)) == 5


def test_plan_without_classes_names_no_threads() -> None:
    part = replace(host_plan(changes=[create(partition())]), threads=CLASSES)

    assert threads_of(part) == []
