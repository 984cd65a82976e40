"""What an undo is going to do, before it is asked for."""

from collections.abc import Sequence

from rarms_iac.apply.run_script import TakenBack
from rarms_iac.model.journal import RunStarted, ScriptStarted
from rarms_iac.model.plan import UndoLevel
from rarms_iac.views.diagnostics.layout import hanging, visible, wrap

LEVELS = {UndoLevel.FULL: "", UndoLevel.PARTIAL: " (in part)", UndoLevel.NONE: ""}
STAYS = "stays done: "


def undo_text(host: str, started: RunStarted | ScriptStarted, steps: Sequence[TakenBack], *, width: int) -> str:
    """What is going to be done, in that order; what cannot be taken back is said to stay."""
    by = visible(started.started_by, keep="")
    head = f"To take back plan {started.plan} on {host}, applied by {by}, this is done, the last change first:"
    shown = [line for step in steps for line in hanging("  ", _line(step), width, more=2)]
    return "\n".join([*wrap(head, width, ""), *(shown or ["  no step of it changed anything"])])


def _line(step: TakenBack) -> str:
    stays = STAYS if step.level is UndoLevel.NONE else ""
    return f"{step.address}: {stays}{visible(step.title, keep='')}{LEVELS[step.level]}"
