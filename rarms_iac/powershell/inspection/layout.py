"""A script that changes something is a head of comments, its plan, fixed parts and one call: nothing else."""

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from rarms_iac.model.diagnostics import Diagnostic, Finding, Place
from rarms_iac.model.wording import quoted
from rarms_iac.powershell.templates import (
    PARTS,
    RUNTIME_BEGIN,
    RUNTIME_END,
    impact_of,
    part_begin,
    part_end,
    part_text,
    parts_for,
    read,
    runtime,
)
from rarms_iac.powershell.tokens import NotTokens, Token, TokenKind, tokens

RUNTIME = Finding.error("RARMS202", "The fixed part of a script was changed")
HEAD = Finding.error("RARMS219", "The head or the end of a script is not as rarms writes it")

PARAMETERS = "[CmdletBinding("
"""Begins the first line that is no comment."""

_HELP_WORDS = frozenset({".SYNOPSIS", ".DESCRIPTION", ".PARAMETER", ".EXAMPLE", ".NOTES"})
_REQUIRED = ("-Version 5.1", "-RunAsAdministrator")
_OPTIONAL = ("-Modules Hyper-V",)


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedPiece:
    """A part that lies between two dashed lines: the numbers of these lines, counted from 1, and the text with LF."""

    name: str  # empty: the runtime
    first: int
    last: int
    text: str

    @property
    def title(self) -> str:
        """The piece's name for people."""
        return f"the part {self.name}" if self.name else "the runtime"

    @property
    def is_shipped(self) -> bool:
        """Whether the text is the one that rarms ships, to the byte."""
        return part_digest(self.text) == part_digest(self.shipped)

    @property
    def shipped(self) -> str:
        """The text that rarms ships under this name."""
        return part_text(self.name) if self.name else runtime()


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptParts:
    """The parts of a script, with LF."""

    head: str  # help and requirements
    plan: str  # parameters, and the one function that holds the plan
    fixed: tuple[FixedPiece, ...]  # the runtime comes first; empty where it is missing
    end: str  # what calls the plan

    @property
    def is_shipped(self) -> bool:
        """Whether there is a runtime, and every fixed part is the one that rarms ships, to the byte."""
        return bool(self.fixed) and all(piece.is_shipped for piece in self.fixed)


def split_script(text: str) -> ScriptParts:
    """The parts of a script; where the runtime's first or last line is missing, it has no fixed ones and no end."""
    lines = text.replace("\r\n", "\n").split("\n")
    body = _first_line(lines, PARAMETERS)
    begin = _first_line(lines, RUNTIME_BEGIN)
    fixed = []
    piece = _piece(lines, begin, "", RUNTIME_END)
    while piece:
        fixed.append(piece)
        piece = _next_part(lines, piece.last)
    end = fixed[-1].last if fixed else len(lines)
    head, plan = lines[: min(body, begin)], lines[min(body, begin) : fixed[0].first - 1 if fixed else len(lines)]
    return ScriptParts(
        head="\n".join([*head, ""]), plan="\n".join([*plan, ""]), fixed=tuple(fixed), end="\n".join(lines[end:])
    )


def _first_line(lines: list[str], start: str) -> int:
    return next((at for at, line in enumerate(lines) if line.startswith(start)), len(lines))


def without_fixed(text: str) -> str:
    """The script with empty lines where its fixed parts are, if they are the shipped ones; otherwise the script itself.

    What is left may be parsed alone, and every line keeps its number. A head is comments, the plan ends with the brace
    of its function, a shipped part is whole statements that end with a function, too, and behind the last one stands
    the template's end (`check_layout`); so no token and no statement reaches over an edge, and the tree of the whole is
    the trees of its pieces, one after another.
    """
    parts = split_script(text)
    if not parts.is_shipped or head_problems(parts.head):
        return text
    blank = "\n" * sum(piece.last - piece.first + 1 for piece in parts.fixed)
    return (parts.head + parts.plan + blank + parts.end).replace("\n", "\r\n" if "\r\n" in text else "\n")


def _piece(lines: list[str], first: int, name: str, end: str) -> FixedPiece | None:
    last = next((at for at in range(first, len(lines)) if lines[at].startswith(end)), None)
    if last is None:
        return None
    return FixedPiece(name=name, first=first + 1, last=last + 1, text="\n".join(lines[first : last + 1]))


def _next_part(lines: list[str], at: int) -> FixedPiece | None:
    line = lines[at] if at < len(lines) else ""
    name = next((name for name in PARTS if line.startswith(part_begin(name))), None)
    return None if name is None else _piece(lines, at, name, part_end(name))


