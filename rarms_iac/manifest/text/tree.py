"""Values and spans of a text -> a tree of keys and values, with comments and blank lines; and the places of paths.

The parser drops comments: they are found between the spans that `events.py` noted. The builder fills the nodes while
it walks the values, so they are not frozen; nothing changes them later.
"""

import json
import re
from array import array
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import takewhile
from typing import Any

from rarms_iac.manifest.text.characters import Source
from rarms_iac.model.diagnostics import Place

_NO_SOURCE = Source(file="")


@dataclass(slots=True)
class Scalar:
    """A scalar: its text, and how it was written (`''` is plain, otherwise the first character of its style)."""

    text: str
    style: str = "'"
    value: Any = None  # of a text that was read: what it means
    start: int = 0  # characters from the beginning of the text
    end: int = 0
    source: Source = _NO_SOURCE

    @property
    def has_many_lines(self) -> bool:
        """Whether the text has it on several lines."""
        return "\n" in self.source.text[self.start : self.end]


@dataclass(slots=True)
class Collection:
    """A mapping, or a sequence (whose entries have no keys)."""

    is_mapping: bool
    flow: bool
    entries: "list[Entry]" = field(default_factory=list)
    indent: int = 0  # the column from which on a comment below an entry belongs to the collection
    start: int = 0
    end: int = 0
    source: Source = _NO_SOURCE
    tail: list[str] = field(default_factory=list)  # comments after the last entry; "" is a blank line
    has_comments: bool = False  # anywhere inside


@dataclass(slots=True)
class Entry:
    """A key with its value, or an item of a sequence."""

    key: Scalar | None
    value: "Scalar | Collection"
    before: list[str] = field(default_factory=list)  # comments above it; "" is a blank line
    trailing: str = ""  # the comment on its first line


Node = Scalar | Collection


@dataclass(frozen=True, slots=True)
class Tree:
    """A whole document; an empty one is an empty scalar."""

    root: Node
    source: Source
    comments: tuple[tuple[int, str], ...]  # all of them, each where it begins

    def comments_in(self, start: int, end: int) -> list[str]:
        """Return the comments that begin between two places, those behind `|` and `>` included."""
        return [comment.rstrip() for at, comment in self.comments if start <= at < end]


def entries_by_key(mapping: Collection) -> dict[str, Entry]:
    """Return the entries of a mapping."""
    return {entry.key.text: entry for entry in mapping.entries if entry.key is not None}


def place_of_node(node: Node) -> Place:
    """Return the place of the node's begin; a scalar on one line is underlined whole."""
    length = node.end - node.start if isinstance(node, Scalar) and not node.has_many_lines else 1
    return node.source.place(node.start, length)


def is_null(node: Node) -> bool:
    """Return whether the node is YAML's null: `null`, `~`, or nothing at all."""
    return isinstance(node, Scalar) and node.value is None


def plain(node: Node) -> Any:
    """Return the values alone, as `events.read_events` gives them."""
    if isinstance(node, Scalar):
        return node.value
    if node.is_mapping:
        return {key: plain(entry.value) for key, entry in entries_by_key(node).items()}
    return [plain(entry.value) for entry in node.entries]


@dataclass(frozen=True, slots=True)
class Spans:
    """The begin and end of each key and value, in characters, in the order of the text.

    Where a map or a list ends, the next part of the text begins, or its closing bracket. A key that occurs again, and
    its value, are left out.
    """

    starts: "array[int]" = field(default_factory=lambda: array("I"))
    ends: "array[int]" = field(default_factory=lambda: array("I"))


_COMMENT = re.compile("#[^\n]*")
_HEADER_COMMENT = re.compile("[|>][-+0-9]*[ \\t]+(#[^\\n]*)")


def build_tree(source: Source, value: Any, spans: Spans) -> Tree:
    """Build the tree of a text that was read without problems."""
    if not spans.starts:
        return Tree(Scalar("", "", source=source), source, ())
    return _Builder(source, spans).tree(value)


@dataclass(slots=True)
class _Comment:
    text: str
    column: int
    blank_above: bool


