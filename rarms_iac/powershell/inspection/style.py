"""Our own linter: the forms behind PSScriptAnalyzer's default rules."""

from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING

from rarms_iac.model.diagnostics import Diagnostic, Finding
from rarms_iac.powershell import cmdlets
from rarms_iac.powershell.inspection.allowed import words
from rarms_iac.powershell.inspection.language import is_assigned
from rarms_iac.powershell.inspection.script import Script
from rarms_iac.powershell.tree import text_of, walk

if TYPE_CHECKING:
    from tree_sitter import Node

NAME = Finding.warning("RARMS212", "A function is not named as PowerShell's own are")
PROCESS = Finding.warning("RARMS214", "A changing function does not ask before it acts")
UNUSED = Finding.warning("RARMS215", "A variable is assigned and never read")
EMPTY = Finding.warning("RARMS216", "An error is caught and forgotten")
NULL = Finding.warning("RARMS217", "$null stands on the right of a comparison")

_CHANGING_VERBS = words("New Set Remove Start Stop Restart Reset Update")
_VERBS = _CHANGING_VERBS | words("""
    Add Clear Close Copy Enter Exit Find Format Get Hide Join Lock Move Open Optimize Pop Push Redo Rename Resize
    Search Select Show Skip Split Step Switch Undo Unlock Watch Connect Disconnect Read Receive Send Write Backup
    Checkpoint Compare Compress Convert ConvertFrom ConvertTo Dismount Edit Expand Export Group Import Initialize Limit
    Merge Mount Out Publish Restore Save Sync Unpublish Debug Measure Ping Repair Resolve Test Trace Approve Assert
    Build Complete Confirm Deny Deploy Disable Enable Install Invoke Register Request Submit Suspend Uninstall
    Unregister Wait Block Grant Protect Revoke Unblock Unprotect Use
    """)
_SINGULAR = ("ss", "us", "is", "Data", "Windows")


def check_style(script: Script) -> Iterator[Diagnostic]:
    """Names of functions, ShouldProcess, unused variables, empty catches, `$null` on the left."""
    for function in script.functions.values():
        yield from _check_function(script, function.name, function.node)
    for node in script.nodes:
        if node.type == "catch_clause" and not _does_something(node):
            yield script.problem(EMPTY, node, "the catch block is empty", "say what happened, or let it through")
        if node.type == "comparison_expression" and _null_on_the_right(node):
            yield script.problem(NULL, node, "compared with a list, it filters instead", "write $null first")
    yield from _check_unused(script)


def _check_function(script: Script, name: str, node: "Node") -> Iterator[Diagnostic]:
    verb, _, noun = name.partition("-")
    if verb not in _VERBS or not noun:
        yield script.problem(NAME, node, f"{name} does not begin with an approved verb", "see Get-Verb")
    if noun.endswith("s") and not noun.endswith(_SINGULAR):
        yield script.problem(NAME, node, f"{noun} is no singular", "name one thing")
    if cmdlets.cmdlet(name):
        yield script.problem(NAME, node, f"{name} is a cmdlet already", "give it a name of its own")
    if verb in _CHANGING_VERBS and "SupportsShouldProcess" not in text_of(node):
        yield script.problem(PROCESS, node, f"{name} has no SupportsShouldProcess", "declare it and ask, or rename it")


def _does_something(catch: "Node") -> bool:
    return any(node.type == "statement_list" for node in walk(catch))


def _null_on_the_right(comparison: "Node") -> bool:
    parts = comparison.children
    return len(parts) == 3 and text_of(parts[2]).lower() == "$null" and text_of(parts[0]).lower() != "$null"


def _check_unused(script: Script) -> Iterator[Diagnostic]:
    """By function; what is assigned outside of all functions may be read in any of them."""
    bodies = [[*walk(function.node)] for function in script.functions.values()]
    inside = {node.id for body in bodies for node in body}
    everywhere = [node for node in script.nodes if node.type == "variable"]
    # The script's own parameters are read by what is fixed, which need not be part of this tree.
    outside = [node for node in everywhere if node.id not in inside and not _is_parameter(node)]
    yield from _unused_among(script, outside, everywhere)
    for body in bodies:
        variables = [node for node in body if node.type == "variable"]
        yield from _unused_among(script, variables, variables)


def _is_parameter(node: "Node") -> bool:
    return node.parent is not None and node.parent.type == "script_parameter"


def _unused_among(script: Script, variables: list["Node"], readers: list["Node"]) -> Iterator[Diagnostic]:
    heeded = {pin.partition(" ")[0].lower() for pin in script.lists.pins}  # PowerShell itself reads them
    read = Counter(text_of(node).lower() for node in readers if not is_assigned(node))
    for node in variables:
        name = text_of(node).lower()
        if is_assigned(node) and not read[name] and ":" not in name and name not in heeded:
            yield script.problem(UNUSED, node, f"{text_of(node)} is never read", "leave it out")
