"""Everything that a script must pass before it is shown or run: bytes, calls, and our own linter."""

from collections import Counter
from collections.abc import Iterator
from functools import cache
from typing import TYPE_CHECKING

from rarms_iac.model.diagnostics import Diagnostic, Finding, Place, in_order
from rarms_iac.powershell import cmdlets
from rarms_iac.powershell.cmdlets import Cmdlet, problems_of_call
from rarms_iac.powershell.inspection.allowed import CHANGING, ScriptKind, words
from rarms_iac.powershell.inspection.language import check_constructs, check_names, is_assigned
from rarms_iac.powershell.inspection.layout import check_end, check_layout, check_whole, split_script, without_fixed
from rarms_iac.powershell.inspection.script import CommandCall, Function, Script, calls_of, functions_of
from rarms_iac.powershell.inspection.steps import check_steps
from rarms_iac.powershell.literals import NotALiteral, read_literal
from rarms_iac.powershell.templates import part_text, read, runtime
from rarms_iac.powershell.tokens import NotTokens
from rarms_iac.powershell.tree import NotParsed, parse, sound, text_of, walk

if TYPE_CHECKING:
    from tree_sitter import Node


BYTES = Finding.error("RARMS200", "A script is not pure ASCII with CRLF")
PARSE = Finding.error("RARMS201", "A script cannot be read as PowerShell")

LARGEST = 16 * 1024 * 1024
"""Bytes of a script that is looked at; a plan of a thousand partitions makes a tenth of it."""


def inspect(
    script: bytes, kind: ScriptKind, name: str = "script.ps1", *, trusting: bool = True
) -> tuple[Diagnostic, ...]:
    """Find what is wrong with a script of this kind.

    Args:
        script: its bytes.
        kind: what it may do.
        name: its file name, for the findings.
        trusting: whether parts that are to the byte what rarms ships are not looked at again.

    Returns:
        The findings in the order of the script's lines; none where it may be shown and run.
    """
    problems = tuple(_check_bytes(script, name))
    if problems:
        return problems
    whole = script.decode("ascii")
    changes = kind not in (ScriptKind.OBSERVE, ScriptKind.BOOTSTRAP)
    text = without_fixed(whole) if changes and trusting else whole
    try:
        root = sound(text)
    except NotParsed as error:
        place = Place(file=name, line=error.line, column=1)
        return (PARSE.at(place, error.message, "render the script again, or mend this line"),)
    parsed = Script(
        name=name,
        text=text,
        root=root,
        kind=kind,
        functions=functions_of(root),
        given=_carried_functions(whole) if text is not whole else {},
        nodes=tuple(walk(root)),
    )
    return in_order(list(_check(parsed, whole)))


def _carried_functions(whole: str) -> dict[str, Function]:
    """The functions of what is fixed in a script."""
    return {
        name: function
        for piece in split_script(whole).fixed
        for name, function in _shipped_functions(piece.name).items()
    }


@cache
def _shipped_functions(name: str) -> dict[str, Function]:
    """The functions of a shipped part, or of the runtime: parsed once, checked by the tests of what rarms ships."""
    return functions_of(parse(part_text(name) if name else runtime()))


def _check_bytes(script: bytes, name: str) -> Iterator[Diagnostic]:
    if len(script) > LARGEST:
        yield BYTES.at(Place(file=name, line=1, column=1), f"it has {len(script)} bytes", "split the plan")
        return
    *lines, rest = script.split(b"\n")
    if rest or not lines:
        yield BYTES.at(Place(file=name, line=len(lines) + 1, column=1), "the last line does not end", "write its CRLF")
    for number, line in enumerate(lines, start=1):
        place = Place(file=name, line=number, column=1)
        if bad := [byte for byte in line.removesuffix(b"\r") if not 0x20 <= byte <= 0x7E]:
            advice = "5.1 reads a script in the code page of its Windows: only ASCII is the same everywhere"
            yield BYTES.at(place, f"a byte 0x{bad[0]:02x} is not printable ASCII", advice)
        elif not line.endswith(b"\r"):
            yield BYTES.at(place, "the line does not end with CR LF", "write it with CRLF, to its last line")


def _check(script: Script, whole: str) -> Iterator[Diagnostic]:
    yield from check_constructs(script)
    yield from check_commands(script)
    yield from check_names(script)
    yield from check_style(script)
    if script.kind is ScriptKind.OBSERVE:
        yield from check_end(script.name, script.text)
    elif script.kind is ScriptKind.BOOTSTRAP:
        yield from check_whole(script.name, script.text, read("bootstrap.ps1"))
    else:
        parts = split_script(whole)
        yield from check_layout(script.name, parts, script.entry)
        yield from check_steps(script, [(piece.first, piece.last) for piece in parts.fixed])


