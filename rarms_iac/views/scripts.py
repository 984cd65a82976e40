"""Scripts for a reader: one with line numbers, or two compared."""

from collections.abc import Iterator, Sequence
from io import StringIO
from typing import TYPE_CHECKING

from rarms_iac.app.scripts import PlanScript
from rarms_iac.model.commands import APPLY, Wording, prose
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.plan import Plan
from rarms_iac.powershell.comparison import Detail, ScriptDifference, StepDifference, TextDifference
from rarms_iac.powershell.templates import ENTRY, MEASURING_ENTRY, ScriptForm, module_text
from rarms_iac.texts.messages import natural_order
from rarms_iac.views.console import BAD, CHANGED, GOOD, STRONG, paragraph, stack, styled

if TYPE_CHECKING:
    from rich.console import RenderableType

SYMBOLS = {"+": GOOD, "~": CHANGED, "-": BAD}


def script_text(script: str, *, colour: bool = False, whole: bool = False) -> str:
    """Return the script with the numbers of its lines, as they are in the file; it ends with a line end.

    Its lines are printable ASCII and are never wrapped.

    Args:
        colour: with escape sequences; without, the same text in the same lines.
        whole: show its module, too, where the script holds it; otherwise a line stands for it.
    """
    plain = script.replace("\r\n", "\n").removesuffix("\n")
    lines = (_highlighted(plain) if colour else plain).split("\n")
    width = len(str(len(lines)))
    numbered = [f"{number:>{width}}  {line}".rstrip() for number, line in enumerate(lines, start=1)]
    for entry in () if whole else (ENTRY, MEASURING_ENTRY):
        before, module, _ = plain.partition(module_text(ScriptForm.SINGLE, entry))
        if module:
            first, last = before.count("\n"), (before + module).count("\n") + 1
            told = f"... lines {first + 1} to {last}: the module of rarms, shown only in a pipe"
            numbered[first:last] = [f"{'':>{width}}  {told}"]
    return "\n".join(numbered) + "\n"


def _highlighted(text: str) -> str:
    """Return the text with escape sequences, which end on each line."""
    from rich.console import Console
    from rich.syntax import Syntax

    file = StringIO()
    console = Console(file=file, force_terminal=True, color_system="standard", legacy_windows=False)
    console.print(Syntax("", "powershell", theme="ansi_dark").highlight(text), soft_wrap=True, end="")
    return file.getvalue().removesuffix("\n")


def left_out(plan: Plan, scripts: Sequence[PlanScript], selected: Sequence[PlanScript]) -> Iterator[Wording]:
    """Yield a remark on the scripts of a plan that are not shown."""
    others = {script.guest for script in scripts if script.guest} - {script.guest for script in selected}
    guests = sorted(others, key=natural_order)
    linux = [part.host.name for part in plan.hosts if part.facts.provider is ProviderKind.LINUX and part.steps]
    if linux:
        yield prose(f"Linux hosts do not have scripts ({', '.join(linux)}): ", APPLY, " runs the steps directly.")
    elif not selected:
        yield "The plan does not change the hosts themselves."
    if guests:
        yield f"Guests have their own scripts: {', '.join(guests)} (--guest NAME)."


def difference_text(difference: ScriptDifference | TextDifference) -> "RenderableType":
    """Show what differs: `+` only in the new script, `-` only in the old one, `~` in both and not the same."""
    head = paragraph(f"From {difference.old} to {difference.new}:")
    if isinstance(difference, TextDifference):
        changed = [paragraph(line) for line in difference.lines[2:]]
        return stack(head, *(changed or ["  all lines are equal."]))
    if not difference.steps:
        return stack(head, "  all steps are equal.")
    parts = [head]
    for step in difference.steps:
        text = f"{step.address}, {_describe_position(step)}: {step.action}"
        parts += [_line(_symbol(step), text), *map(_detail, step.details)]
    counts = [sum(_symbol(step) == symbol for step in difference.steps) for symbol in "+~-"]
    total = f"Steps: {counts[0]} new, {counts[1]} changed, {counts[2]} gone, {difference.same} the same."
    return stack(*parts, "", paragraph(styled((total, STRONG))))


def _line(symbol: str, text: str) -> "RenderableType":
    return paragraph(text, start=styled("  ", (symbol, SYMBOLS[symbol]), " "))


def _symbol(step: StepDifference) -> str:
    return "+" if step.old is None else "-" if step.new is None else "~"


def _describe_position(difference: StepDifference) -> str:
    if difference.old is None or difference.new is None:
        number = difference.new if difference.old is None else difference.old
        return f"step {number}"
    return f"step {difference.old} is step {difference.new}, moved" if difference.moved else f"step {difference.new}"


def _detail(detail: Detail) -> "RenderableType":
    after = "(not there)" if detail.new is None else detail.new
    values = after if detail.old is None else f"{detail.old} -> {after}"
    return paragraph(f"{detail.name}  {values}", indent=6, more=2)
