"""One pass over PyYAML's events: plain values out of text, and where each stands; it stops at the first excess.

A plain word means what YAML 1.2's core schema says: `no` is a text, `0640` is 640.

Nothing else sees unchecked text. `rarms validate` spends its time here: so it is one loop over locals, and of each
key and value it notes two numbers, from which `tree.py` makes a tree when there is something to report, to merge or to
write.
"""

import math
import re
from dataclasses import dataclass, field, replace
from functools import lru_cache
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

from rarms_iac.manifest.text.characters import Source, UnreadableText, syntax_finding, unseen
from rarms_iac.manifest.text.tree import ManifestPlaces, Spans, Tree, build_tree, dotted
from rarms_iac.model.diagnostics import Diagnostic, Place, Related
from rarms_iac.texts.findings import NOT_YAML
from rarms_iac.texts.messages import HIDDEN

MAX_DEPTH = 32
MAX_NODES = 400_000
MAX_SCALAR = 64 * 2**10  # characters


_NO_KEY: Final = object()
_MOST = 20  # cases shown of one kind of problem

MAX_DIGITS = 15
"""Digits of a whole number: every program that reads JSON keeps so many."""

PlainValue = bool | int | float | str | None

_WORDS: dict[str, bool | None] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_MAY_BE_MORE = frozenset(("", *"0123456789+-.~nNtTfF"))
"""How words begin that may mean more than their text."""

_DECIMAL = re.compile(r"[-+]?[0-9]+")
_OCTAL = re.compile(r"0o[0-7]+")
_HEXADECIMAL = re.compile(r"0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")


class NotRepresentable(ValueError):
    """Not a YAML text that rarms reads; the message says why."""


@lru_cache(maxsize=4096)
def plain_scalar(text: str) -> PlainValue:
    """Return the value of a word without quotes.

    Raises:
        NotRepresentable: a number of more than 15 digits, an infinite one, or none at all (`.nan`).
    """
    if text in _WORDS:
        return _WORDS[text]
    if _DECIMAL.fullmatch(text):
        return _whole(text, 10)
    if _OCTAL.fullmatch(text):
        return _whole(text[2:], 8)
    if _HEXADECIMAL.fullmatch(text):
        return _whole(text[2:], 16)
    if _FLOAT.fullmatch(text):
        return _finite(text)
    if _NOT_FINITE.fullmatch(text):
        raise NotRepresentable(f"{text} cannot be compared with other numbers")
    return text


def _whole(digits: str, base: int) -> int:
    if len(digits.lstrip("+-0")) > MAX_DIGITS:
        raise NotRepresentable(
            f"a whole number has at most {MAX_DIGITS} digits; this number has {len(digits.lstrip('+-'))}"
        )
    return int(digits, base)


def _finite(text: str) -> int | float:
    value = float(text)
    if not math.isfinite(value):
        raise NotRepresentable("it is too large")
    # 2.0 is the whole number 2, as JSON Schema has it.
    return int(value) if value.is_integer() and abs(value) < 10**MAX_DIGITS else value


@dataclass(frozen=True, slots=True, kw_only=True)
class ParsedText:
    """A text and its values; `value` is worth reading only where `readable`."""

    source: Source
    value: Any = None
    spans: Spans = field(default_factory=Spans, repr=False)
    readable: bool  # nothing was refused: the values are what the text says
    diagnostics: tuple[Diagnostic, ...]
    is_missing: bool = False  # the file does not exist

    def tree(self) -> Tree:
        """Return the tree of a readable text; it is built at each call."""
        return build_tree(self.source, self.value, self.spans)


def read_events(source: Source) -> ParsedText:
    """Read checked text as plain values (dict, list, text, number, truth, None), keys as written.

    A key that occurs twice keeps its first value, and is an error in `diagnostics`.

    Raises:
        UnreadableText: it is not YAML, or passes a limit; nothing after that place was looked at.
    """
    if source.text.count("#") > MAX_NODES:
        raise UnreadableText(_too_many_comments(source))
    try:
        return _Pass(source).run(CParser(source.text))
    except YAMLError as problem:
        if "nesting depth" in str(getattr(problem, "problem", "")):  # libyaml 0.2.6 stops at 1,000, looking ahead
            mark: Any = getattr(problem, "problem_mark", None)
            return read_events(replace(source, text=source.text[: mark.index]))  # and here the limit of rarms ends it
        raise UnreadableText(syntax_finding(problem, source)) from None


