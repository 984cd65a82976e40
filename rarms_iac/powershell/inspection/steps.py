"""The steps of a script: its tree must be the template's tree with literals as leaves.

The calls and the names of table entries are taken out of the script, and must be on the lists here. The template is
filled again with exactly those and a harmless literal for every value. Where the tree of that differs from the tree of
the script, something else is in it. So what a script does can be read out of its tree.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import zip_longest
from typing import TYPE_CHECKING

from rarms_iac.model.diagnostics import Diagnostic, Finding, Place
from rarms_iac.powershell.inspection.allowed import ScriptKind, words
from rarms_iac.powershell.inspection.script import CommandCall, Script, call_of
from rarms_iac.powershell.templates import FACTS, PLAN, STEP_CALL, TARGET, VM, StepText, fill, step_lines, target_line
from rarms_iac.powershell.tree import ShapeNode, line_of, literal_of, parse, shape_of, text_of

if TYPE_CHECKING:
    from tree_sitter import Node

STEP = Finding.error("RARMS211", "A step of a script has another form than rarms writes")
_ADVICE = "a step is a table of literals; its blocks hold calls of cmdlets and of the runtime's functions"

_RUN_KEYS = words("""
    Run Plan Application Serial Undo UndoDigest Guest Computer LogicalProcessors Cores ThreadsPerCore
    Percent Memory AcceptScheduler Guard
    """)
_STEP_PARAMETERS = words("Action Before After Set")
_EXTRA_PARAMETERS = ("Undoes", "Lost", "Fits")
_READERS = words("""
    Read-Partition Read-PartitionDevice Read-NewPartition Read-MadePartition Read-TaskClass Read-GuestTaskClass
    Read-Disk
    """)
_WRITERS = words("""
    Write-Mark Invoke-PartitionStop Write-TaskValue Clear-TaskValue Clear-TaskClass Write-TaskRecord
    Clear-TaskRecord Save-TaskRecord Restore-TaskClass
    Clear-DiskFile Add-PartitionDisk Clear-NetworkAdapter
    """)
_MEASURES = words("Add-TestPartition Add-GuestWork")
_VALUES = words("Get-PendingName Get-DiskPath Hyper-V\\Get-VMHardDiskDrive")
_HARMLESS = "'x'"


class _OtherForm(Exception):
    """The script has no template's form here."""

    def __init__(self, node: "Node", detail: str) -> None:
        super().__init__(detail)
        self.node = node
        self.detail = detail


def check_steps(script: Script, fixed: Sequence[tuple[int, int]]) -> Iterator[Diagnostic]:
    """Compare what stands outside of the fixed parts, whose first and last lines these are, with the template."""
    roots = [node for node in _top(script.root) if not any(first <= line_of(node) <= last for first, last in fixed)]
    try:
        template = _filled_template(script, roots)
    except _OtherForm as other:
        yield script.problem(STEP, other.node, other.detail, _ADVICE)
        return
    for actual, expected in zip_longest(shape_of(roots), template):
        if actual != expected:
            yield _difference(script, actual, expected)
            return


def _difference(script: Script, actual: ShapeNode | None, expected: ShapeNode | None) -> Diagnostic:
    line = actual.line if actual else script.text.count("\n")
    found, wanted = (node.text or node.label.replace("_", " ") if node else "nothing" for node in (actual, expected))
    detail = f"its tree has {found[:40]} where the template's tree has {wanted[:40]}"
    return STEP.at(Place(file=script.name, line=line, column=1), detail, _ADVICE)


def _top(root: "Node") -> Iterator["Node"]:
    """The top of a script: its statements, and whatever else stands beside them, but for remarks."""
    for node in root.children:
        if node.type == "statement_list":
            yield from node.children
        elif node.type != "comment":
            yield node


def _filled_template(script: Script, roots: Sequence["Node"]) -> tuple[ShapeNode, ...]:
    """The tree of the template, filled with the script's own calls and a harmless literal for each value.

    Raises:
        _OtherForm: the script has no form that the template can have, or calls something else.
    """
    facts, calls = plan_of(script.root)
    if facts is None:
        raise _OtherForm(roots[0] if roots else script.root, f"{PLAN} does not begin with the facts of the run")
    text = fill(
        "script.ps1.j2",
        {
            **dict.fromkeys(("synopsis", "name", "usage"), ""),
            **dict.fromkeys(("description", "notes", "requirements", "fixed"), ()),
            "run": _template_run(facts),
            "entry": script.entry,
            "plan": [line for call in calls for line in _template_call_lines(call, script.kind)],
        },
    )
    return shape_of(_top(parse(text.decode("ascii"))))


def plan_of(root: "Node") -> tuple["Node | None", tuple[CommandCall, ...]]:
    """The table of a script's facts, None where it has none, and the calls that stand behind it in its plan.

    Whatever else stands there is left out: the inspection finds it in the tree.
    """
    plans = [node for node in _top(root) if node.type == "function_statement" and PLAN in map(text_of, node.children)]
    if not plans:
        return None, ()
    statements = [
        statement for child in plans[0].children if child.type == "script_block" for statement in statements_of(child)
    ]
    calls = tuple(call for statement in statements[1:] if (call := only_call(statement)) is not None)
    assignment = inner(statements[0]) if statements else plans[0]
    if assignment.type != "assignment_expression" or text_of(assignment.children[0]) != FACTS:
        return None, calls
    return assignment.children[-1], calls