COMMAND = Finding.error("RARMS204", "A script calls a command that is not allowed")
CALL = Finding.error("RARMS205", "A call in a script would not bind")
WRITES = Finding.error("RARMS210", "A read-only script changes something")
FORCE = Finding.error("RARMS218", "A registry key would be emptied")

HYPERV = "Hyper-V"


def check_commands(script: Script) -> Iterator[Diagnostic]:
    """Each call: a function of the script, or a cmdlet of the lists under its full name, with parameters that fit."""
    for call in calls_of(script.root):
        if call.name:
            yield from _check_call(script, call)


def _check_call(script: Script, call: CommandCall) -> Iterator[Diagnostic]:
    if call.operator:
        detail = f"& before {call.name}: a cmdlet is called by its name alone"
        yield script.problem(COMMAND, call.node, detail, "leave out the &")
    if function := script.functions.get(call.name.lower()) or script.given.get(call.name.lower()):
        yield from _check_function_call(script, call, function)
        return
    module, _, name = call.name.rpartition("\\")
    cmdlet = cmdlets.cmdlet(name, module)
    allowed = script.lists.qualified if module else script.lists.plain
    if cmdlet is None or cmdlet.name != name or not cmdlet.in_7:
        yield script.problem(COMMAND, call.node, f"{call.name} is no cmdlet of 5.1 and 7 that rarms knows", _ADVICE)
    elif name not in allowed or (bool(module) and module != HYPERV):
        yield from _not_allowed(script, call, cmdlet)
    else:
        yield from _check_binding(script, call, cmdlet)


_ADVICE = "call a cmdlet of the tables by its full name, with its module where that is Hyper-V"


def _not_allowed(script: Script, call: CommandCall, cmdlet: Cmdlet) -> Iterator[Diagnostic]:
    changes = cmdlet.name in CHANGING.qualified | CHANGING.plain or cmdlet.should_process
    if script.kind is ScriptKind.OBSERVE and changes:
        detail = f"{call.name} does not only read"
        yield script.problem(WRITES, call.node, detail, "a read-only script calls Get- and Test- cmdlets")
    elif cmdlet.module == HYPERV and "\\" not in call.name:
        detail = f"{call.name} may be another module's"
        yield script.problem(COMMAND, call.node, detail, f"write {HYPERV}\\{cmdlet.name}")
    else:
        yield script.problem(COMMAND, call.node, f"scripts of rarms have no need of {call.name}", _ADVICE)


def _check_function_call(script: Script, call: CommandCall, function: Function) -> Iterator[Diagnostic]:
    if call.name != function.name:
        detail = f"{call.name} is written {function.name}"
        yield script.problem(CALL, call.node, detail, "write it as it is defined")
    names = [given.name for given in call.given]
    for given in call.given:
        if given.name not in function.parameters:
            detail = f"{function.name} has no parameter -{given.name}"
            yield script.problem(CALL, given.node, detail, "see the function's param block")
        elif (given.value is None) != function.parameters[given.name]:
            yield script.problem(CALL, given.node, f"-{given.name} lacks a value, or takes none", "see the param block")
    if len(set(names)) != len(names) or call.loose:
        yield script.problem(CALL, call.node, f"{function.name} gets a value without a name, or one twice", "name each")


def _check_binding(script: Script, call: CommandCall, cmdlet: Cmdlet) -> Iterator[Diagnostic]:
    names, loose = [given.name for given in call.given], len(call.loose)
    for given in call.given:
        parameter = cmdlet.parameter(given.name)
        if parameter is None:
            continue
        if parameter.is_switch and given.value is not None:
            loose += 1
        elif not parameter.is_switch and given.value is None:
            yield script.problem(CALL, given.node, f"-{given.name} of {cmdlet.name} needs a value", "give it one")
        elif given.value is not None and parameter.accepted and not _accepts(parameter.accepted, text_of(given.value)):
            detail = f"-{given.name} of {cmdlet.name} does not take {text_of(given.value)[:40]}"
            yield script.problem(CALL, given.node, detail, f"it takes {', '.join(parameter.accepted[:12])}")
    for problem in problems_of_call(cmdlet, names, positional=loose, piped=call.piped):
        yield script.problem(CALL, call.node, problem.message, problem.advice)
    if cmdlet.name == "New-Item" and "Force" in names:
        detail = "New-Item with -Force makes a key anew: what it held is lost"
        yield script.problem(FORCE, call.node, detail, "test for the key first, and create it without -Force")
    if cmdlet.name == "Remove-Item" and set(names) & {"Force", "Recurse"}:
        detail = "Remove-Item takes more than the one empty-handed key"
        yield script.problem(FORCE, call.node, detail, "remove one key, without -Recurse and -Force")


def _accepts(accepted: tuple[str, ...], text: str) -> bool:
    """Whether a literal is one of the accepted values; what is no literal cannot be told here."""
    try:
        return str(read_literal(text)) in accepted
    except (NotALiteral, NotTokens):
        return True


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
