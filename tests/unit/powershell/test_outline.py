import pytest

from rarms_iac.model.plan import Readings
from rarms_iac.powershell.outline import MachineVariable, ScriptCall, outline
from rarms_iac.powershell.pieces import NewFiles, pieces_of
from rarms_iac.powershell.render import insides, render_apply, render_observe, render_scripts, render_undo
from tests.unit.powershell.plans import rendered_plan


def test_a_script_says_all_that_its_plan_says() -> None:
    on, plan = rendered_plan()

    told = [step for inside in insides(on) for step in outline(render_apply(on, plan, inside)).steps]

    files = NewFiles(plan=plan.id, disk_folder=on.facts.disk_folder)
    for part in (part for step in on.steps for part in pieces_of(step, files)):
        steps = [step for step in told if step.address == part.address]
        assert any(_lower(part.after) <= _lower(step.after) for step in steps), part
        assert any(_lower(part.before) <= _lower(step.before) for step in steps), part
        assert any(call.split()[0] in {made.name for made in step.calls} for call in part.calls for step in steps)


def _lower(readings: Readings) -> set[tuple[str, object]]:
    """As a script has them, in every culture's capitals; without what goes without saying."""
    implied = {"exists", *(["running"] if "state" in readings else [])}
    return {
        (name.lower(), value)
        for name, value in readings.items()
        if name not in implied or (name, value) == ("exists", False)
    }


def test_a_set_block_is_read_call_by_call() -> None:
    step = outline(render_apply(*rendered_plan())).steps[0]

    assert step.read == ScriptCall(name="Get-PartitionReading", parameters={"Machine": "id-of-vision"})
    assert step.calls == (
        ScriptCall(
            name="Hyper-V\\Set-VMProcessor",
            parameters={"VM": MachineVariable(), "Reserve": 40, "Maximum": 100, "RelativeWeight": 200},
        ),
        ScriptCall(name="Write-Mark", parameters={}),
    )


def test_a_value_that_a_cmdlet_gives_is_a_call_inside() -> None:
    steps = outline(render_apply(*rendered_plan())).steps
    (firmware,) = (call for step in steps for call in step.calls if call.name == "Hyper-V\\Set-VMFirmware")

    drive = ScriptCall(name="Hyper-V\\Get-VMHardDiskDrive", parameters={"VM": MachineVariable()})
    assert firmware.parameters["FirstBootDevice"] == drive


def test_the_run_and_what_an_undo_takes_back() -> None:
    on, plan = rendered_plan()
    applied, undone = outline(render_apply(on, plan)), outline(render_undo(on, plan))

    assert (applied.run["Run"], undone.run["Run"], applied.run["Serial"]) == ("apply", "undo", 3)
    by_number = {step.number: step for step in applied.steps}
    for step in undone.steps:
        assert step.undoes is not None
        if step.read.name == "Get-FolderReading":
            assert (step.before, step.after) == ({}, {"folders": 0})  # what was made beside the machine
            continue
        done = by_number[step.undoes]
        # That no other has the name is a guard, not something to bring back.
        brought_back = {name: value for name, value in done.before.items() if name != "taken"}
        after = {name: value for name, value in step.after.items() if name != "empty"}  # what a kill may have left
        assert _lower(after) == _lower(brought_back)
        if "added" in step.before:
            assert step.before == {"exists": True, "added": ""}
        elif step.read.name == "Get-DiskReading":
            assert step.before == {"exists": True, "child": True, "used": False}
        else:
            assert _lower(step.before) == _lower({name: value for name, value in done.after.items() if name != "empty"})
    undoes = [step.undoes for step in undone.steps if step.undoes is not None]
    assert undoes == sorted(undoes, reverse=True)


def test_names_of_the_outside_world_come_through_whole() -> None:
    calls = [
        call
        for script in render_scripts(*rendered_plan()).values()
        for step in outline(script).steps
        for call in step.calls
    ]

    assert "lab \u2018net\u2019" in [call.parameters.get("SwitchName") for call in calls]


def test_a_script_without_a_run_has_no_outline() -> None:
    with pytest.raises(ValueError, match="plan that begins"):
        outline(render_observe())
