"""Text -> tree. The parser forgets comments: they are what is left between its tokens, whose marks it tells."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import takewhile
from typing import Any

from rarms_iac.manifest.formatting.tree import Collection, Entry, Node, Scalar

_COMMENT = re.compile("#[^\\n\\x85\\u2028\\u2029]*")  # the parser breaks lines at these four
_HEADER_COMMENT = re.compile("[|>][-+0-9]*[ \\t]+(#[^\\n]*)")


def unified(text: str) -> str:
    """The text without a byte order mark, its lines ended by LF alone."""
    return text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")


def build_tree(text: str) -> Collection:
    """The document in `text`, as `unified` leaves it: one mapping that `reading.read_text` had nothing against."""
    return _Builder(text).root()


def comments_in(text: str, start: int, end: int) -> list[str]:
    """The comments that begin between two places of such a text, those behind `|` and `>` included."""
    found = [(comment.start, comment.text) for comment in _comments_between(text)]
    for event in _events(text):
        if getattr(event, "style", None) in {"|", ">"}:
            at = event.start_mark.index
            found += [(at, header[1]) for header in [_HEADER_COMMENT.match(text, at, event.end_mark.index)] if header]
    return [comment.rstrip() for at, comment in sorted(found) if start <= at < end]


def _events(text: str) -> Iterator[Any]:
    """The parser's events, made anew each time: a list of them would keep the garbage collector busier than we are."""
    from yaml._yaml import CParser

    return iter(CParser(text).get_event, None)


@dataclass(slots=True)
class _Comment:
    start: int
    text: str
    column: int = 0
    blank_above: bool = False


@dataclass(slots=True)
class _Open:
    """A collection that has not ended yet, and the key that waits for its value."""

    collection: Collection
    owner: Entry | None
    waiting: Entry | None = None


class _Builder:
    """Walks the events once; comments found on the way wait until somebody takes them."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.comments = _comments_between(text)
        self.next_comment = 0
        self.pending: list[_Comment] = []  # comments of their own lines, not yet anybody's
        self.seen = 0  # end of the last token or comment
        self.last: Entry | None = None  # whose line we are on
        self.open: list[_Open] = []
        self.result: Collection | None = None

    def root(self) -> Collection:
        """The whole document."""
        from yaml import CollectionEndEvent, MappingStartEvent, ScalarEvent, SequenceStartEvent

        for event in _events(self.text):
            match event:
                case ScalarEvent():
                    self._scalar(event)
                case MappingStartEvent():
                    self._start(event, is_mapping=True)
                case SequenceStartEvent():
                    self._start(event, is_mapping=False)
                case CollectionEndEvent():
                    self._end(event)
                case _:  # where stream and document begin and end
                    pass
        assert self.result is not None, "the text was checked: it holds one mapping"
        self._take_comments(len(self.text) + 1)
        self.result.tail += _lines(self.pending)
        return self.result

    def _scalar(self, event: Any) -> None:
        start, end = event.start_mark.index, event.end_mark.index
        style = event.style or ""
        is_empty = start == end
        top = self.open[-1] if self.open else None
        in_mapping = top is not None and top.collection.is_mapping
        if not is_empty or not in_mapping:  # the place of an empty value of a key may lie beyond what follows it
            self._take_comments(start)
        scalar = Scalar(event.value, style, start, end, event.start_mark.line != event.end_mark.line)
        assert top is not None, "the text was checked: its root is a mapping"
        if top.collection.is_mapping and top.waiting is None:
            self._new_entry(top, scalar, scalar, start)
        else:
            entry = self._place(top, scalar, start)
            if style in {"|", ">"} and (found := _HEADER_COMMENT.match(self.text, start, end)):
                _trail(entry, found[1])
        if style in {"|", ">"}:
            self.seen = start + len(self.text[start:end].rstrip())
        elif not is_empty or not in_mapping:
            self.seen = end

    def _start(self, event: Any, *, is_mapping: bool) -> None:
        start = event.start_mark.index
        self._take_comments(start)
        top = self.open[-1] if self.open else None
        column = event.start_mark.column
        if top is not None:
            column = max(column, top.collection.column + 1, 1)  # a list may start below its key's first letter
        collection = Collection(is_mapping, bool(event.flow_style), column if top else -1, start, start)
        owner = self._place(top, collection, start) if top else None
        if collection.flow:
            self.seen = event.end_mark.index
        self.open.append(_Open(collection, owner))

    def _end(self, event: Any) -> None:
        self._take_comments(event.start_mark.index)
        done = self.open.pop()
        collection = done.collection
        if collection.flow:
            inside, self.pending = self.pending, []
            self.seen = event.end_mark.index
            self.last = done.owner
            collection.end = event.end_mark.index
        else:
            inside = list(takewhile(lambda comment: comment.column >= collection.column, self.pending))
            self.pending = self.pending[len(inside) :]
            collection.end = self.seen
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

    def _new_entry(self, top: _Open, key: Scalar | None, value: Node, start: int) -> Entry:
        before = _lines(self.pending)
        if self.text.count("\n", self.seen, start) > 1:
            before.append("")
        self.pending = []
        entry = Entry(key, value, before)
        top.collection.entries.append(entry)
        top.waiting = entry if key is not None else None
        self.last = entry
        return entry

    def _place(self, top: _Open, value: Node, start: int) -> Entry:
        """Puts a value behind the key that waits for it, or makes it an item."""
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
        while self.next_comment < len(self.comments) and self.comments[self.next_comment].start < until:
            comment = self.comments[self.next_comment]
            self.next_comment += 1
            newlines = self.text.count("\n", self.seen, comment.start)
            if newlines == 0 and self.last is not None:
                _trail(self.last, comment.text)
            else:
                comment.column = comment.start - (self.text.rfind("\n", 0, comment.start) + 1)
                comment.blank_above = newlines > 1
                self.pending.append(comment)
            self.seen = comment.start + len(comment.text)


def _comments_between(text: str) -> list[_Comment]:
    """Every `#` outside a scalar begins a comment."""
    comments = []
    position = 0
    for start, end in [*_scalar_spans(text), (len(text), len(text))]:
        if start < position:
            continue  # an empty value, placed where its key ended
        if text.find("#", position, start) >= 0:
            comments += [_Comment(found.start(), found[0]) for found in _COMMENT.finditer(text, position, start)]
        position = end
    return comments


def _scalar_spans(text: str) -> Iterator[tuple[int, int]]:
    from yaml import ScalarEvent

    for event in _events(text):
        if type(event) is ScalarEvent:
            start: Any = event.start_mark  # the parser always marks; its types do not say so
            end: Any = event.end_mark
            yield start.index, end.index


def _trail(entry: Entry, comment: str) -> None:
    """A line has one trailing comment: an earlier one moves above."""
    if entry.trailing:
        entry.before.append(entry.trailing)
    entry.trailing = comment.rstrip()


def _lines(comments: list[_Comment]) -> list[str]:
    lines: list[str] = []
    for comment in comments:
        lines += ["", comment.text.rstrip()] if comment.blank_above else [comment.text.rstrip()]
    return lines
