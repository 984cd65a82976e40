"""The script of a guest that nobody could look into: one guarded piece a class, and what was there before is kept."""

from rarms_iac.model.state import RegistryValue, ValueKind
from rarms_iac.powershell.guests import LOST, GuestTask
from rarms_iac.powershell.inspection.allowed import ScriptKind
from rarms_iac.powershell.inspection.inspect import inspect
from rarms_iac.powershell.outline import MachineVariable, ScriptCall, outline
from rarms_iac.powershell.render import render_guest
from tests import builders_plan as build
from tests.unit.powershell.plans import rendered_plan


def task(name: str, *, replace: bool = False) -> GuestTask:
    return GuestTask(
        application="robot",
        partition="vision",
        name=name,
        values={
            "Priority": RegistryValue(kind=ValueKind.DWORD, data=6),
            "Scheduling Category": RegistryValue(kind=ValueKind.SZ, data="Medium"),
        },
        set="0123456789ab",
        replace=replace,
        place=build.because().place,
    )


def scripts() -> tuple[bytes, bytes]:
    on, plan = rendered_plan(())
    made = render_guest(on, plan, "vision", [task("Games", replace=True), task("MotionControl")])
    assert sorted(made) == ["onboard.guest.vision.ps1", "onboard.guest.vision.undo.ps1"]
    return made["onboard.guest.vision.ps1"], made["onboard.guest.vision.undo.ps1"]


def test_both_scripts_pass_the_inspection() -> None:
    apply, undo = scripts()

    assert inspect(apply, ScriptKind.APPLY) == ()
    assert inspect(undo, ScriptKind.UNDO) == ()
    assert scripts() == (apply, undo)


def test_a_class_must_be_free_and_nothing_else_is_claimed_of_it() -> None:
    games, motion = outline(scripts()[0]).steps

    reads: dict[str, bool | int | str | MachineVariable | ScriptCall] = {
        "Task": "MotionControl",
        "Application": "robot",
        "Replace": False,
    }
    assert motion.read == ScriptCall(name="Read-GuestTaskClass", parameters=reads)
    assert games.read.parameters["Replace"] is True
    assert motion.before == {"taken": False}
    assert motion.after == {
        "exists": True,
        "values": "priority, scheduling category",
        "value:priority": "dword:6",
        "value:scheduling category": "sz:Medium",
        "record": "robot",
        "set": "0123456789ab",
    }
    assert [call.name for call in motion.calls] == [
        "Save-TaskRecord",
        "Write-TaskValue",
        "Write-TaskValue",
        "Clear-TaskValue",
    ]


def test_the_undo_goes_back_to_what_was_there_before_rarms_and_says_so() -> None:
    apply, undo = scripts()
    steps = outline(undo).steps

    assert [(step.address.rpartition("/")[2], step.undoes) for step in steps] == [("MotionControl", 1), ("Games", 0)]
    assert [call.name for call in steps[0].calls] == ["Restore-TaskClass", "Clear-TaskRecord"]
    assert steps[0].before == {"taken": False, "record": "robot", "set": "0123456789ab"}
    assert steps[0].after == {"record": "", "set": "", "empty": False}
    assert LOST[:40] in undo.decode()
    assert outline(apply).run["Guest"] == "vision"
