"""The steps of a script: calls of three functions with tables of literals, in which blocks hold cmdlet calls only.

So that what a script does can be read out of its tree, and nothing else is in it.
"""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.powershell.inspection.lists import words
from rarms_iac.powershell.inspection.script import Call, Script, call_of
from rarms_iac.powershell.tree import literal_of, text_of, walk

if TYPE_CHECKING:
    from tree_sitter import Node

STEP = Finding(
    code="RARMS211", severity=Severity.ERROR, summary="A step of a script has another form than rarms writes"
)
_ADVICE = "a step is a table of literals; its blocks hold calls of cmdlets and of the runtime's functions"

RUN_KEYS = words("""
    Run Plan Application Serial Total Undo UndoDigest Guest Computer LogicalProcessors Percent Memory AcceptScheduler
    Guard
    """)
STEP_KEYS = words("Number Address Action Needs Read Before After Set")
_STEP_OPTIONAL = frozenset({"Undoes", "Lost", "Fits"})
_TABLES = frozenset({"Before", "After"})
_BLOCKS = frozenset({"Read", "Set", "Fits"})
_READERS = frozenset({"Read-Partition", "Read-TaskClass", "Read-GuestTaskClass", "Read-Disk"})
_WRITERS = words("""
    Write-Mark Clear-Mark Invoke-PartitionStop Write-TaskValue Clear-TaskValue Clear-TaskClass Write-TaskRecord
    Clear-TaskRecord Save-TaskRecord Restore-TaskClass
    Clear-DiskFile
    """)
_VALUES = frozenset({"Get-Machine", "Get-DiskPath"})


def check_steps(script: Script, first_line: int) -> Iterator[Diagnostic]:
    """What follows the runtime, from this line (counted from 1) on."""
    after = [node for node in _top(script.root) if node.is_named and node.start_point.row + 1 >= first_line]
    if len(after) != 2 or [node.type for node in after] != ["try_statement", "flow_control_statement"]:
        at = after[0] if after else script.root
        yield script.problem(STEP, at, "beside the one try block and exit 0 there is something else", _ADVICE)
        return
    block = next(node for node in after[0].children if node.type == "statement_block")
    yield from _check_run(script, list(statements_of(block)))


def _top(root: "Node") -> Iterator["Node"]:
    """What a script is made of: its statements, and whatever else stands beside them, but for remarks."""
    for node in root.children:
        if node.type == "statement_list":
            yield from node.children
        elif node.type != "comment":
            yield node


def statements_of(block: "Node") -> Iterator["Node"]:
    """The statements of a block, without remarks."""
    for child in block.children:
        if child.type in {"statement_list", "script_block_body", "script_block"}:
            yield from statements_of(child)
        elif child.is_named and child.type != "comment":
            yield child


def _check_run(script: Script, statements: list["Node"]) -> Iterator[Diagnostic]:
    calls = [only_call(statement) for statement in statements]
    names = [one.name if one else "" for one in calls]
    if names != ["Open-Run", *["Add-Step"] * (len(names) - 2), "Complete-Run"]:
        yield script.problem(STEP, statements[0], "Open-Run, steps and Complete-Run are not all there is", _ADVICE)
        return
    for call in calls[:-1]:
        assert call is not None, "the names are those of calls"
        table = _table(call)
        if table is None:
            yield script.problem(STEP, call.node, f"{call.name} does not get one table", _ADVICE)
        elif call.name == "Open-Run":
            yield from _check_opening(script, call.node, table)
        else:
            yield from _check_step(script, call.node, table)


def _check_opening(script: Script, node: "Node", table: Mapping[str, "Node"]) -> Iterator[Diagnostic]:
    """The run's facts as literals, and the guard that belongs to a host's script or to a guest's."""
    facts = {name: value for name, value in table.items() if name != "Guard"}
    yield from _check_literals(script, node, facts, RUN_KEYS - {"Guard"}, RUN_KEYS)
    guest = "Guest" in table and text_of(inner(table["Guest"])) == "$true"
    guard = "Assert-Guest" if guest else "Assert-VmHost"
    if "Guard" not in table or not _is_one_call(table["Guard"], frozenset({guard})):
        yield script.problem(STEP, node, f"its guard is not {guard}", _ADVICE)


def only_call(statement: "Node") -> Call | None:
    """The call that a statement is, where it is nothing but one call."""
    node = statement
    while node.type in {"pipeline", "pipeline_chain"} and node.child_count == 1:
        node = node.children[0]
    return call_of(node) if node.type == "command" else None


def _table(call: Call) -> Mapping[str, "Node"] | None:
    if [given.name for given in call.given] != ["Definition"] or call.loose or call.given[0].value is None:
        return None
    return entries(call.given[0].value)


