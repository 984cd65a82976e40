"""The same text once more, with the position of every key and value: made only when something is to be told.

It reads text that `events.read_events` has checked, so it may trust sizes and features.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from yaml._yaml import CParser
from yaml.events import (
    AliasEvent,
    DocumentStartEvent,
    MappingEndEvent,
    MappingStartEvent,
    ScalarEvent,
    SequenceEndEvent,
    SequenceStartEvent,
    StreamStartEvent,
)

from rarms_iac.manifest.events import place_at
from rarms_iac.manifest.scalars import NotKept, Scalar, plain_scalar
from rarms_iac.manifest.source import Source
from rarms_iac.model.diagnostics import Place


@dataclass(frozen=True, slots=True)
class Leaf:
    """A scalar and where it stands."""

    place: Place
    source: Source
    value: Scalar


@dataclass(frozen=True, slots=True)
class Items:
    """A list and where it starts."""

    place: Place
    source: Source
    items: "tuple[Node, ...]"


@dataclass(frozen=True, slots=True)
class Entry:
    """A key's place and its value."""

    key: Place
    node: "Node"


@dataclass(frozen=True, slots=True)
class Branch:
    """A map and where it starts."""

    place: Place
    source: Source
    entries: dict[str, Entry]


Node = Leaf | Items | Branch


def read_nodes(source: Source) -> Node:
    """The positions in a text that was read before."""
    events: Iterator[Any] = iter(CParser(source.data).get_event, None)
    first = next(events)
    while isinstance(first, StreamStartEvent | DocumentStartEvent):
        first = next(events)
    return _node(first, events, source)


def _node(event: Any, events: Iterator[Any], source: Source) -> Node:
    match event:
        case ScalarEvent():
            return _leaf(event, source)
        case MappingStartEvent():
            return Branch(place_at(event.start_mark, source.file), source, _entries(events, source))
        case SequenceStartEvent():
            return Items(place_at(event.start_mark, source.file), source, tuple(_items(events, source)))
        case _:  # an alias, which is told and stands for nothing
            return Leaf(place_at(event.start_mark, source.file), source, None)


def _leaf(event: Any, source: Source) -> Leaf:
    on_one_line = event.start_mark.line == event.end_mark.line
    length = event.end_mark.column - event.start_mark.column if on_one_line else 1
    place = place_at(event.start_mark, source.file, length)
    try:
        return Leaf(place, source, event.value if event.style else plain_scalar(event.value))
    except NotKept:  # told when it was read
        return Leaf(place, source, None)


def _entries(events: Iterator[Any], source: Source) -> dict[str, Entry]:
    entries: dict[str, Entry] = {}
    while not isinstance(key := next(events), MappingEndEvent):
        entry = Entry(_leaf(key, source).place, _node(next(events), events, source))
        name = "*" if isinstance(key, AliasEvent) else key.value
        entries.setdefault(name, entry)
    return entries


def _items(events: Iterator[Any], source: Source) -> Iterator[Node]:
    while not isinstance(event := next(events), SequenceEndEvent):
        yield _node(event, events, source)


def plain(node: Node) -> Any:
    """The values alone, as `events.read_events` gives them."""
    match node:
        case Leaf(value=value):
            return value
        case Items(items=items):
            return [plain(item) for item in items]
        case Branch(entries=entries):
            return {key: plain(entry.node) for key, entry in entries.items()}
