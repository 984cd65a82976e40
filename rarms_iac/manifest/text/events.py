"""One pass over PyYAML's events: plain values out of text, which stops at the first excess.

It is the only thing that sees unchecked text, and it is what `rarms validate` spends its time in: so it is one
loop over locals, makes nothing but the values, and remembers no positions (`tree.py` finds those again when
there is something to report). NOTE: one pass for both was tried: nodes with places, and the values read from them, take
66 ms for 1,000 components where this takes 36 and PyYAML's C loader 120.
"""

import re
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, Final

from yaml._yaml import CParser
from yaml.error import YAMLError
from yaml.events import (
    AliasEvent,
    DocumentStartEvent,
    MappingEndEvent,
    MappingStartEvent,
    ScalarEvent,
    SequenceEndEvent,
    SequenceStartEvent,
)

from rarms_iac.manifest.text.characters import UnreadableText, hidden, place_at, place_of
from rarms_iac.manifest.text.scalars import NotRepresentable, plain_scalar
from rarms_iac.manifest.text.syntax import syntax_finding
from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.model.shared_findings import NOT_YAML
from rarms_iac.model.wording import HIDDEN

MAX_DEPTH = 32
MAX_NODES = 400_000
MAX_SCALAR = 64 * 2**10  # characters


_NO_KEY: Final = object()
_MOST = 20  # cases shown of one kind of problem


DuplicateKey = tuple[tuple[str | int, ...], Place]
"""The path of a key and its later place."""


@dataclass(slots=True)
class EventValues:
    """What one pass found: the values, the keys that occur twice, and everything that rarms does not read."""

    value: Any = None
    duplicates: list[DuplicateKey] = field(default_factory=list)
    problems: list[Diagnostic] = field(default_factory=list)


def read_events(data: bytes, file: str) -> EventValues:
    """Plain values (dict, list, text, number, truth, None) of checked bytes, keys as written.

    A key that occurs twice keeps its first value and is listed in `duplicates`.

    Raises:
        UnreadableText: it is not YAML, or passes a limit; nothing after that place was looked at.
    """
    if data.count(b"#") > MAX_NODES:
        raise UnreadableText(_too_many_comments(data, file))
    try:
        return _Pass(file).run(CParser(data))
    except YAMLError as problem:
        if "nesting depth" in str(getattr(problem, "problem", "")):  # libyaml 0.2.6 stops at 1,000, looking ahead
            mark: Any = getattr(problem, "problem_mark", None)
            return read_events(data.decode("utf-8")[: mark.index].encode(), file)  # and here the limit of rarms ends it
        raise UnreadableText(syntax_finding(problem, data, file)) from None