def entries(node: "Node") -> Mapping[str, "Node"] | None:
    """The entries of a table by name; None where the node is no table, or says a name twice."""
    table = inner(node)
    if table.type != "hash_literal_expression":
        return None
    found: dict[str, Node] = {}
    for body in table.children:
        for entry in body.children if body.type == "hash_literal_body" else ():
            if entry.type == "hash_entry":
                key = text_of(entry.children[0])
                if key in found:
                    return None
                found[key] = [child for child in entry.children if child.is_named][-1]
    return found


def inner(node: "Node") -> "Node":
    """What a chain of only children ends in: a literal, a table, a block."""
    while literal_of(node) is None and node.child_count == 1:
        node = node.children[0]
    return node


def _check_literals(
    script: Script, node: "Node", table: Mapping[str, "Node"], needed: frozenset[str], allowed: frozenset[str]
) -> Iterator[Diagnostic]:
    if not needed <= table.keys() <= allowed:
        odd = ", ".join(sorted(needed ^ table.keys())) or "names"
        yield script.problem(STEP, node, f"the table lacks or adds {odd}", _ADVICE)
    for name, value in table.items():
        if literal_of(inner(value)) is None:
            yield script.problem(STEP, value, f"{name} is no literal", _ADVICE)


def _check_step(script: Script, node: "Node", table: Mapping[str, "Node"]) -> Iterator[Diagnostic]:
    plain = {name: value for name, value in table.items() if name not in _TABLES | _BLOCKS}
    names = STEP_KEYS - _TABLES - _BLOCKS
    yield from _check_literals(script, node, plain, names, names | {"Undoes", "Lost"})
    if not table.keys() >= STEP_KEYS or not table.keys() <= STEP_KEYS | _STEP_OPTIONAL:
        yield script.problem(STEP, node, "the step lacks a part, or has one too many", _ADVICE)
    for name in sorted(_TABLES & table.keys()):
        held = entries(table[name])
        if held is None:
            yield script.problem(STEP, table[name], f"{name} is no table", _ADVICE)
        else:
            yield from _check_literals(script, table[name], held, frozenset(), frozenset(held))
    if "Read" in table and not _is_one_call(table["Read"], _READERS):
        yield script.problem(STEP, table["Read"], "Read does more than read", _ADVICE)
    if "Fits" in table and not _is_one_call(table["Fits"], frozenset({"Test-Capacity"})):
        yield script.problem(STEP, table["Fits"], "Fits does more than ask whether the host has room", _ADVICE)
    if "Set" in table:
        yield from _check_set(script, table["Set"])


def _block(node: "Node") -> list["Node"] | None:
    block = inner(node)
    if block.type != "script_block_expression":
        return None
    return list(statements_of(block))


def _is_one_call(node: "Node", names: frozenset[str]) -> bool:
    """Whether it is a block that holds one call of these, with plain values."""
    statements = _block(node) or []
    call = only_call(statements[0]) if len(statements) == 1 else None
    return call is not None and call.name in names and _has_plain_values(call)


def _check_set(script: Script, node: "Node") -> Iterator[Diagnostic]:
    statements = _block(node)
    if not statements:
        yield script.problem(STEP, node, "Set does nothing, or is no block", _ADVICE)
    for statement in statements or []:
        call = only_call(statement)
        if call is None:
            if not _is_machine(statement):
                yield script.problem(STEP, statement, "Set holds more than calls and $vm", _ADVICE)
        elif not (call.name.startswith("Hyper-V\\") or call.name in _WRITERS) or not _has_plain_values(call):
            yield script.problem(
                STEP, statement, f"Set must not do this: {call.name or text_of(call.node)[:40]}", _ADVICE
            )


def _is_machine(statement: "Node") -> bool:
    """`$vm = Get-Machine ...` with literals."""
    found = [node for node in walk(statement) if node.type == "command"]
    left = [node for node in walk(statement) if node.type == "left_assignment_expression"]
    if len(found) != 1 or len(left) != 1 or text_of(left[0]) != "$vm":
        return False
    call = call_of(found[0])
    whole = text_of(statement).removeprefix("$vm = ") == text_of(found[0])
    return whole and call.name == "Get-Machine" and _has_plain_values(call)


def _has_plain_values(call: Call) -> bool:
    """Literals, `$vm`, and what the runtime's own functions make of literals."""
    return not call.loose and not call.operator and all(_is_plain(one.value) for one in call.given if one.value)


def _is_plain(node: "Node") -> bool:
    value = inner(node)
    if literal_of(value) is not None or text_of(value) == "$vm":
        return True
    if value.type != "parenthesized_expression":
        return False
    statements = [child for child in value.children if child.is_named]
    call = only_call(statements[0]) if len(statements) == 1 else None
    return call is not None and call.name in _VALUES and _has_plain_values(call)
