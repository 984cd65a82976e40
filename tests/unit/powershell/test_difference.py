"""Two scripts compared by what their steps do, and not by their lines."""

from dataclasses import replace

from rarms_iac.powershell.outline import Detail, Outline, ScriptCall, difference, outline
from rarms_iac.powershell.render import render_apply
from tests import builders_plan as build
from tests.unit.powershell.plans import marked, rendered_plan


def script(*, reserve: int = 40, plan: str = "0123456789ab", more: bool = False) -> Outline:
    old, new = build.partition(build.settings(reserve=70)), build.partition(build.settings(reserve=reserve))
    made = build.create(marked(replace(build.partition(build.settings("planning")), id="")))
    on, whole = rendered_plan((build.update(old, marked(new)), *([made] if more else [])))
    return outline(render_apply(on, replace(whole, id=plan)))


def test_a_script_does_what_it_does() -> None:
    told = difference(script(more=True), script(more=True))

    assert told.is_empty
    assert told.same == len(script(more=True).steps)


def test_another_plan_with_the_same_steps_differs_in_its_id_alone() -> None:
    told = difference(script(more=True), script(more=True, plan="ba9876543210"))

    assert told.steps == ()
    assert told.run == (Detail(name="run.Plan", old="0123456789ab", new="ba9876543210"),)


def test_a_step_that_differs_says_which_readings_and_which_parameters() -> None:
    (step,) = difference(script(reserve=40), script(reserve=30)).steps

    assert step.address == "partition/vision"
    assert (step.old, step.new, step.moved) == (1, 1, False)
    assert step.details == (
        Detail(name="after.reserve", old="40", new="30"),
        Detail(name="Hyper-V\\Set-VMProcessor -Reserve", old="40", new="30"),
    )


def test_steps_that_only_one_has() -> None:
    added = difference(script(), script(more=True))
    gone = difference(script(more=True), script())

    assert {step.address for step in added.steps} == {"partition/planning", "partition/planning/disk"}
    assert all(step.old is None for step in added.steps)
    assert [step.action for step in gone.steps] == [step.action for step in added.steps]
    assert all(step.new is None for step in gone.steps)
    assert added.same == gone.same == len(script().steps)


def test_a_step_that_was_moved_is_told_once() -> None:
    old = script(more=True)
    first, *others = old.steps
    steps = tuple(replace(step, number=at) for at, step in enumerate([*others, first]))

    (moved,) = difference(old, Outline(run=old.run, steps=steps)).steps

    assert (moved.moved, moved.old, moved.new) == (True, 1, len(others) + 1)
    assert moved.details == ()


def test_a_call_that_was_added_by_hand_makes_another_step_of_it() -> None:
    old = script()
    (step, *others) = old.steps
    more = replace(step, calls=(*step.calls, ScriptCall(name="Clear-Mark", parameters={"Name": "vision"})))

    told = difference(old, Outline(run=old.run, steps=(more, *others)))

    assert [(step.old, step.new) for step in told.steps] == [(None, 1), (1, None)]
