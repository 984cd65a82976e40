"""Which parts of the language scripts may use: a short list, so that the rest needs no thought."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rarms_iac.model.diagnostics import Diagnostic, Finding, Place, Severity
from rarms_iac.powershell.inspection.script import Script
from rarms_iac.powershell.tokens import TokenKind, tokens
from rarms_iac.powershell.tree import text_of

if TYPE_CHECKING:
    from tree_sitter import Node

CONSTRUCT = Finding(code="RARMS203", severity=Severity.ERROR, summary="A script uses a construct that is not allowed")
_ADVICE = "write it with assignments, calls of named cmdlets, tables and single-quoted text"


def check_constructs(script: Script) -> Iterator[Diagnostic]:
    """Refuses redirections, double-quoted text, splatting, dot-sourcing, backticks and whatever is not on the list."""
    yield from _check_backticks(script)
    for node in script.nodes:
        if node.is_named and node.type not in script.lists.constructs:
            yield script.problem(CONSTRUCT, node, f"a {node.type.replace('_', ' ')}: {_short(node)}", _ADVICE)
        elif says := _misuse(script, node):
            yield script.problem(CONSTRUCT, node, says, _ADVICE)


def _check_backticks(script: Script) -> Iterator[Diagnostic]:
    """Outside of texts and remarks a backtick joins lines or hides a name."""
    skipped = (TokenKind.STRING, TokenKind.COMMENT)
    inside = {at for token in tokens(script.text) if token.kind in skipped for at in range(token.offset, token.end)}
    for at, character in enumerate(script.text):
        if character == "`" and at not in inside:
            line = script.text.count("\n", 0, at) + 1
            place = Place(file=script.name, line=line, column=at - script.text.rfind("\n", 0, at))
            yield CONSTRUCT.at(place, "a backtick joins lines or hides what is written", _ADVICE)


def _misuse(script: Script, node: "Node") -> str:
    text = text_of(node)
    match node.type:
        case "command_invokation_operator" if text != "&":
            return f"{text} runs a file or a block in this scope"
        case "command_name_expr" if text not in script.lists.blocks:
            return f"& runs {_short(node)}, which is not named"
        case "variable" if text.startswith("@"):
            return f"{text} hides which parameters are given"
        case "member_name" if [child.type for child in node.children] != ["simple_name"]:
            return f"the member {_short(node)} is named by a value"
        case _:
            return ""


def _short(node: "Node") -> str:
    text = " ".join(text_of(node).split())
    return text if len(text) <= 60 else f"{text[:57]}..."