class _Pass:
    """The state of one pass, and the findings it makes; the loop itself keeps to locals."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.values = EventValues()
        self.stack: list[tuple[Any, Any]] = []  # the containers around, each with the key or _NO_KEY
        self.counts: dict[str, int] = {}

    def run(self, parser: Any) -> EventValues:
        # NOTE: long and flat on purpose. Every call saved here is 40,000 calls saved for 1,000 components.
        get_event, stack, resolve = parser.get_event, self.stack, plain_scalar
        root: list[Any] = []
        container: Any = root
        key: Any = _NO_KEY
        nodes = documents = 0
        while (event := get_event()) is not None:
            kind = type(event)
            if kind is ScalarEvent:
                nodes += 1
                text = event.value
                style = event.style
                if nodes > MAX_NODES or len(text) > MAX_SCALAR:
                    raise UnreadableText(self.excess(event, nodes))
                if event.tag is not None or event.anchor is not None:
                    self.refuse_marks(event)
                if style == '"' and HIDDEN.search(text):
                    self.escape(event)
                if type(container) is dict and key is _NO_KEY:
                    if style == "" and text == "<<":
                        self.refuse(event, "merge keys (<<)", "Write the keys themselves.")
                    if text in container:
                        self.same_key(event, text)
                        text = _RepeatedKey(text)
                    key = text
                    continue
                value: Any = text
                if style == "":
                    try:
                        value = resolve(text)
                    except NotRepresentable as problem:
                        self.not_representable(event, problem)
            elif kind is MappingStartEvent or kind is SequenceStartEvent:
                nodes += 1
                if nodes > MAX_NODES or len(stack) >= MAX_DEPTH:
                    raise UnreadableText(self.excess(event, nodes))
                if event.tag is not None or event.anchor is not None:
                    self.refuse_marks(event)
                if type(container) is dict and key is _NO_KEY:
                    raise UnreadableText(self.not_a_key(event))
                stack.append((container, key))
                container = {} if kind is MappingStartEvent else []
                key = _NO_KEY
                continue
            elif kind is MappingEndEvent or kind is SequenceEndEvent:
                value = container
                container, key = stack.pop()
            elif kind is AliasEvent:
                nodes += 1
                if nodes > MAX_NODES:
                    raise UnreadableText(self.excess(event, nodes))
                self.refuse(event, "aliases (*name)", "Write the value itself.")
                value = None
                if type(container) is dict and key is _NO_KEY:
                    key = "*"
                    continue
            else:
                if kind is DocumentStartEvent:
                    documents += 1
                    self.start_document(event, documents)
                continue
            if key is _NO_KEY:
                container.append(value)
            else:
                if type(key) is str:
                    container[key] = value
                key = _NO_KEY
        self.values.value = root[0] if root else None
        return self.values

    def start_document(self, event: DocumentStartEvent, documents: int) -> None:
        if documents > 1:
            self.refuse(event, "several documents in one file", "Put each into a file of its own.")
            raise UnreadableText(*self.values.problems)
        if event.tags or (event.version or (1, 2)) != (1, 2):
            self.refuse(event, "directives other than %YAML 1.2", "Remove the line.")

    def refuse_marks(self, event: Any) -> None:
        if event.anchor is not None:
            self.refuse(event, "anchors (&name)", "Remove it, and write the value in every place that needs it.")
        if event.tag is not None:
            self.refuse(event, "tags (!name)", "Remove the tag: a field knows its own type.")

    def refuse(self, event: Any, refused: str, advice: str) -> None:
        if self.is_shown_enough(refused):
            return
        self.values.problems.append(
            NOT_YAML.at(
                place_at(event.start_mark, self.file), "rarms does not read {refused}.", advice, refused=refused
            )
        )

    def is_shown_enough(self, refused: str) -> bool:
        self.counts[refused] = self.counts.get(refused, 0) + 1
        return self.counts[refused] > _MOST

    def path(self) -> tuple[str | int, ...]:
        inner = [len(container) if key is _NO_KEY else key for container, key in self.stack[1:]]
        return tuple(str(step) if isinstance(step, _RepeatedKey) else step for step in inner)

    def same_key(self, event: ScalarEvent, text: str) -> None:
        if not self.is_shown_enough("same key"):
            self.values.duplicates.append(((*self.path(), text), place_at(event.start_mark, self.file, len(text))))

    def not_representable(self, event: ScalarEvent, problem: NotRepresentable) -> None:
        if not self.is_shown_enough("number"):
            place = place_at(event.start_mark, self.file, len(event.value))
            advice = "Write another number, or put it into quotes if it is a text."
            self.values.problems.append(
                NOT_YAML.at(
                    place,
                    "rarms cannot represent this number exactly: {reason}.",
                    advice,
                    number=event.value,
                    reason=str(problem),
                )
            )

    def escape(self, event: ScalarEvent) -> None:
        found = HIDDEN.search(event.value)
        if found and not self.is_shown_enough("escape"):
            self.values.problems.append(hidden(found.group(), place_at(event.start_mark, self.file)))

    def not_a_key(self, event: Any) -> Diagnostic:
        return NOT_YAML.at(
            place_at(event.start_mark, self.file),
            "A map or a list is in the place of a key. A key must be a text.",
            "Write a name followed by a colon.",
            refused="a map or a list for a key",
        )

    def excess(self, event: Any, nodes: int) -> Diagnostic:
        if nodes > MAX_NODES:
            most, detail = MAX_NODES, "A manifest has at most {most:,} values. This file has more."
            advice = "Split it into several manifests."
        elif len(self.stack) >= MAX_DEPTH:
            most, detail = MAX_DEPTH, "A manifest has at most {most} levels of nesting. This file has more."
            advice = "Check for brackets that are not closed."
        else:
            most, detail = MAX_SCALAR, "A text has at most {most:,} characters. This one has more."
            advice = "Put the text into a file of its own."
        return NOT_YAML.at(place_at(event.start_mark, self.file), detail, advice, most=most)


def _too_many_comments(data: bytes, file: str) -> Diagnostic:
    """Each costs as much as a value; signs within texts are counted, too, since no event tells a comment."""
    first_beyond = next(islice(re.finditer(b"#", data), MAX_NODES, None))  # the caller counted that many
    return NOT_YAML.at(
        place_of(data, first_beyond.start(), file),
        "A manifest has at most {most:,} number signs (#). This file has more.",
        "Take out comments that say nothing.",
        most=MAX_NODES,
    )


class _RepeatedKey:
    """Stands for a key that is there already: its value is read and dropped."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __str__(self) -> str:
        return self.text
