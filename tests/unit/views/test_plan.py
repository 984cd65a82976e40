from dataclasses import replace

import pytest

from rarms_iac.model.changes import Adopt, Change, Release
from rarms_iac.model.plan import Plan, Purpose
from rarms_iac.model.system import Disruption
from rarms_iac.views.plan import plan_text, summary
from tests.builders import a_component, a_host, a_system
from tests.builders_plan import (
    a_rich_plan,
    address_of,
    because,
    create,
    delete,
    held,
    host_plan,
    partition,
    plan,
    settings,
    step,
    task,
    update,
)
from tests.lab import a_lab


def lines_of(shown: Plan) -> list[str]:
    return plan_text(shown).splitlines()


def one(change: Change) -> list[str]:
    """The text of a plan with this change alone."""
    return lines_of(plan(host_plan(changes=[change])))


def test_no_changes_is_one_line() -> None:
    assert plan_text(plan()) == "No changes. The host is as the manifest wants it.\n"
    assert summary(plan(purpose=Purpose.DESTROY)) == "No changes. Nothing on the host is of this application."


def test_the_last_line_counts() -> None:
    assert lines_of(a_rich_plan())[-1] == "Plan: 2 to add, 2 to change, 1 to remove. 1 held back."


def test_adopted_and_released_partitions_are_counted_apart() -> None:
    ours, theirs = partition(), partition(application=None)
    adopt = Adopt(address=address_of(theirs), before=theirs, after=ours, reason=because())
    release = Release(address=address_of(ours), before=ours, after=theirs, reason=because())

    shown = lines_of(plan(host_plan(changes=[adopt, release])))

    assert shown[-1] == "Plan: 0 to add, 0 to change, 0 to remove, 1 to adopt, 1 to release."
    assert "      mark  none -> robot/vision" in shown
    assert "      mark  robot/vision -> none" in shown
    assert "  > adopt   < release" in shown


def test_a_change_shows_what_differs_its_reason_and_its_line_and_hides_the_rest_with_a_count() -> None:
    shown = one(
        update(partition(settings(reserve=70)), partition(settings(reserve=40)), reason=because("asked", line=7))
    )

    start = shown.index("  ~ partition/vision  (rarms.yaml:7)")
    assert shown[start + 1 : start + 4] == [
        "      asked",
        "      reserve  70 % -> 40 %",
        "      (11 unchanged attributes hidden)",
    ]


def test_what_forces_a_restart_stands_beside_its_attribute() -> None:
    before, after = partition(settings(processors=1, reserve=20)), partition(settings(processors=2, reserve=10))

    shown = one(update(before, after, disruption=Disruption.PARTITION_STOP))

    assert "  ~ partition/vision, stops the partition  (rarms.yaml:31)" in shown
    assert "      processors  1 -> 2  (forces restart)" in shown
    assert "      reserve     20 % -> 10 %" in shown


def test_a_live_change_forces_nothing() -> None:
    shown = one(update(partition(settings(ram="512 MiB")), partition(settings(ram="1 GiB"))))

    assert "      memory  512 MiB -> 1 GiB" in shown
    assert not any("stops" in line for line in shown)


def test_what_must_be_made_again_says_so_and_counts_twice() -> None:
    before, after = partition(settings(generation=1)), partition(settings(generation=2))

    shown = one(update(before, after, disruption=Disruption.REMOVAL))

    assert "  -/+ partition/vision, made again  (rarms.yaml:31)" in shown
    assert "      generation  1 -> 2  (forces replacement)" in shown
    assert shown[-1] == "Plan: 1 to add, 0 to change, 1 to remove."


def test_a_reserve_is_shown_as_a_share_of_the_host_where_that_is_another_number() -> None:
    assert "      reserve               30 %  (0.3 LP, 15 % of the host)" in one(
        create(partition(settings(processors=1, reserve=30)))
    )
    assert "      reserve               30 %" in one(create(partition(settings(processors=2, reserve=30))))


