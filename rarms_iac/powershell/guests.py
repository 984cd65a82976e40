"""Task classes of a guest that could not be looked into: what its script finds there decides.

One guarded piece a class. The class must be free: not there, ours already, or one that the manifest replaces. What
was there before is kept by the script itself, once, in the guest's own record; its undo script brings that back.
"""

from rarms_iac.model.claims import Claim
from rarms_iac.model.facets import Reading
from rarms_iac.model.operations import WriteTaskClass
from rarms_iac.model.plan import GuestTask, Step, Undo, UndoLevel
from rarms_iac.model.system import Disruption
from rarms_iac.powershell.literals import literal
from rarms_iac.powershell.pieces import NO_EMPTY_KEYS, VALUE, ScriptPiece, call, task_value_calls

LOST = "restores the values of the class from before rarms"


def step_of(task: GuestTask) -> Step:
    """Return the step that people are shown; it claims no state, so its readings are empty."""
    return Step(
        address=task.address,
        title=f"write the class {task.name}, and save its earlier values",
        operation=WriteTaskClass(task=task.name, inside=task.partition, values=task.values),
        before={},
        after={},
        undo=Undo(level=UndoLevel.PARTIAL, operation=None, message=LOST),
        disruption=Disruption.PARTITION_STOP,
        claim_before=Claim(),
        claim_after=Claim(),
        comment=(
            "the values in the guest are not known, so its record decides; it takes effect when the guest restarts"
        ),
        place=task.place,
    )


def forward(task: GuestTask, application: str) -> ScriptPiece:
    """Return the piece that writes the class."""
    whose = {"Task": literal(task.name), "Application": literal(application)}
    names = sorted(task.values)
    values: dict[str, Reading] = {
        f"{VALUE}{name}": f"{registry_value.kind.value}:{registry_value.data}"
        for name, registry_value in sorted(task.values.items())
    }
    return ScriptPiece(
        address=str(task.address),
        action=step_of(task).title,
        read=call("Get-GuestTaskClassReading", **whose, Replace=literal(task.replace)),
        before={"taken": False},
        after={
            "exists": True,
            "values": ", ".join(sorted(name.lower() for name in names)),
            **values,
            **_recorded(task, application),
        },
        calls=(
            call("Save-TaskRecord", **whose, Digest=literal(task.set)),
            *task_value_calls(task.name, task.values),
            call("Remove-TaskValue", Task=literal(task.name), Keep=literal(", ".join(names))),
        ),
    )


def back(task: GuestTask, application: str) -> ScriptPiece:
    """Return the piece that brings back what was there before rarms."""
    whose = {"Task": literal(task.name), "Application": literal(application)}
    return ScriptPiece(
        address=str(task.address),
        action=f"restore the values of {task.name} from before rarms",
        read=call("Get-GuestTaskClassReading", **whose, Replace=literal(task.replace)),
        before={"taken": False, **_recorded(task, application)},
        after={"record": "", "set": "", **NO_EMPTY_KEYS},
        calls=(call("Restore-TaskClass", **whose), call("Remove-TaskRecord", **whose)),
    )


def _recorded(task: GuestTask, application: str) -> dict[str, Reading]:
    return {"record": application, "set": task.set}
