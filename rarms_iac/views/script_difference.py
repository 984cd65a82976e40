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
    for one in found.steps:
        lines += [f"  {_symbol(one)} {one.address}, {_where(one)}: {one.action}", *map(_detail, one.details), ""]
    counts = [sum(_symbol(one) == symbol for one in found.steps) for symbol in "+~-"]
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
                    address=one.address,
                    action=one.action,
                    old=None if one.old is None else one.old + 1,
                    new=None if one.new is None else one.new + 1,
                    moved=one.moved,
                    details=tuple(map(_detail_output, one.details)),
                )
                for one in found.steps
            ),
            same=found.same,
        )
    )


def _symbol(one: StepDifference) -> str:
    return "+" if one.old is None else "-" if one.new is None else "~"


def _where(one: StepDifference) -> str:
    if one.old is None or one.new is None:
        number = one.new if one.old is None else one.old
        return f"step {(number or 0) + 1}"
    return f"step {one.old + 1} is step {one.new + 1}, moved" if one.moved else f"step {one.new + 1}"


def _detail(one: Detail) -> str:
    if one.old is None:
        return f"      {one.name}  {one.new}"
    return f"      {one.name}  {one.old} -> {'(not there)' if one.new is None else one.new}"


def _detail_output(one: Detail) -> ScriptDetailOutput:
    return ScriptDetailOutput(name=one.name, old=one.old, new=one.new)
