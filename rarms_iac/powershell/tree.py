"""PowerShell's grammar as tree-sitter knows it, and the structure of a script without its literals.

The grammar is blind to four of the five single-quote characters. So a tree counts only where our own tokens agree
with it on where each string and comment begins and ends (`disagreement`).
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cache, lru_cache
from typing import TYPE_CHECKING

from rarms_iac.model.wording import quoted
from rarms_iac.powershell.literals import NotALiteral, read_literal
from rarms_iac.powershell.tokens import NotTokens, TokenKind, tokens

if TYPE_CHECKING:
    from tree_sitter import Node, Parser

LITERAL = "literal"
"""The label of a literal in a shape, of any form and value."""

_FORMS = frozenset({"string_literal", "integer_literal", "parenthesized_expression", "array_expression", "variable"})
_TEXTS = frozenset({"verbatim_string_characters", "verbatim_here_string_characters", "expandable_string_literal"})
_TEXTS |= {"expandable_here_string_literal", "comment"}
_LACKS = "something is missing here that PowerShell's grammar wants"
_IGNORED = frozenset({"command_argument_sep", " ", ";", "comment"})


class NotParsed(ValueError):
    """The grammar finds an error, or the tokens disagree with it."""

    def __init__(self, message: str, line: int) -> None:
        super().__init__(f"line {line}: {message}")
        self.message = message
        self.line = line


@dataclass(frozen=True, slots=True, kw_only=True)
class ShapeNode:
    """A node of a tree: how deep, what it is, and its text where it is a leaf and no literal."""

    depth: int
    label: str
    text: str
    line: int = field(compare=False)


@cache
def _parser() -> "Parser":
    """Made once, and only when a script is looked at."""
    from tree_sitter import Language, Parser
    from tree_sitter_powershell import language

    return Parser(Language(language()))


def parse(script: str) -> "Node":
    """The root of the tree; errors are nodes of it."""
    return _parser().parse(_encoded(script)).root_node


def walk(root: "Node") -> Iterator["Node"]:
    """The node and everything below it, in the order of the text."""
    waiting = [root]
    while waiting:
        node = waiting.pop()
        yield node
        waiting.extend(reversed(node.children))


def text_of(node: "Node") -> str:
    """The script's text there."""
    return (node.text or b"").decode("utf-8", "surrogatepass")


def line_number(node: "Node") -> int:
    """The line on which it begins, from 1."""
    return node.start_point.row + 1


def errors(root: "Node") -> tuple["Node", ...]:
    """The innermost nodes that the grammar could not place, or had to invent, such as the empty call before a `|`.

    What it invents may hang below a node without being among its children: so a node without a faulty child counts.
    """
    if not root.has_error:
        return ()
    return tuple(node for node in walk(root) if node.has_error and not any(child.has_error for child in node.children))


def literal_of(node: "Node") -> str | None:
    """The text of a node that is one whole literal of `literals`, arrays of them included; None of any other."""
    if node.type not in _FORMS:
        return None
    text = text_of(node)
    if node.type == "array_expression":
        return text if _is_array(node) else None
    if node.type == "parenthesized_expression" and not text.startswith("(''"):
        return None
    return text if _is_literal(text) else None


@lru_cache(maxsize=4096)
def _is_literal(text: str) -> bool:
    """Whether it reads as a literal; the inspection asks the same texts several times."""
    try:
        read_literal(text)
    except (NotALiteral, NotTokens):
        return False
    return True


def _is_array(node: "Node") -> bool:
    """Whether `@(...)` holds nothing but literals and commas."""
    inside = node.children[1:-1]
    while len(inside) == 1 and inside[0].type not in _FORMS and inside[0].child_count == 1:
        inside = inside[0].children
    if len(inside) == 1 and inside[0].type == "array_literal_expression":
        inside = inside[0].children
    return all(element.type == "," or _is_element(element) for element in inside)


def _is_element(node: "Node") -> bool:
    while node.type not in _FORMS and node.child_count == 1:
        node = node.children[0]
    return node.type != "array_expression" and literal_of(node) is not None


def shape_of(roots: Iterable["Node"]) -> tuple[ShapeNode, ...]:
    """The trees below these nodes in the order of the text; every literal is one leaf without its text.

    Comments are left out: they do nothing. So is `;`, for which a line end may stand.
    """
    shape: list[ShapeNode] = []
    waiting = [(0, root) for root in roots][::-1]
    while waiting:
        depth, node = waiting.pop()
        if node.type in _IGNORED:
            continue
        is_literal = literal_of(node) is not None
        is_leaf = is_literal or node.child_count == 0
        shape.append(
            ShapeNode(
                depth=depth,
                label=LITERAL if is_literal else node.type,
                text=text_of(node) if is_leaf and not is_literal else "",
                line=line_number(node),
            )
        )
        if not is_leaf:
            waiting.extend((depth + 1, child) for child in reversed(node.children))
    return tuple(shape)


def parse_strictly(script: str) -> "Node":
    """Parse a script, and refuse one that the grammar and the tokens do not both understand in the same way.

    Raises:
        NotParsed: they do not.
    """
    root = parse(script)
    if wrong := errors(root):
        message = (
            f"PowerShell's grammar has no place for {quoted(text_of(wrong[0]), 40)}" if text_of(wrong[0]) else _LACKS
        )
        raise NotParsed(message, line_number(wrong[0]))
    if line := disagreement(script, root):
        raise NotParsed("a string or a comment ends elsewhere than it seems", line)
    if line := _backtick(script, root):
        raise NotParsed("a backtick joins lines or hides what is written", line)
    return root


def disagreement(script: str, root: "Node") -> int:
    """The first line on which tokens and tree see different strings or comments; 0 where they agree."""
    try:
        texts = [token for token in tokens(script) if token.kind in _TOKEN_TEXTS]
    except NotTokens as no:
        return script.count("\n", 0, no.offset) + 1
    token_ranges = {(_byte_at(script, token.offset), _byte_at(script, token.end)) for token in texts}
    tree_ranges = {(node.start_byte, node.end_byte) for node in walk(root) if node.type in _TEXTS}
    if token_ranges == tree_ranges:
        return 0
    return _encoded(script).count(b"\n", 0, min(token_ranges ^ tree_ranges)[0]) + 1


_TOKEN_TEXTS = frozenset({TokenKind.STRING, TokenKind.EXPANDABLE, TokenKind.COMMENT})


def _backtick(script: str, root: "Node") -> int:
    """The first line with one outside of strings and comments; 0 where there is none."""
    data = _encoded(script)
    at = data.find(b"`")
    texts = [node for node in walk(root) if node.type in _TEXTS] if at >= 0 else []
    while at >= 0:
        inside = next((node for node in texts if node.start_byte <= at < node.end_byte), None)
        if inside is None:
            return data.count(b"\n", 0, at) + 1
        at = data.find(b"`", inside.end_byte)
    return 0


def _encoded(script: str) -> bytes:
    return script.encode("utf-8", "surrogatepass")


def _byte_at(script: str, offset: int) -> int:
    """The byte of the text's UTF-8 with which a character begins."""
    return offset if script.isascii() else len(_encoded(script[:offset]))
