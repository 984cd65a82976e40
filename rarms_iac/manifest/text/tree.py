"""A YAML text as it was written: keys and values with their positions, and where asked for comments and blank lines.

The builder fills these while it walks the events of the parser, so they are not frozen; nothing changes them later.
"""

from dataclasses import dataclass, field
from typing import Any

from rarms_iac.manifest.text.scalars import NotRepresentable, plain_scalar
from rarms_iac.model.diagnostics import Place


@dataclass(slots=True)
class Scalar:
    """A scalar: its text, and how it was written (`''` is plain, otherwise the first character of its style)."""

    value: str
    style: str
    start: int  # characters from the beginning of the text
    end: int
    many_lines: bool = False
    file: str = ""
    line: int = 0  # counted from 0, as its column
    column: int = 0


@dataclass(slots=True)
class Collection:
    """A mapping, or a sequence (whose entries have no keys)."""

    is_mapping: bool
    flow: bool
    indent: int  # the column from which on a comment below an entry belongs to the collection
    start: int
    end: int
    entries: "list[Entry]" = field(default_factory=list)
    tail: list[str] = field(default_factory=list)  # comments after the last entry; "" is a blank line
    has_comments: bool = False  # anywhere inside
    file: str = ""
    line: int = 0
    column: int = 0


@dataclass(slots=True)
class Entry:
    """A key with its value, or an item of a sequence."""

    key: Scalar | None
    value: "Scalar | Collection"
    before: list[str]  # comments above it; "" is a blank line
    trailing: str = ""  # the comment on its first line


Node = Scalar | Collection


def entries_by_key(mapping: Collection) -> dict[str, Entry]:
    """The entries of a mapping; of a key that occurs twice the first one."""
    entries: dict[str, Entry] = {}
    for entry in mapping.entries:
        if entry.key is not None:
            entries.setdefault(entry.key.value, entry)
    return entries


def place_of_node(node: Node) -> Place:
    """Where the node begins; a scalar on one line is underlined whole."""
    length = node.end - node.start if isinstance(node, Scalar) and not node.many_lines else 1
    return Place(file=node.file, line=node.line + 1, column=node.column + 1, length=max(1, length))


def is_null(node: Node) -> bool:
    """Whether it is a null of YAML: `null`, `~`, or nothing at all."""
    return isinstance(node, Scalar) and plain(node) is None


def plain(node: Node) -> Any:
    """The values alone, as `events.read_events` gives them."""
    if isinstance(node, Scalar):
        try:
            return node.value if node.style else plain_scalar(node.value)
        except NotRepresentable:  # reported when it was read
            return None
    if node.is_mapping:
        return {key: plain(entry.value) for key, entry in entries_by_key(node).items()}
    return [plain(entry.value) for entry in node.entries]
