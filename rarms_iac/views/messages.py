"""Sentences that a command ends with."""

from typing import TYPE_CHECKING

from rarms_iac.views.console import paragraph, stack

if TYPE_CHECKING:
    from rich.console import RenderableType


def interruption_text(ending: str, command: str) -> "RenderableType":
    """Say that a command was interrupted or terminated, and how to go on; an empty line stands before it."""
    return stack("", paragraph(f"rarms was {ending}.{_advice_to_resume(command)}"))


def snapshot_script_text(path: str, name: str) -> str:
    """Say how the script that looks, written to a path, is run on its host."""
    return (
        f"Wrote {path}. Run it on the host as administrator, and take what it prints along:\n"
        f"  powershell -NoProfile -ExecutionPolicy RemoteSigned -File {name} > host.json\n"
        "Plan from it with: rarms plan --snapshot HOST=host.json"
    )


def _advice_to_resume(command: str) -> str:
    """Say what to do after an interrupt, with a space before it; nothing where the command leaves nothing behind."""
    if command in {"measure", "prove", "tune"}:
        return " What is recorded stays. The same command goes on where it stopped."
    if command in {"apply", "destroy", "import", "release", "undo"}:
        return " If it was changing a host, run `rarms apply` to finish that, or `rarms undo` to take it back."
    return ""
