"""Which parts of the language scripts may use: a short list, so that the rest needs no thought."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rarms_iac.model.diagnostics import Diagnostic, Finding, Place
from rarms_iac.powershell.inspection.allowed import ScriptKind, words
from rarms_iac.powershell.inspection.script import Script
from rarms_iac.powershell.tokens import TokenKind, tokens
from rarms_iac.powershell.tree import text_of

if TYPE_CHECKING:
    from tree_sitter import Node


CONSTRUCT = Finding.error("RARMS203", "A script uses a construct that is not allowed")
_CONSTRUCT_ADVICE = "write it with assignments, calls of named cmdlets, tables and single-quoted text"


def check_constructs(script: Script) -> Iterator[Diagnostic]:
    """Refuses redirections, double-quoted text, splatting, dot-sourcing, backticks and whatever is not on the list."""
    yield from _check_backticks(script)
    for node in script.nodes:
        if node.is_named and node.type not in script.lists.constructs:
            yield script.problem(CONSTRUCT, node, f"a {node.type.replace('_', ' ')}: {_short(node)}", _CONSTRUCT_ADVICE)
        elif message := _misuse(script, node):
            yield script.problem(CONSTRUCT, node, message, _CONSTRUCT_ADVICE)


def _check_backticks(script: Script) -> Iterator[Diagnostic]:
    """Outside of texts and remarks a backtick joins lines or hides a name."""
    if "`" not in script.text:
        return
    skipped = (TokenKind.STRING, TokenKind.COMMENT)
    inside = {at for token in tokens(script.text) if token.kind in skipped for at in range(token.offset, token.end)}
    for at, character in enumerate(script.text):
        if character == "`" and at not in inside:
            line = script.text.count("\n", 0, at) + 1
            place = Place(file=script.name, line=line, column=at - script.text.rfind("\n", 0, at))
            yield CONSTRUCT.at(place, "a backtick joins lines or hides what is written", _CONSTRUCT_ADVICE)


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


TYPE = Finding.error("RARMS206", "A script uses a type that is not allowed")
MEMBER = Finding.error("RARMS207", "A script uses a member that is not allowed")
OPERATOR = Finding.error("RARMS208", "A script uses an operator that is not allowed")
VARIABLE = Finding.error("RARMS209", "A script uses a variable that is not its own")

_LOOKED_AT = words("type_spec member_name variable comparison_operator format_operator assignement_operator")
_BRACKETS = words("{ } ( ) [ ] @( @{ ; : & $_") | {" ", '"'}
_NAME_ADVICE = "do without it: the lists hold what rarms' own scripts need"


def check_names(script: Script) -> Iterator[Diagnostic]:
    """Every type, member, operator and variable of the script."""
    own = _own_variables(script)
    for node in script.nodes:
        yield from _check(script, node, own)


def _check(script: Script, node: "Node", own: frozenset[str]) -> Iterator[Diagnostic]:
    text = text_of(node) if node.type in _LOOKED_AT or node.child_count == 0 else ""
    match node.type:
        case "type_spec" if text not in script.lists.types:
            yield script.problem(TYPE, node, f"[{text}] is not on the list", _NAME_ADVICE)
        case "member_name" if text not in script.lists.members:
            yield script.problem(MEMBER, node, f".{text} is not on the list", _NAME_ADVICE)
        case "variable" if not _is_known(script, node, text, own):
            yield script.problem(VARIABLE, node, f"{text} is neither assigned here nor on the list", _NAME_ADVICE)
        case _ if _is_operator(node) and text not in script.lists.operators:
            yield script.problem(OPERATOR, node, f"{text} is not on the list", _NAME_ADVICE)


def _is_operator(node: "Node") -> bool:
    """Punctuation and dashed words that are no names, keywords or brackets."""
    if node.type in {"comparison_operator", "format_operator", "assignement_operator"}:
        return True
    if node.is_named or node.type in _BRACKETS or node.child_count:
        return False
    return not node.type.replace("_", "").isalpha()


def _is_known(script: Script, node: "Node", text: str, own: frozenset[str]) -> bool:
    if is_assigned(node):
        return (text in own and not _is_special(text)) or _is_pin(script, node)
    return text in script.lists.given_variables or text.lower() in own


def _is_pin(script: Script, node: "Node") -> bool:
    """Whether a variable of PowerShell's own gets the one value that it may have, in a read-only script once."""
    assignment: Node | None = node
    while assignment is not None and assignment.type != "assignment_expression":
        assignment = assignment.parent
    pin = text_of(assignment) if assignment else ""
    return pin in script.lists.pins and (script.kind is not ScriptKind.OBSERVE or script.text.count(pin) == 1)


def _own_variables(script: Script) -> frozenset[str]:
    """The variables that the script assigns, iterates over or takes as a parameter: as written, and in lower case."""
    assigned = [text_of(node) for node in script.nodes if node.type == "variable" and is_assigned(node)]
    return frozenset([*assigned, *map(str.lower, assigned)])


def is_assigned(node: "Node") -> bool:
    """Whether a variable gets its value there: in an assignment, as a parameter, or in a loop's head."""
    parent = node.parent
    if parent is None:
        return False
    if parent.type == "script_parameter":
        return True
    if parent.type == "foreach_statement":
        return parent.children[[child.type for child in parent.children].index("(") + 1].id == node.id
    while parent is not None and parent.child_count == 1 and parent.type != "left_assignment_expression":
        parent = parent.parent
    if parent is not None and parent.type in {"cast_expression", "expression_with_unary_operator"}:  # [byte[]] $data =
        while parent is not None and parent.type != "left_assignment_expression" and _is_last(parent):
            parent = parent.parent
    return parent is not None and parent.type == "left_assignment_expression"


def _is_last(node: "Node") -> bool:
    return node.parent is not None and node.parent.children[-1].id == node.id


_SPECIAL = words("""
    $_ $args $consolefilename $error $event $executioncontext $false $foreach $home $host $input $iscoreclr $islinux
    $ismacos $iswindows $lastexitcode $matches $myinvocation $nestedpromptlevel $null $pid $profile
    $psboundparameters $pscmdlet $pscommandpath $psculture $psdefaultparametervalues $psedition $pshome $psitem
    $psscriptroot $pssenderinfo $psuiculture $psversiontable $pwd $sender $shellid $stacktrace $switch $this $true
    """)


def _is_special(text: str) -> bool:
    """A variable that PowerShell itself keeps or heeds, or one of another scope or drive."""
    low = text.lower()
    scoped = ":" in low and not low.startswith("$script:")
    return low in _SPECIAL or low.endswith("preference") or low.startswith("${") or scoped
