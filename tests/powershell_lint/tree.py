"""The tree of a script as tree-sitter reads it: its nodes, its calls with their parameters, and its structure."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from tree_sitter import Node

from rarms_iac.powershell.literals import error_in, parser


def parse(script: str) -> Node:
    """Return the root of a script's tree.

    Raises:
        ValueError: the grammar cannot read it.
    """
    root = parser().parse(script.encode("utf-8")).root_node
    if wrong := error_in(root):
        raise ValueError(f"line {line_number(wrong)}: {text_of(wrong)[:60]}")
    return root


def walk(root: Node) -> Iterator[Node]:
    """Yield the node and everything below it, in the order of the text."""
    waiting = [root]
    while waiting:
        node = waiting.pop()
        yield node
        waiting.extend(reversed(node.children))


def text_of(node: Node) -> str:
    return (node.text or b"").decode("utf-8")


def line_number(node: Node) -> int:
    """Return the line on which it begins, from 1."""
    return node.start_point.row + 1


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandCall:
    """A command: its name as written, empty where it is not a plain name; a switch is given without a value."""

    name: str
    operator: str  # & or . before it
    given: Mapping[str, Node | None]
    loose: tuple[Node, ...]  # values without a parameter
    node: Node


def calls_of(root: Node) -> Iterator[CommandCall]:
    """Yield every command below a node."""
    for node in walk(root):
        if node.type == "command":
            yield _call_of(node)


def _call_of(node: Node) -> CommandCall:
    parts = {child.type: text_of(child) for child in node.children}
    given: dict[str, Node | None] = {}
    loose: list[Node] = []
    parameter = ""
    elements = next((child for child in node.children if child.type == "command_elements"), None)
    for child in elements.children if elements else ():
        if child.type == "command_parameter":
            parameter = text_of(child).removeprefix("-").removesuffix(":")
            given[parameter] = None
        elif child.type != "command_argument_sep":
            if parameter:
                given[parameter] = child
            else:
                loose.append(child)
            parameter = ""
    return CommandCall(
        name=parts.get("command_name", ""),
        operator=parts.get("command_invokation_operator", ""),
        given=given,
        loose=tuple(loose),
        node=node,
    )


def plan_of(script: str) -> str:
    """Return what stands in the block that holds a script's plan."""
    return script.replace("\r\n", "\n").partition("\n$plan = {\n")[2].partition("\n}\n")[0]


def structure(script: str) -> list[str]:
    """Return the nodes of a script with their texts; a literal is one node without its text, comments are left out."""
    found: list[str] = []
    waiting = [parse(script)]
    while waiting:
        node = waiting.pop()
        if _is_literal(node):
            found.append("literal")
        elif node.type not in {"comment", "command_argument_sep", " ", ";"}:
            found.append(text_of(node) if node.child_count == 0 else node.type)
            waiting.extend(reversed(node.children))
    return found


def _is_literal(node: Node) -> bool:
    """Whether it is `'text'`, a number, `$true`, `$false`, or a sum that begins with an empty text."""
    if node.type == "variable":
        return text_of(node) in {"$true", "$false"}
    if node.type == "parenthesized_expression":
        return text_of(node).startswith("('' + ")
    return node.type in {"string_literal", "integer_literal"}
