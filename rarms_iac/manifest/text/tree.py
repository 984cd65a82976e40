"""A YAML text -> a tree of keys and values with their positions, with comments and blank lines.

The one builder of YAML trees: it reads text that `events.read_events` has checked, so it may trust sizes and features.
The parser drops comments: they are found between its tokens, whose positions it reports. The builder fills the nodes
while it walks the events of the parser, so they are not frozen; nothing changes them later.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import takewhile
from typing import Any

from yaml._yaml import CParser
from yaml.events import (
    AliasEvent,
    MappingEndEvent,
    MappingStartEvent,
    ScalarEvent,
    SequenceEndEvent,
    SequenceStartEvent,
)

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
    """Return the entries of a mapping; of a key that occurs twice the first one."""
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
    """Return the values alone, as `events.read_events` gives them."""
    if isinstance(node, Scalar):
        try:
            return node.value if node.style else plain_scalar(node.value)
        except NotRepresentable:  # reported when it was read
            return None
    if node.is_mapping:
        return {key: plain(entry.value) for key, entry in entries_by_key(node).items()}
    return [plain(entry.value) for entry in node.entries]


_COMMENT = re.compile("#[^\\n\\x85\\u2028\\u2029]*")  # the parser breaks lines at these four
_HEADER_COMMENT = re.compile("[|>][-+0-9]*[ \\t]+(#[^\\n]*)")


def unified(text: str) -> str:
    """Return the text without a byte order mark, its lines ended by LF alone."""
    return text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")


def build_tree(text: str) -> Collection:
    """Build the tree of a text as `unified` leaves it: one mapping without any finding."""
    root = build_positions(text, "")
    assert isinstance(root, Collection), "the text was checked: it holds one mapping"
    return root


def build_positions(text: str, file: str) -> Node:
    """Build the tree of any text that was read before; `file` is how messages name it."""
    return _Builder(text, file).root()


def comments_in(text: str, start: int, end: int) -> list[str]:
    """Return the comments that begin between two places of such a text, those behind `|` and `>` included."""
    builder = _Builder(text, "")
    builder.root()
    return [comment.rstrip() for at, comment in builder.comments if start <= at < end]


def _events(text: str) -> Iterator[Any]:
    """Yield the parser's events, made again each time.

    A list of them would keep the garbage collector busy.
    """
    return iter(CParser(text).get_event, None)


@dataclass(slots=True)
class _Comment:
    text: str
    column: int
    blank_above: bool


@dataclass(slots=True)
class _OpenCollection:
    """A collection that has not ended yet, and the key that waits for its value."""

    collection: Collection
    owner: Entry | None
    waiting: Entry | None = None


class _Builder:
    """Walks the events once; comments on the way wait until a key or an item takes them."""

    def __init__(self, text: str, file: str) -> None:
        self.text = text
        self.file = file
        self.comments: list[tuple[int, str]] = []  # all of them, each where it begins
        self.pending: list[_Comment] = []  # comments of their own lines, not yet anybody's
        self.position = 0  # end of the last token or comment
        self.last: Entry | None = None  # whose line we are on
        self.open: list[_OpenCollection] = []
        self.result: Node = Scalar("", "", 0, 0, file=file)

    def root(self) -> Node:
        """Return the whole document; an empty one is an empty scalar."""
        for event in _events(self.text):
            kind = type(event)
            if kind is ScalarEvent:
                self._scalar(event, event.value, event.style or "")
            elif kind is AliasEvent:  # refused when it was read
                self._scalar(event, "*" if self._expects_key() else "", "")
            elif kind is MappingStartEvent or kind is SequenceStartEvent:
                self._start(event, is_mapping=kind is MappingStartEvent)
            elif kind is MappingEndEvent or kind is SequenceEndEvent:
                self._end(event)
        self._take_comments(len(self.text) + 1)
        if isinstance(self.result, Collection):
            self.result.tail += _lines(self.pending)
        return self.result

    def _expects_key(self) -> bool:
        return bool(self.open) and self.open[-1].collection.is_mapping and self.open[-1].waiting is None

    def _scalar(self, event: Any, value: str, style: str) -> None:
        mark, end_mark = event.start_mark, event.end_mark
        start, end = mark.index, end_mark.index
        is_empty = start == end
        top = self.open[-1] if self.open else None
        in_mapping = top is not None and top.collection.is_mapping
        if not is_empty or not in_mapping:  # the place of an empty value of a key may lie beyond what follows it
            self._take_comments(start)
        scalar = Scalar(value, style, start, end, mark.line != end_mark.line, self.file, mark.line, mark.column)
        if top is None:
            self.result = scalar
            return
        if top.collection.is_mapping and top.waiting is None:
            self._new_entry(top, scalar, scalar, start)
        else:
            entry = self._place(top, scalar, start)
            if style in {"|", ">"} and (found := _HEADER_COMMENT.match(self.text, start, end)):
                self.comments.append((start, found[1]))
                _trail(entry, found[1])
        if style in {"|", ">"}:
            self.position = start + len(self.text[start:end].rstrip())
        elif not is_empty or not in_mapping:
            self.position = end

    def _start(self, event: Any, *, is_mapping: bool) -> None:
        start = event.start_mark.index
        self._take_comments(start)
        top = self.open[-1] if self.open else None
        line, column = event.start_mark.line, event.start_mark.column
        indent = -1
        if top is not None:
            indent = max(column, top.collection.indent + 1, 1)  # a list may start below its key's first letter
        collection = Collection(
            is_mapping, bool(event.flow_style), indent, start, start, file=self.file, line=line, column=column
        )
        owner = self._place(top, collection, start) if top else None
        if collection.flow:
            self.position = event.end_mark.index
        self.open.append(_OpenCollection(collection, owner))

    def _end(self, event: Any) -> None:
        self._take_comments(event.start_mark.index)
        done = self.open.pop()
        collection = done.collection
        if collection.flow:
            inside, self.pending = self.pending, []
            self.position = event.end_mark.index
            self.last = done.owner
            collection.end = event.end_mark.index
        else:
            inside = list(takewhile(lambda comment: comment.column >= collection.indent, self.pending))
            self.pending = self.pending[len(inside) :]
            collection.end = self.position
        if collection.entries or done.owner is None:
            collection.tail = _lines(inside)
        else:
            done.owner.before += _lines(inside)
        collection.has_comments = any(collection.tail) or any(
            any(entry.before) or entry.trailing or (isinstance(entry.value, Collection) and entry.value.has_comments)
            for entry in collection.entries
        )
        if not self.open:
            self.result = collection

    def _new_entry(self, top: _OpenCollection, key: Scalar | None, value: Node, start: int) -> Entry:
        before = _lines(self.pending)
        if self.text.count("\n", self.position, start) > 1:
            before.append("")
        self.pending = []
        entry = Entry(key, value, before)
        top.collection.entries.append(entry)
        top.waiting = entry if key is not None else None
        self.last = entry
        return entry

    def _place(self, top: _OpenCollection, value: Node, start: int) -> Entry:
        """Put a value behind the key that waits for it, or makes it an item."""
        entry = top.waiting
        if entry is None:
            return self._new_entry(top, None, value, start)
        entry.value, top.waiting = value, None
        if isinstance(value, Scalar) and self.pending:
            entry.before += [comment.text for comment in self.pending]
            self.pending = []
        self.last = entry
        return entry

    def _take_comments(self, until: int) -> None:
        """Take what stands between the last token and this place: every `#` there begins a comment."""
        if self.text.find("#", self.position, until) < 0:
            return
        for found in _COMMENT.finditer(self.text, self.position, until):
            start, text = found.start(), found[0]
            self.comments.append((start, text))
            newlines = self.text.count("\n", self.position, start)
            if newlines == 0 and self.last is not None:
                _trail(self.last, text)
            else:
                column = start - (self.text.rfind("\n", 0, start) + 1)
                self.pending.append(_Comment(text, column, blank_above=newlines > 1))
            self.position = found.end()


def _trail(entry: Entry, comment: str) -> None:
    """Move an earlier trailing comment above the line: a line has only one."""
    if entry.trailing:
        entry.before.append(entry.trailing)
    entry.trailing = comment.rstrip()


def _lines(comments: list[_Comment]) -> list[str]:
    lines: list[str] = []
    for comment in comments:
        lines += ["", comment.text.rstrip()] if comment.blank_above else [comment.text.rstrip()]
    return lines
