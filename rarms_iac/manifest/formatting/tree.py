"""A manifest's text as it was written: keys, values, comments and blank lines, with their spans in the source.

The builder fills these while it walks the events of the parser, so they are not frozen; nothing changes them later.
"""

from dataclasses import dataclass, field


@dataclass(slots=True)
class Scalar:
    """A scalar: what it says, and how it was written (`''` is plain, otherwise the first character of its style)."""

    value: str
    style: str
    start: int
    end: int
    many_lines: bool = False


@dataclass(slots=True)
class Collection:
    """A mapping, or a sequence (whose entries have no keys)."""

    is_mapping: bool
    flow: bool
    column: int
    start: int
    end: int
    entries: "list[Entry]" = field(default_factory=list)
    tail: list[str] = field(default_factory=list)  # comments after the last entry; "" is a blank line
    has_comments: bool = False  # anywhere inside


@dataclass(slots=True)
class Entry:
    """A key with its value, or an item of a sequence."""

    key: Scalar | None
    value: "Scalar | Collection"
    before: list[str]  # comments above it; "" is a blank line
    trailing: str = ""  # the comment on its first line


Node = Scalar | Collection
