"""A script that changes something is a head of comments, its plan, its module and one call: nothing else."""

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from rarms_iac.model.diagnostics import Diagnostic, Finding, Place
from rarms_iac.model.wording import quoted
from rarms_iac.powershell.templates import (
    ENTRY,
    MEASURING_ENTRY,
    MODULE_BEGIN,
    MODULE_END,
    ScriptForm,
    impact_of,
    module_text,
    template_text,
)
from rarms_iac.powershell.tokens import NotTokens, Token, TokenKind, tokens

RUNTIME = Finding.error("RARMS202", "The fixed part of a script was changed")
HEAD = Finding.error("RARMS219", "The head or the end of a script is not as rarms writes it")

PARAMETERS = "[CmdletBinding("
"""Begins the first line that is no comment."""

NEW_MODULE = "$rarms = New-Module -Name Rarms -ScriptBlock {"
"""The line behind which a script that is one file holds its module."""

_HELP_WORDS = frozenset({".SYNOPSIS", ".DESCRIPTION", ".PARAMETER", ".EXAMPLE", ".NOTES"})
_REQUIRED = ("-Version 5.1", "-RunAsAdministrator")
_OPTIONAL = ("-Modules Hyper-V",)


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedPiece:
    """What gives a script its module: the numbers of its first and last line, counted from 1, and the text with LF."""

    first: int
    last: int
    text: str

    @property
    def form(self) -> ScriptForm:
        """Whether the module lies beside the script, or in it."""
        return ScriptForm.SINGLE if NEW_MODULE in self.text else ScriptForm.MODULE

    def is_shipped(self, entry: str) -> bool:
        """Whether the text is the one that rarms ships, to the byte."""
        return self.text == module_text(ScriptForm.SINGLE if entry == MEASURING_ENTRY else self.form, entry)


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptParts:
    """The parts of a script, with LF."""

    head: str  # help and requirements
    plan: str  # parameters, settings, and the block that holds the plan
    fixed: FixedPiece | None  # None where it is missing
    end: str  # what calls the plan


def split_script(text: str) -> ScriptParts:
    """The parts of a script; where the first or last line of its module's piece is missing, it has none and no end."""
    lines = text.replace("\r\n", "\n").split("\n")
    body = _first_line(lines, PARAMETERS)
    begin = _first_line(lines, MODULE_BEGIN)
    last = next((at for at in range(begin, len(lines)) if lines[at].startswith(MODULE_END)), None)
    fixed = None
    if last is not None:
        fixed = FixedPiece(first=begin + 1, last=last + 1, text="\n".join(lines[begin : last + 1]))
    head, plan = lines[: min(body, begin)], lines[min(body, begin) : begin if fixed else len(lines)]
    end = lines[fixed.last if fixed else len(lines) :]
    return ScriptParts(head="\n".join([*head, ""]), plan="\n".join([*plan, ""]), fixed=fixed, end="\n".join(end))


def _first_line(lines: list[str], start: str) -> int:
    return next((at for at, line in enumerate(lines) if line.startswith(start)), len(lines))


def without_fixed(text: str, entry: str = ENTRY) -> str:
    """The script with empty lines where its module's piece is, if it is the shipped one; otherwise the script itself.

    What is left may be parsed alone, and every line keeps its number. A head is comments, the plan ends with the brace
    of its block, the shipped piece is whole statements between remarks, and behind it stands the template's end
    (`check_parts`); so no token and no statement reaches over an edge, and the tree of the whole is the trees of its
    pieces, one after another.
    """
    parts = split_script(text)
    if parts.fixed is None or not parts.fixed.is_shipped(entry) or head_problems(parts.head):
        return text
    blank = "\n" * (parts.fixed.last - parts.fixed.first + 1)
    return (parts.head + parts.plan + blank + parts.end).replace("\n", "\r\n" if "\r\n" in text else "\n")


def check_parts(name: str, parts: ScriptParts, entry: str) -> Iterator[Diagnostic]:
    """Find where head, module and end of a script are not as rarms writes them.

    Args:
        name: the script's, for the findings.
        parts: of the script.
        entry: the function that its end calls.

    Yields:
        A finding where the module's piece was changed, then one for each other difference.
    """
    top = Place(file=name, line=1, column=1)
    fixed = parts.fixed
    if fixed is None:
        yield RUNTIME.at(top, "it has no module", "render the script again", script=name)
    elif not fixed.is_shipped(entry):
        shipped = part_digest(module_text(fixed.form, entry))
        yield RUNTIME.at(
            Place(file=name, line=fixed.first, column=1),
            "its module's lines have the SHA-256 {_shown}, not {_shown_}",
            "render the script again; only its steps may differ from another's",
            script=name,
            sha256=part_digest(fixed.text),
            shipped_sha256=shipped,
            _shown=part_digest(fixed.text)[:12],
            _shown_=shipped[:12],
        )
    problems = [*head_problems(parts.head), *comment_problems(parts.plan + parts.end)]
    opening, between, closing = _template_edges(entry, parts.plan)
    if not parts.plan.startswith(opening):
        problems.append("before the plan stands something else than its parameters and settings")
    if fixed is not None and not (parts.plan.endswith(between) and parts.end == closing):
        problems.append("what stands around the module's lines is not what calls the plan")
    for problem in problems:
        yield HEAD.at(top, problem, "render the script again", values={"script": name, "reason": problem})


def comment_problems(text: str) -> tuple[str, ...]:
    """Find comments behind the head that PowerShell may heed."""
    try:
        return tuple(_directive_problems(tokens(text)))
    except NotTokens:
        return ()  # its parts are not as rarms writes them, which is told instead


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
    """Find what is wrong before the parameters."""
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
    """Return the template's text before the run's facts, between plan and module, and behind the module."""
    try:
        impact = impact_of(plan_text)
    except NotTokens:
        impact = ""  # then the opening is not as rarms writes it, which is told
    text = template_text("script.ps1.j2").replace("{{ impact }}", impact)
    opening = text[text.index(PARAMETERS) :].partition("{% for line in facts")[0]
    plan, _, closing = text.partition("{{ module }}\n")
    between = plan.rpartition("{{ line }}\n{% endfor %}\n")[2]
    return opening, between, closing.replace("{{ entry }}", entry)
