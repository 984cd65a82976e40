"""Two scripts compared, for a person and for a program."""

from rarms_iac.powershell.difference import Detail, ScriptDifference, StepDifference
from rarms_iac.views.as_json import as_json
from rarms_iac.views.output.scripts import ScriptDetailOutput, ScriptDifferenceOutput, ScriptStepOutput


def difference_text(found: ScriptDifference, old: str, new: str) -> str:
    """By steps, as plans say it: `+` only in the new one, `-` only in the old one, `~` in both and not the same."""
    lines = [f"From {old} to {new}:", ""]
    if found.is_empty:
        return "\n".join([*lines[:1], "  they do the same, step by step.", ""])
    if found.run:
        lines += ["  ~ the run as a whole", *map(_detail, found.run), ""]
    for step in found.steps:
        lines += [f"  {_symbol(step)} {step.address}, {_where(step)}: {step.action}", *map(_detail, step.details), ""]
    counts = [sum(_symbol(step) == symbol for step in found.steps) for symbol in "+~-"]
    lines.append(f"Steps: {counts[0]} only there, {counts[1]} changed, {counts[2]} gone, {found.same} the same.")
    return "\n".join(lines) + "\n"


def difference_json(found: ScriptDifference, old: str, new: str) -> str:
    """The same as values."""
    return as_json(
        ScriptDifferenceOutput(
            old=old,
            new=new,
            run=tuple(map(_detail_output, found.run)),
            steps=tuple(
                ScriptStepOutput(
                    address=step.address,
                    action=step.action,
                    old=None if step.old is None else step.old + 1,
                    new=None if step.new is None else step.new + 1,
                    moved=step.moved,
                    details=tuple(map(_detail_output, step.details)),
                )
                for step in found.steps
            ),
            same=found.same,
        )
    )


def _symbol(difference: StepDifference) -> str:
    return "+" if difference.old is None else "-" if difference.new is None else "~"


def _where(difference: StepDifference) -> str:
    if difference.old is None or difference.new is None:
        number = difference.new if difference.old is None else difference.old
        return f"step {(number or 0) + 1}"
    return (
        f"step {difference.old + 1} is step {difference.new + 1}, moved"
        if difference.moved
        else f"step {difference.new + 1}"
    )


def _detail(detail: Detail) -> str:
    if detail.old is None:
        return f"      {detail.name}  {detail.new}"
    return f"      {detail.name}  {detail.old} -> {'(not there)' if detail.new is None else detail.new}"


def _detail_output(detail: Detail) -> ScriptDetailOutput:
    return ScriptDetailOutput(name=detail.name, old=detail.old, new=detail.new)
