"""Scripts for a reader: one with line numbers, or two compared by their steps; `difference_json` is for programs."""

from typing import TYPE_CHECKING

from rarms_iac.powershell.difference import Detail, ScriptDifference, StepDifference
from rarms_iac.powershell.inspection.layout import part_digest, split_script
from rarms_iac.powershell.tokens import NotTokens, Token, TokenKind, tokens
from rarms_iac.views.as_json import as_json
from rarms_iac.views.console import BAD, CHANGED, GOOD, STRONG, paragraph, stack, styled
from rarms_iac.views.output.plan import ScriptDetailOutput, ScriptDifferenceOutput, ScriptStepOutput

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.text import Text

SYMBOLS = {"+": GOOD, "~": CHANGED, "-": BAD}


def script_text(script: str, *, whole: bool = False) -> "RenderableType":
    """Show the script with the numbers of its lines, as they are in the file.

    Args:
        script: its text.
        whole: show its fixed parts, too; otherwise a line stands for each.
    """
    plain = script.replace("\r\n", "\n").removesuffix("\n")
    lines = _highlighted(plain).split("\n", allow_blank=True)
    width = len(str(len(lines)))
    numbered = [styled(f"{number:>{width}}  ", line) for number, line in enumerate(lines, start=1)]
    for piece in () if whole else reversed(split_script(plain + "\n").fixed):
        fixed = f"{piece.title}, fixed (SHA-256 {part_digest(piece.text)[:12]}); --whole shows it"
        line = styled(f"{'':>{width}}  ... lines {piece.first} to {piece.last}: {fixed}")
        numbered[piece.first - 1 : piece.last] = [line]
    for line in numbered:
        line.no_wrap, line.overflow = True, "ignore"
    return stack(*numbered)


def _highlighted(text: str) -> "Text":
    try:
        parts = tokens(text)
    except NotTokens:
        return styled(text)  # it is shown as it is; the inspection says what is wrong with it
    pieces: list[str | tuple[str, str]] = []
    at = 0
    for before, token in zip((None, *parts), parts, strict=False):
        piece = text[token.offset : token.end]
        pieces += [text[at : token.offset], (piece, _style(before, token, piece))]
        at = token.end
    return styled(*pieces, text[at:])


def _style(before: Token | None, token: Token, piece: str) -> str:
    match token.kind:
        case TokenKind.COMMENT:
            return "green"
        case TokenKind.STRING | TokenKind.EXPANDABLE:
            return "yellow"
        case TokenKind.WORD if piece.startswith("$"):
            return "cyan"
        case TokenKind.WORD if piece.startswith("-") and piece[1:2].isalpha():
            return "dim"
        case TokenKind.WORD if _begins_call(before) and "-" in piece:
            return "bold"
        case _:
            return ""


def _begins_call(before: Token | None) -> bool:
    """Whether a word after this token is a call."""
    return before is None or before.kind is TokenKind.NEWLINE or before.text in {"{", "(", "|", ";", "="}


def difference_text(difference: ScriptDifference, old: str, new: str) -> "RenderableType":
    """Show the steps that differ: `+` only in the new script, `-` only in the old one, `~` in both and not the same."""
    head = paragraph(f"From {old} to {new}:")
    if difference.is_empty:
        return stack(head, "  they do the same, step by step.")
    parts = [head]
    if difference.run:
        parts += [_line("~", "the run as a whole"), *map(_detail, difference.run)]
    for step in difference.steps:
        text = f"{step.address}, {_describe_position(step)}: {step.action}"
        parts += [_line(_symbol(step), text), *map(_detail, step.details)]
    counts = [sum(_symbol(step) == symbol for step in difference.steps) for symbol in "+~-"]
    total = f"Steps: {counts[0]} only there, {counts[1]} changed, {counts[2]} gone, {difference.same} the same."
    return stack(*parts, "", paragraph(styled((total, STRONG))))


def _line(symbol: str, text: str) -> "RenderableType":
    return paragraph(text, start=styled("  ", (symbol, SYMBOLS[symbol]), " "))


def difference_json(difference: ScriptDifference, old: str, new: str) -> str:
    """The same as values."""
    return as_json(
        ScriptDifferenceOutput(
            old=old,
            new=new,
            run=tuple(map(_detail_output, difference.run)),
            steps=tuple(
                ScriptStepOutput(
                    address=step.address,
                    action=step.action,
                    old=None if step.old is None else step.old + 1,
                    new=None if step.new is None else step.new + 1,
                    moved=step.moved,
                    details=tuple(map(_detail_output, step.details)),
                )
                for step in difference.steps
            ),
            same=difference.same,
        )
    )


def _symbol(step: StepDifference) -> str:
    return "+" if step.old is None else "-" if step.new is None else "~"


def _describe_position(difference: StepDifference) -> str:
    if difference.old is None or difference.new is None:
        number = difference.new if difference.old is None else difference.old
        return f"step {(number or 0) + 1}"
    return (
        f"step {difference.old + 1} is step {difference.new + 1}, moved"
        if difference.moved
        else f"step {difference.new + 1}"
    )


def _detail(detail: Detail) -> "RenderableType":
    after = "(not there)" if detail.new is None else detail.new
    values = after if detail.old is None else f"{detail.old} -> {after}"
    return paragraph(f"{detail.name}  {values}", indent=6, more=2)


def _detail_output(detail: Detail) -> ScriptDetailOutput:
    return ScriptDetailOutput(name=detail.name, old=detail.old, new=detail.new)
