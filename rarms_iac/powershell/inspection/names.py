"""Types, members, operators and variables: each must be on its list, or be the script's own."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.powershell.inspection.lists import words
from rarms_iac.powershell.inspection.script import Script
from rarms_iac.powershell.tree import text_of

if TYPE_CHECKING:
    from tree_sitter import Node

TYPE = Finding(code="RARMS206", severity=Severity.ERROR, summary="A script uses a type that is not allowed")
MEMBER = Finding(code="RARMS207", severity=Severity.ERROR, summary="A script uses a member that is not allowed")
OPERATOR = Finding(code="RARMS208", severity=Severity.ERROR, summary="A script uses an operator that is not allowed")
VARIABLE = Finding(code="RARMS209", severity=Severity.ERROR, summary="A script uses a variable that is not its own")

_LOOKED_AT = words("type_spec member_name variable comparison_operator format_operator assignement_operator")
_BRACKETS = words("{ } ( ) [ ] @( @{ ; : & $_") | {" ", '"'}
_ADVICE = "do without it: the lists hold what rarms' own scripts need"


def check_names(script: Script) -> Iterator[Diagnostic]:
    """Every type, member, operator and variable of the script."""
    own = _own_variables(script)
    for node in script.nodes:
        yield from _check(script, node, own)


def _check(script: Script, node: "Node", own: frozenset[str]) -> Iterator[Diagnostic]:
    text = text_of(node) if node.type in _LOOKED_AT or node.child_count == 0 else ""
    match node.type:
        case "type_spec" if text not in script.lists.types:
            yield script.problem(TYPE, node, f"[{text}] is not on the list", _ADVICE)
        case "member_name" if text not in script.lists.members:
            yield script.problem(MEMBER, node, f".{text} is not on the list", _ADVICE)
        case "variable" if not _is_known(script, node, text, own):
            yield script.problem(VARIABLE, node, f"{text} is neither assigned here nor on the list", _ADVICE)
        case _ if _is_operator(node) and text not in script.lists.operators:
            yield script.problem(OPERATOR, node, f"{text} is not on the list", _ADVICE)


def _is_operator(node: "Node") -> bool:
    """Punctuation and dashed words that are no names, keywords or brackets."""
    if node.type in {"comparison_operator", "format_operator", "assignement_operator"}:
        return True
    if node.is_named or node.type in _BRACKETS or node.child_count:
        return False
    return not node.type.replace("_", "").isalpha()


def _is_known(script: Script, node: "Node", text: str, own: frozenset[str]) -> bool:
    if is_assigned(node):
        return (text in own and not _is_special(text)) or text in script.lists.set_variables
    return text in script.lists.given_variables or text.lower() in own


def _own_variables(script: Script) -> frozenset[str]:
    """What the script assigns, iterates over or takes as a parameter: as written, and in lower case."""
    found = [text_of(node) for node in script.nodes if node.type == "variable" and is_assigned(node)]
    return frozenset([*found, *map(str.lower, found)])


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
