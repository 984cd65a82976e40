"""The scripts of two plans compared by what their steps do."""

from dataclasses import replace

from rarms_iac.powershell.comparison import Detail, ScriptDifference, ScriptSteps, compare_steps
from rarms_iac.powershell.render import script_steps
from tests import builders_plan as build
from tests.unit.powershell.plans import marked, rendered_plan


def script(*, reserve: int = 40, plan: str = "0123456789ab", more: bool = False) -> ScriptSteps:
    old, new = build.partition(build.settings(reserve=70)), build.partition(build.settings(reserve=reserve))
    made = build.create(marked(replace(build.partition(build.settings("planning")), id="")))
    on, whole = rendered_plan((build.update(old, marked(new)), *([made] if more else [])))
    return ScriptSteps(plan=plan, steps=script_steps(on, replace(whole, id=plan), "", undo=False))


def compared(old: ScriptSteps, new: ScriptSteps) -> ScriptDifference:
    return compare_steps(old, new, ("a", "b"))


def test_same_steps_of_another_plan_do_not_differ() -> None:
    found = compared(script(more=True), script(more=True, plan="ba9876543210"))

    assert (found.steps, found.same) == ((), len(script(more=True).steps))


def test_changed_step_names_readings_and_calls() -> None:
    (step,) = compared(script(reserve=40), script(reserve=30)).steps

    assert (step.address, step.old, step.new, step.moved) == ("partition/vision", 1, 1, False)
    reading, call = step.details
    assert reading == Detail(name="after.reserve", old="40", new="30")
    assert call.name == "Hyper-V\\Set-VMProcessor"
    assert call.new is not None
    assert "-Reserve 30 " in call.new


def test_steps_that_only_one_has() -> None:
    added, gone = compared(script(), script(more=True)), compared(script(more=True), script())

    assert {step.address for step in added.steps} == {"partition/planning", "partition/planning/disk"}
    assert all(step.old is None for step in added.steps)
    assert [step.action for step in gone.steps] == [step.action for step in added.steps]
    assert all(step.new is None for step in gone.steps)
    assert added.same == gone.same == len(script().steps)


def test_moved_step_is_told_once() -> None:
    old = script(more=True)
    first, *others = old.steps

    (moved,) = compared(old, replace(old, steps=(*others, first))).steps

    assert (moved.moved, moved.old, moved.new, moved.details) == (True, 1, len(others) + 1, ())