class _Builder:
    """Walks the values once; comments on the way wait until a key or an item takes them."""

    def __init__(self, source: Source, spans: Spans) -> None:
        self.source = source
        self.text = source.text
        self.spans = zip(spans.starts, spans.ends, strict=True)
        self.comments: list[tuple[int, str]] = []
        self.pending: list[_Comment] = []  # comments of their own lines, not yet anybody's
        self.position = 0  # end of the last token or comment
        self.last: Entry | None = None  # whose line we are on

    def tree(self, value: Any) -> Tree:
        """Return the whole document."""
        root = self._node(value, None, None)
        self._take_comments(len(self.text) + 1)
        if isinstance(root, Collection):
            root.tail += _lines(self.pending)
        return Tree(root, self.source, tuple(self.comments))

    def _node(self, value: Any, around: Collection | None, waiting: Entry | None) -> Node:
        """Read a value into the entry of the key that waits for it, or into an item of the list around it."""
        start, end = next(self.spans)
        if isinstance(value, dict | list):
            return self._collection(value, start, end, around, waiting)
        if start < end or waiting is None:  # the place of an empty value of a key may lie beyond what follows it
            self._take_comments(start)
        scalar = self._scalar(value, start, end)
        if around is None:
            return scalar
        entry = self._placed(scalar, around, waiting)
        if self.pending:
            entry.before += [comment.text for comment in self.pending]
            self.pending = []
        if scalar.style in {"|", ">"} and (found := _HEADER_COMMENT.match(self.text, start, end)):
            self.comments.append((start, found[1]))
            _trail(entry, found[1])
        if start < end or waiting is None:
            self.position = self._end_of(scalar)
        return scalar

    def _scalar(self, value: Any, start: int, end: int) -> Scalar:
        text = value if isinstance(value, str) else self.text[start:end]
        first = self.text[start] if start < end else ""
        return Scalar(text, first if first in "'\"|>" else "", value, start, end, self.source)

    def _collection(
        self, value: dict[str, Any] | list[Any], start: int, end: int, around: Collection | None, waiting: Entry | None
    ) -> Collection:
        self._take_comments(start)
        has_bracket = self.text[start] in "[{"
        flow = has_bracket or (around is not None and around.flow)  # `[a: 1]` has a map without a bracket
        # A list may start below its key's first letter.
        indent = -1 if around is None else max(self._column(start), around.indent + 1, 1)
        node = Collection(isinstance(value, dict), flow, [], indent, start, source=self.source)
        owner = self._placed(node, around, waiting) if around else None
        if flow:
            self.position = start + has_bracket
        if isinstance(value, dict):
            for key, each in value.items():
                self._node(each, node, self._key(key, node))
        else:
            for each in value:
                self._node(each, node, None)
        self._take_comments(end)
        if flow:
            inside, self.pending = self.pending, []
            self.position, self.last = end + has_bracket, owner
        else:
            inside = list(takewhile(lambda comment: comment.column >= indent, self.pending))
            self.pending = self.pending[len(inside) :]
        node.end = self.position
        if node.entries or owner is None:
            node.tail = _lines(inside)
        else:
            owner.before += _lines(inside)
        node.has_comments = any(node.tail) or any(
            any(entry.before) or entry.trailing or (isinstance(entry.value, Collection) and entry.value.has_comments)
            for entry in node.entries
        )
        return node

    def _key(self, key: str, mapping: Collection) -> Entry:
        start, end = next(self.spans)
        if start < end:
            self._take_comments(start)
        scalar = self._scalar(key, start, end)
        entry = self._new_entry(scalar, scalar, mapping)
        if start < end:
            self.position = self._end_of(scalar)
        return entry

    def _end_of(self, scalar: Scalar) -> int:
        """Return the end of the text; line ends below a block are not part of it."""
        if scalar.style in {"|", ">"}:
            return scalar.start + len(self.text[scalar.start : scalar.end].rstrip())
        return scalar.end

    def _new_entry(self, key: Scalar | None, value: Node, around: Collection) -> Entry:
        before = _lines(self.pending)
        if self.text.count("\n", self.position, value.start) > 1:
            before.append("")
        self.pending = []
        entry = Entry(key, value, before)
        around.entries.append(entry)
        self.last = entry
        return entry

    def _placed(self, value: Node, around: Collection, waiting: Entry | None) -> Entry:
        """Put a value behind the key that waits for it, or make it an item."""
        if waiting is None:
            return self._new_entry(None, value, around)
        waiting.value = value
        self.last = waiting
        return waiting

    def _column(self, at: int) -> int:
        return at - (self.text.rfind("\n", 0, at) + 1)

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
                self.pending.append(_Comment(text, self._column(start), blank_above=newlines > 1))
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


_SIMPLE_KEY = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_ -]{0,80}")


def dotted(path: tuple[str | int, ...]) -> str:
    """Return a path as people write it: `hosts.onboard.memory`, `components.vision.apart[0]`."""
    text = ""
    for step in path:
        if isinstance(step, int):
            text += f"[{step}]"
        else:
            shown = step if _SIMPLE_KEY.fullmatch(step) else json.dumps(step[:80])
            text += f".{shown}" if text else shown
    return text


class ManifestPlaces:
    """`model.diagnostics.Places` over the tree of a manifest and its overlays; places are those after overlays."""

    def __init__(self, read: Callable[[], Node]) -> None:
        self._root = cache(read)
        self._entries: dict[int, dict[str, Entry]] = {}  # of each mapping that was asked for, by its identity

    def value(self, *path: str | int) -> Place:
        """Return the place of the value at this path; the key of its nearest parent where it does not exist."""
        node, key, steps = self._walk(path)
        return _at(node if steps == len(path) or key is None else key, path)

    def key(self, *path: str | int) -> Place:
        """Return the place of the key at this path, or of the item of a list; of its nearest parent's likewise."""
        node, key, _ = self._walk(path)
        return _at(node if key is None else key, path)

    def text(self, *path: str | int) -> str:
        """Return the text of the scalar without quotes at this path: `3.10`, of which the value is 3.1."""
        node, _, steps = self._walk(path)
        return node.text if steps == len(path) and isinstance(node, Scalar) and not node.style else ""

    def _walk(self, path: tuple[str | int, ...]) -> tuple[Node, Node | None, int]:
        """Return the last node on the path, its key (of a list: the item), and the number of steps found."""
        node = self._root()
        key: Node | None = None
        for steps, step in enumerate(path):
            entry = self._entry(node, step)
            if entry is None:
                return node, key, steps
            node, key = entry.value, entry.key or entry.value
        return node, key, len(path)

    def _entry(self, node: Node, step: str | int) -> Entry | None:
        match node, step:
            case Collection(is_mapping=True), str():
                if id(node) not in self._entries:
                    self._entries[id(node)] = entries_by_key(node)
                return self._entries[id(node)].get(step)
            case Collection(is_mapping=False, entries=entries), int() if 0 <= step < len(entries):
                return entries[step]
            case _:
                return None


def _at(node: Node, path: tuple[str | int, ...]) -> Place:
    return replace(place_of_node(node), path=dotted(path))


def first_line(file: str) -> ManifestPlaces:
    """Return the places of a manifest that could not be read at all: its first line."""
    return ManifestPlaces(lambda: Scalar("", source=Source(file=file)))
