"""What stands in a script's tree: the statements of its plan, calls with parameters, tables with entries."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rarms_iac.powershell.templates import FACTS, LATER_ROW, PLAN, ROW, ROWS
from rarms_iac.powershell.tree import literal_of, text_of, walk

if TYPE_CHECKING:
    from tree_sitter import Node


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandCall:
    """A command: its name as written, empty where it is no plain name; a switch is given without a value."""

    name: str
    operator: str  # & or . before it
    given: "Mapping[str, Node | None]"
    loose: tuple["Node", ...]  # values without a parameter
    node: "Node"


def calls_of(root: "Node") -> Iterator[CommandCall]:
    """Every command below a node."""
    for node in walk(root):
        if node.type == "command":
            yield call_of(node)


def call_of(node: "Node") -> CommandCall:
    """The command that a node is, taken apart."""
    name = operator = ""
    given: dict[str, Node | None] = {}
    loose: list[Node] = []
    for child in node.children:
        match child.type:
            case "command_invokation_operator":
                operator = text_of(child)
            case "command_name":
                name = text_of(child)
            case "command_elements":
                _read_elements(child, given, loose)
            case _:
                pass
    return CommandCall(name=name, operator=operator, given=given, loose=tuple(loose), node=node)


def _read_elements(elements: "Node", given: "dict[str, Node | None]", loose: list["Node"]) -> None:
    parameter = ""
    for child in elements.children:
        if child.type == "command_parameter":
            parameter = text_of(child).removeprefix("-").removesuffix(":")
            given[parameter] = None
        elif child.type != "command_argument_sep":
            if parameter:
                given[parameter] = child
            else:
                loose.append(child)
            parameter = ""


def top_statements(root: "Node") -> Iterator["Node"]:
    """The top of a script: its statements, and all else that stands beside them, but for remarks."""
    for node in root.children:
        if node.type == "statement_list":
            yield from node.children
        elif node.type != "comment":
            yield node


def plan_statements(root: "Node") -> tuple["Node", ...]:
    """What stands in a script's plan; nothing where it has no plan, or two."""
    plans = [node for node in map(inner, top_statements(root)) if _is_plan(node)]
    return tuple(statements_of(block_in(plans[0]))) if len(plans) == 1 else ()


def _is_plan(node: "Node") -> bool:
    """Whether a node gives a script its plan."""
    return node.type == "assignment_expression" and text_of(node.children[0]).lower() == PLAN


def block_in(node: "Node") -> "Node":
    """The first block of statements in a node; the node itself where it has none."""
    return next((child for child in walk(node) if child.type == "script_block"), node)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanPart:
    """Calls of a plan: made once, or for each row of the table before them."""

    calls: tuple[CommandCall, ...]
    rows: "tuple[Mapping[str, Node], ...]" = ()  # a literal for each column; empty: made once


def plan_of(root: "Node") -> tuple["Node | None", tuple[PlanPart, ...]]:
    """The table of a script's facts, None where its plan does not begin with it, and what stands behind it."""
    statements = plan_statements(root)
    parts = tuple(_parts(statements[1:]))
    assignment = inner(statements[0]) if statements else root
    if assignment.type != "assignment_expression" or text_of(assignment.children[0]) != FACTS:
        return None, parts
    return assignment.children[-1], parts


def _parts(statements: "tuple[Node, ...]") -> Iterator[PlanPart]:
    """What is neither a call nor a table with its calls is left out: a template's tree has none of it."""
    rows: tuple[Mapping[str, Node], ...] = ()
    calls: list[CommandCall] = []
    for statement in map(inner, statements):
        if statement.type == "assignment_expression" and text_of(statement.children[0]) == ROWS:
            tables = [entries(row) for row in statements_of(inner(statement.children[-1]))]
            rows = tuple(table for table in tables if table)
        elif statement.type == "foreach_statement":
            yield PlanPart(calls=tuple(calls))
            calls = []
            repeated = (only_call(child) for child in statements_of(statement.children[-1]))
            yield PlanPart(calls=tuple(call for call in repeated if call), rows=rows)
            rows = ()
        elif statement.type == "command":
            calls.append(call_of(statement))
    yield PlanPart(calls=tuple(calls))


def column_of(node: "Node") -> str:
    """The column that a value is, read while the plan is built or, in blocks, later; empty: it is none."""
    value = inner(node)
    parts = [text_of(child) for child in value.children] if value.type == "member_access" else []
    return parts[2] if len(parts) == 3 and parts[0] in {ROW, LATER_ROW} else ""


def statements_of(block: "Node") -> Iterator["Node"]:
    """The statements of a block, without remarks."""
    for child in block.children:
        if child.type in {"statement_list", "script_block_body", "script_block"}:
            yield from statements_of(child)
        elif child.is_named and child.type != "comment":
            yield child


def guard_of(statement: "Node") -> "tuple[Node, Node] | None":
    """The condition and the statement of `if (condition) { statement }`; None where it is anything else."""
    if statement.type != "if_statement":
        return None
    parts = [child for child in statement.children if child.is_named]
    inside = list(statements_of(parts[-1])) if [part.type for part in parts] == ["pipeline", "statement_block"] else []
    return (parts[0], inside[0]) if len(inside) == 1 else None


def only_call(statement: "Node") -> CommandCall | None:
    """The call that a statement is, where it is nothing but one call."""
    node = statement
    while node.type in {"pipeline", "pipeline_chain"} and node.child_count == 1:
        node = node.children[0]
    return call_of(node) if node.type == "command" else None


def entries(node: "Node") -> "Mapping[str, Node] | None":
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