def _template_call_lines(call: CommandCall, kind: ScriptKind) -> list[str]:
    if kind is ScriptKind.MEASURE:
        return [f"    {_call_text(call, _MEASURES)}"]
    given = {parameter.name: parameter.value for parameter in call.given}
    if call.name == TARGET and given.keys() == {"Address", "Read"}:
        return [target_line(_HARMLESS, _template_call(_value_of(call, given, "Read"), _READERS))]
    if call.name == STEP_CALL:
        return _template_step(call, given)
    raise _OtherForm(call.node, f"the plan holds {TARGET} and {STEP_CALL}, and nothing else")


def _value_of(call: CommandCall, given: "Mapping[str, Node | None]", name: str) -> "Node":
    value = given[name]
    if value is None:
        raise _OtherForm(call.node, f"-{name} has no value")
    return value


def _template_run(table: "Node") -> dict[str, str]:
    """The run's facts, and the guard that belongs to a host's script or to a guest's."""
    facts = entries(table) or {}
    if facts.keys() != _RUN_KEYS:
        raise _OtherForm(table, f"the facts lack or add {', '.join(sorted(_RUN_KEYS ^ facts.keys()))}")
    guest = text_of(inner(facts["Guest"])) != "''"
    names = ("kind", "plan", "application", "serial", "undo", "undo_digest", "guest", "computer")
    more = ("logical_processors", "cores", "threads_per_core", "percent", "memory", "accept_scheduler")
    return {**dict.fromkeys((*names, *more), _HARMLESS), "guard": "Assert-Guest" if guest else "Assert-VmHost"}


def _template_step(call: CommandCall, given: "Mapping[str, Node | None]") -> list[str]:
    if not given.keys() >= _STEP_PARAMETERS or not given.keys() <= {*_STEP_PARAMETERS, *_EXTRA_PARAMETERS}:
        raise _OtherForm(call.node, "the step lacks a part, or has one too many")
    options = [(name, _HARMLESS) for name in _EXTRA_PARAMETERS[:2] if name in given]
    if "Fits" in given:
        asked = _template_call(_value_of(call, given, "Fits"), words("Test-Capacity"))
        options.append(("Fits", f"{{ {asked} }}"))
    return step_lines(
        StepText(
            action=_HARMLESS,
            before=_template_readings(_value_of(call, given, "Before")),
            after=_template_readings(_value_of(call, given, "After")),
            calls=_template_set(_value_of(call, given, "Set")),
            options=options,
        )
    )


def _template_readings(node: "Node") -> dict[str, str]:
    table = entries(node)
    if table is None:
        raise _OtherForm(node, "the readings before or after a step are no table")
    return {key if key.isidentifier() else f"'{number}'": _HARMLESS for number, key in enumerate(table)}


def _template_call(node: "Node", allowed: frozenset[str]) -> str:
    """The one call of a block."""
    statements = list(statements_of(inner(node)))
    call = only_call(statements[0]) if len(statements) == 1 else None
    if call is None:
        raise _OtherForm(node, f"here stands one call of {', '.join(sorted(allowed))}, and nothing else")
    return _call_text(call, allowed)


def _template_set(node: "Node") -> tuple[str, ...]:
    """The calls of a `Set` block: cmdlets of Hyper-V, and writers of the runtime."""
    calls = []
    for statement in statements_of(inner(node)):
        call = only_call(statement)
        if call is None:
            raise _OtherForm(statement, "Set holds more than calls")
        calls.append(_call_text(call, _WRITERS | ({call.name} if call.name.startswith("Hyper-V\\") else set())))
    if not calls:
        raise _OtherForm(node, "Set does nothing, or is no block")
    return tuple(calls)


def _call_text(call: CommandCall, allowed: frozenset[str]) -> str:
    """The call with the same parameters, and a harmless literal for each of its literals."""
    if call.name not in allowed or call.operator or call.loose:
        raise _OtherForm(call.node, f"a step must not do this: {call.name or text_of(call.node)[:40]}")
    words_of_call = [call.name]
    for given in call.given:
        words_of_call.append(f"-{given.name}")
        if given.value is not None:
            words_of_call.append(_value_text(given.value))
    return " ".join(words_of_call)


def _value_text(node: "Node") -> str:
    """A literal, the machine, or what the runtime's own functions make of literals."""
    value = inner(node)
    if literal_of(value) is not None:
        return _HARMLESS
    if text_of(value) == VM:
        return VM
    statements = [child for child in value.children if child.is_named]
    call = only_call(statements[0]) if value.type == "parenthesized_expression" and len(statements) == 1 else None
    if call is None:
        raise _OtherForm(node, f"{text_of(node)[:40]} is no literal")
    return f"({_call_text(call, _VALUES)})"


def statements_of(block: "Node") -> Iterator["Node"]:
    """The statements of a block, without remarks."""
    for child in block.children:
        if child.type in {"statement_list", "script_block_body", "script_block"}:
            yield from statements_of(child)
        elif child.is_named and child.type != "comment":
            yield child


def only_call(statement: "Node") -> CommandCall | None:
    """The call that a statement is, where it is nothing but one call."""
    node = statement
    while node.type in {"pipeline", "pipeline_chain"} and node.child_count == 1:
        node = node.children[0]
    return call_of(node) if node.type == "command" else None


def entries(node: "Node") -> Mapping[str, "Node"] | None:
    """The entries of a table by name; None where the node is no table, or says a name twice."""
    table = inner(node)
    if table.type != "hash_literal_expression":
        return None
    table_entries: dict[str, Node] = {}
    for body in table.children:
        for entry in body.children if body.type == "hash_literal_body" else ():
            if entry.type == "hash_entry":
                key = text_of(entry.children[0])
                if key in table_entries:
                    return None
                table_entries[key] = [child for child in entry.children if child.is_named][-1]
    return table_entries


def inner(node: "Node") -> "Node":
    """The end of a chain of only children: a literal, a table, a block."""
    while literal_of(node) is None and node.child_count == 1:
        node = node.children[0]
    return node
