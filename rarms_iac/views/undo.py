"""What an undo is going to do, before it is asked for."""

from collections.abc import Sequence

from rarms_iac.apply.scripted import TakenBack
from rarms_iac.model.journal import RunStarted, ScriptStarted
from rarms_iac.model.plan import UndoLevel
from rarms_iac.views.diagnostics.layout import hanging, visible, wrap

LEVELS = {UndoLevel.FULL: "", UndoLevel.PARTIAL: " (partly)", UndoLevel.NONE: " (cannot be taken back)"}


def undo_text(host: str, started: RunStarted | ScriptStarted, steps: Sequence[TakenBack], *, width: int) -> str:
    """The steps in the order in which they are taken back."""
    head = f"Taking back plan {started.plan} on {host}, begun by {visible(started.started_by, keep='')}:"
    shown = [
        line
        for step in steps
        for line in hanging("  ", f"{step.address}: {visible(step.title, keep='')}{LEVELS[step.level]}", width, more=2)
    ]
    return "\n".join([*wrap(head, width, ""), *(shown or ["  no step of it changed anything"])])