def test_a_removal_says_that_disks_stay() -> None:
    assert "  - partition/vision, removed, its disks stay" in one(delete(partition()))


def test_a_task_class_shows_its_types_and_when_it_takes_effect() -> None:
    change = update(task(priority=3), task(priority=5), disruption=Disruption.HOST_RESTART)

    shown = one(change)

    assert "  ~ task/MotionControl, when the host starts again  (rarms.yaml:31)" in shown
    assert "      Priority  3 (dword) -> 5 (dword)" in shown


def test_held_back_changes_are_listed_apart_with_why() -> None:
    shown = lines_of(plan(host_plan(held_back=[held(create(partition()), "because")]), max_disruption=Disruption.LIVE))

    assert "  Held back, not in the plan (it may disturb at most: live):" in shown
    assert "      because" in shown
    assert shown[-1] == "No changes to make now; 1 held back."


@pytest.mark.parametrize(
    "line",
    [
        "Host onboard (simulated, 2 LP, 4 GiB)",
        "Host workshop (simulated, 4 LP, 4 GiB)",
        "  3 unchanged resources hidden.",
        "    partition/former: remove it with `rarms destroy --target partition/former`",
        "    partition/old, remove the machine: not at all; it is not made again",
        "    stops the partition: partition/speech",
        "    reserved      1.9 LP     95 %      2 GiB",
        "    free          0.1 LP      5 %      2 GiB",
        "warning[RARMS041] A change restarts or stops a partition",
    ],
)
def test_a_reviewer_sees_what_else_matters(line: str) -> None:
    assert line in lines_of(a_rich_plan())


def test_steps_are_shown_on_request_in_their_order() -> None:
    shown = plan_text(a_rich_plan(), steps=True).splitlines()

    assert "  1. partition/vision: reserve 70 -> 40 % (rarms.yaml:31)" in shown
    assert "  2. partition/old: remove the machine (rarms.yaml:31)" in shown
    assert "  1. partition/vision: reserve 70 -> 40 % (rarms.yaml:31)" not in lines_of(a_rich_plan())


def test_a_step_does_not_repeat_the_reason_of_its_change() -> None:
    change = create(partition(), because("asked"))

    shown = plan_text(
        plan(host_plan(changes=[change], steps=[step(change.address, comment="asked; why here")])), steps=True
    )

    assert shown.count("asked") == 1
    assert "     why here\n" in shown


def test_nothing_is_wider_than_80_columns() -> None:
    long = replace(because("a reason with many words " * 12))
    change = create(partition(), long)
    titled = step(
        change.address, title="mark it as an-application/with-a-long-name, set 0123456789ab", comment="why " * 40
    )
    shown = plan_text(plan(host_plan(changes=[change], steps=[titled])), steps=True).splitlines()

    assert max(map(len, [*shown, *plan_text(a_rich_plan(), steps=True).splitlines()])) <= 80


def test_hostile_names_cannot_act_on_a_terminal() -> None:
    hostile = update(partition(settings("\x1b[2Jboom")), partition(settings("vision")))

    assert "\x1b" not in plan_text(plan(host_plan(changes=[hostile])))


def test_hosts_without_changes_are_one_line_together() -> None:
    changed = host_plan(changes=[create(partition(settings()))])
    quiet = [host_plan(host=a_host(name), unchanged=3) for name in ("spare", "workshop")]

    lines = lines_of(plan(changed, *quiet))

    assert [line for line in lines if line.startswith("Host ")] == ["Host onboard (simulated, 2 LP, 4 GiB)"]
    assert "  No changes on 2 more hosts: spare, workshop." in lines
    assert lines_of(plan(*quiet)) == ["No changes. The hosts are as the manifest wants them."]


def test_a_step_speaks_of_the_host_in_the_words_of_the_plan() -> None:
    with a_lab(a_system(components=[a_component("eyes")])) as lab:
        shown = plan_text(lab.plan(), steps=True, width=120)

    assert "partition/eyes: when the host starts: start, when it stops: shut down; no checkpoints" in shown