def check_layout(name: str, parts: ScriptParts, entry: str) -> Iterator[Diagnostic]:
    """Find where head, fixed parts and end of a script are not as rarms writes them.

    Args:
        name: the script's, for the findings.
        parts: of the script.
        entry: the function that its last line calls.

    Yields:
        A finding for each fixed part that was changed, then one for each other difference.
    """
    top = Place(file=name, line=1, column=1)
    if not parts.fixed:
        yield RUNTIME.at(top, "it has no runtime", "render the script again", values={"script": name})
    for piece in parts.fixed:
        if not piece.is_shipped:
            detail = (
                f"{piece.title} has the SHA-256 {part_digest(piece.text)[:12]}, not {part_digest(piece.shipped)[:12]}"
            )
            place = Place(file=name, line=piece.first, column=1)
            yield RUNTIME.at(
                place,
                detail,
                "render the script again; only its steps may differ from another's",
                values={
                    "script": name,
                    "part": piece.title,
                    "sha256": part_digest(piece.text),
                    "shipped_sha256": part_digest(piece.shipped),
                },
            )
    problems = [*head_problems(parts.head), *_carried_problems(parts), *comment_problems(parts.plan + parts.end)]
    opening, between, closing = _template_edges(entry, parts.plan)
    if not parts.plan.startswith(opening):
        problems.append("before the plan stands something else than its parameters and settings")
    if parts.fixed and not (parts.plan.endswith(between) and parts.end == closing):
        problems.append("what stands around the fixed parts is not what calls the plan")
    for problem in problems:
        yield HEAD.at(top, problem, "render the script again", values={"script": name, "reason": problem})


def _carried_problems(parts: ScriptParts) -> Iterator[str]:
    """Each part that the steps need, once and in order, and no other."""
    try:
        needed = parts_for(parts.plan + parts.end)
    except NotTokens:
        return  # `sound` reports it
    carried = tuple(piece.name for piece in parts.fixed if piece.name)
    if parts.fixed and carried != needed:
        yield f"it carries the parts {', '.join(carried) or 'none'}; its plan needs {', '.join(needed) or 'none'}"


def comment_problems(text: str) -> tuple[str, ...]:
    """Find comments behind the head that PowerShell may heed."""
    try:
        return tuple(_directive_problems(tokens(text)))
    except NotTokens:
        return ()  # `sound` reports it


def _directive_problems(read_tokens: Iterable[Token]) -> Iterator[str]:
    """Comments that are more to PowerShell: `#Requires` counts at any place, and imports what it names."""
    for token in read_tokens:
        low = token.text.lower()
        if token.kind is TokenKind.COMMENT and (low.startswith(("<#", "# sig #")) or _is_requires(token)):
            yield f"PowerShell may heed the comment {quoted(token.text, 40)}"


def _is_requires(token: Token) -> bool:
    return token.kind is TokenKind.COMMENT and token.text.lower().startswith("#requires")


def part_digest(text: str) -> str:
    """SHA-256 of a part's text."""
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def head_problems(head: str) -> tuple[str, ...]:
    """Find what is wrong before the runtime."""
    try:
        read_tokens = tokens(head)
    except NotTokens:
        return ("a text in it does not end",)
    return tuple(_head_problems(read_tokens))


def _head_problems(read_tokens: tuple[Token, ...]) -> Iterator[str]:
    comments = [token for token in read_tokens if token.kind is not TokenKind.NEWLINE]
    if any(token.kind is not TokenKind.COMMENT for token in comments):
        yield "there is more than comments before the parameters"
    if not comments or not comments[0].text.startswith("<#\n.SYNOPSIS\n"):
        yield "it does not begin with its help"
    else:
        yield from _help_problems(comments[0].text)
    asked = [token.text[len("#requires ") :] for token in comments if _is_requires(token)]
    yield from _directive_problems(token for token in comments[1:] if not _is_requires(token))
    if not set(_REQUIRED) <= set(asked) <= {*_REQUIRED, *_OPTIONAL}:
        yield f"it asks for {', '.join(asked) or 'nothing'}"


def _help_problems(text: str) -> Iterator[str]:
    """Words of the help that PowerShell heeds, in any case: `.ForwardHelpTargetName` shows another command's help."""
    for line in text.split("\n"):
        word = (line.split() or [""])[0]
        if word.startswith(".") and word[1:].isalpha() and (word not in _HELP_WORDS or line[0] != "."):
            yield f"its help says {quoted(line, 40)}"


def _template_edges(entry: str, plan_text: str) -> tuple[str, str, str]:
    """Return the template's text before the run's facts, between plan and fixed parts, and behind the fixed parts."""
    try:
        impact = impact_of(plan_text)
    except NotTokens:
        impact = ""  # `sound` reports it
    text = read("script.ps1.j2").replace("{{ impact }}", impact)
    opening = text[text.index(PARAMETERS) :].partition("{{")[0]
    plan, _, closing = text.partition("{{ text }}\n{% endfor %}\n")
    between = plan.rpartition("{{ line }}\n{% endfor %}\n")[2].partition("{%")[0]
    return opening, between, closing.replace("{{ entry }}", entry)