class _Pass:
    """The state of one pass, and the findings it makes; the loop itself keeps to locals."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.spans = Spans()
        self.duplicates: list[tuple[tuple[str | int, ...], Place]] = []  # path of a key, its later place
        self.problems: list[Diagnostic] = []
        self.stack: list[tuple[Any, Any, int]] = []  # the containers around: key or _NO_KEY, number
        self.counts: dict[str, int] = {}

    def run(self, parser: Any) -> ParsedText:
        # NOTE: long and flat on purpose. Every call saved here is 40,000 calls saved for 1,000 components.
        get_event, stack, resolve = parser.get_event, self.stack, plain_scalar
        may_be_more, most_nodes, longest = _MAY_BE_MORE, MAX_NODES, MAX_SCALAR
        starts, ends = self.spans.starts, self.spans.ends
        begins, stops = starts.append, ends.append
        may_have_marks = "!" in self.source.text or "&" in self.source.text
        root: list[Any] = []
        container: Any = root
        key: Any = _NO_KEY
        number = nodes = documents = 0
        while (event := get_event()) is not None:
            kind = type(event)
            if kind is ScalarEvent:
                nodes += 1
                begins(event.start_mark.index)
                stops(event.end_mark.index)
                text = event.value
                style = event.style
                if nodes > most_nodes or len(text) > longest:
                    raise UnreadableText(self.excess(event, nodes))
                if may_have_marks and (event.tag is not None or event.anchor is not None):
                    self.refuse_marks(event)
                if style == '"' and HIDDEN.search(text):
                    self.escape(event)
                if key is _NO_KEY and type(container) is dict:
                    if style == "" and text == "<<":
                        self.refuse(event, "merge keys (<<)", "Write the keys themselves.")
                    key = text if text not in container else self.same_key(event, text)
                    continue
                value: Any = text
                if style == "" and text[:1] in may_be_more:
                    try:
                        value = resolve(text)
                    except NotRepresentable as problem:
                        self.not_representable(event, problem)
            elif kind is MappingStartEvent or kind is SequenceStartEvent:
                nodes += 1
                if nodes > MAX_NODES or len(stack) >= MAX_DEPTH:
                    raise UnreadableText(self.excess(event, nodes))
                if may_have_marks and (event.tag is not None or event.anchor is not None):
                    self.refuse_marks(event)
                if key is _NO_KEY and type(container) is dict:
                    raise UnreadableText(self.not_a_key(event))
                stack.append((container, key, number))
                number = len(starts)
                begins(event.start_mark.index)
                stops(0)
                container = {} if kind is MappingStartEvent else []
                key = _NO_KEY
                continue
            elif kind is MappingEndEvent or kind is SequenceEndEvent:
                value = container
                ends[number] = event.start_mark.index
                container, key, number = stack.pop()
            elif kind is AliasEvent:
                nodes += 1
                begins(event.start_mark.index)
                stops(event.end_mark.index)
                if nodes > MAX_NODES:
                    raise UnreadableText(self.excess(event, nodes))
                self.refuse(event, "aliases (*name)", "Write the value itself.")
                value = None
                if key is _NO_KEY and type(container) is dict:
                    key = "*" if "*" not in container else _RepeatedKey("*", len(starts) - 1)
                    continue
            else:
                if kind is DocumentStartEvent:
                    documents += 1
                    self.start_document(event, documents)
                continue
            if key is _NO_KEY:
                container.append(value)
            elif type(key) is str:
                container[key] = value
                key = _NO_KEY
            else:
                del starts[key.number :], ends[key.number :]
                key = _NO_KEY
        value = root[0] if root else None
        return ParsedText(
            source=self.source,
            value=value,
            spans=self.spans,
            readable=not self.problems,
            diagnostics=(*self.problems, *self.same_keys(value)),
        )

    def start_document(self, event: DocumentStartEvent, documents: int) -> None:
        if documents > 1:
            self.refuse(event, "several documents in one file", "Put each document into its own file.")
            raise UnreadableText(*self.problems)
        if event.tags or (event.version or (1, 2)) != (1, 2):
            self.refuse(event, "directives other than %YAML 1.2", "Remove the line.")

    def refuse_marks(self, event: Any) -> None:
        if event.anchor is not None:
            self.refuse(event, "anchors (&name)", "Remove the anchor, and write the value at each place.")
        if event.tag is not None:
            self.refuse(event, "tags (!name)", "Remove the tag: the type of each field is fixed.")

    def refuse(self, event: Any, refused: str, advice: str) -> None:
        if not self.is_shown_enough(refused):
            place = self.place(event)
            self.problems.append(NOT_YAML.at(place, "rarms does not read {refused}.", advice, refused=refused))

    def is_shown_enough(self, refused: str) -> bool:
        self.counts[refused] = self.counts.get(refused, 0) + 1
        return self.counts[refused] > _MOST

    def place(self, event: Any, length: int = 1) -> Place:
        return self.source.place(event.start_mark.index, length)

    def path(self) -> tuple[str | int, ...]:
        inner = [len(container) if key is _NO_KEY else key for container, key, _ in self.stack[1:]]
        return tuple(step.text if isinstance(step, _RepeatedKey) else step for step in inner)

    def same_key(self, event: ScalarEvent, text: str) -> "_RepeatedKey":
        if not self.is_shown_enough("same key"):
            self.duplicates.append(((*self.path(), text), self.place(event, len(text))))
        return _RepeatedKey(text, len(self.spans.starts) - 1)

    def same_keys(self, value: Any) -> list[Diagnostic]:
        places = ManifestPlaces(lambda: build_tree(self.source, value, self.spans).root)
        return [
            NOT_YAML.at(
                replace(later, path=dotted(path)),
                "{path} is also on line {first_line}.",
                "Remove one of the two.",
                related=(Related(place=places.key(*path), message="the first one"),),
                path=dotted(path),
                first_line=places.key(*path).line,
            )
            for path, later in self.duplicates
        ]

    def not_representable(self, event: ScalarEvent, problem: NotRepresentable) -> None:
        if not self.is_shown_enough("number"):
            advice = "Write another number, or put a text in quotes."
            self.problems.append(
                NOT_YAML.at(
                    self.place(event, len(event.value)),
                    "rarms cannot represent this number exactly: {reason}.",
                    advice,
                    number=event.value,
                    reason=str(problem),
                )
            )

    def escape(self, event: ScalarEvent) -> None:
        found = HIDDEN.search(event.value)
        if found and not self.is_shown_enough("escape"):
            self.problems.append(unseen(found.group(), self.place(event)))

    def not_a_key(self, event: Any) -> Diagnostic:
        return NOT_YAML.at(
            self.place(event),
            "A map or a list cannot be a key. A key must be a text.",
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
            most, detail = MAX_SCALAR, "A text has at most {most:,} characters. This text has more."
            advice = "Put the text into its own file."
        return NOT_YAML.at(self.place(event), detail, advice, most=most)


def _too_many_comments(source: Source) -> Diagnostic:
    """Refuse too many comments: each costs as much as a value; signs within texts count, too."""
    first_beyond = next(islice(re.finditer("#", source.text), MAX_NODES, None))  # the caller counted that many
    return NOT_YAML.at(
        source.place(first_beyond.start()),
        "A manifest has at most {most:,} number signs (#). This file has more.",
        "Remove comments that are not needed.",
        most=MAX_NODES,
    )


@dataclass(frozen=True, slots=True)
class _RepeatedKey:
    """Stands for a key that is there already: its value is read and dropped."""

    text: str
    number: int  # of its span
