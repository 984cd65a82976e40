"""One pass over PyYAML's events: plain values out of text, which stops at the first excess.

It is the only thing that sees unchecked text, and it is what `rarms validate` spends its time in: so it is one
loop over locals, makes nothing but the values, and remembers no positions (`nodes.py` finds those again when
something is to be told).
"""

from dataclasses import dataclass, field
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

from rarms_iac.manifest.characters import HIDDEN, hidden, place_of
from rarms_iac.manifest.limits import MAX_DEPTH, MAX_NODES, MAX_SCALAR, NOT_ALLOWED, NOT_KEPT, NOT_YAML, TOO_MUCH
from rarms_iac.manifest.opening import Refused
from rarms_iac.manifest.scalars import NotKept, plain_scalar
from rarms_iac.manifest.syntax import said_plainly
from rarms_iac.model.diagnostics import Diagnostic, Place

_NO_KEY: Final = object()
_MOST = 20  # cases shown of one kind of problem


@dataclass(slots=True)
class Read:
    """What one pass found."""

    value: Any = None
    twice: list[tuple[tuple[str | int, ...], Place]] = field(default_factory=list)  # path of the key, later place
    problems: list[Diagnostic] = field(default_factory=list)


def read_events(data: bytes, file: str) -> Read:
    """Plain values (dict, list, text, number, truth, None) of checked bytes, keys as written.

    A key that comes twice keeps its first value and is told in `twice`.

    Raises:
        Refused: it is not YAML, or passes a limit; nothing after that place was looked at.
    """
    try:
        return _Pass(file).run(CParser(data))
    except YAMLError as problem:
        raise Refused(_syntax(problem, data, file)) from None


class _Pass:
    """The state of one pass, and what it says when something is wrong; the loop itself keeps to locals."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.read = Read()
        self.stack: list[tuple[Any, Any]] = []  # the containers around, each with the key or _NO_KEY
        self.said: dict[str, int] = {}

    def run(self, parser: Any) -> Read:
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
                    raise Refused(self.excess(event, nodes))
                if event.tag is not None or event.anchor is not None:
                    self.refuse_marks(event)
                if style == '"' and HIDDEN.search(text):
                    self.escape(event)
                if type(container) is dict and key is _NO_KEY:
                    if style == "" and text == "<<":
                        self.refuse(event, "merge keys (<<)", "Write the keys out.")
                    if text in container:
                        self.same_key(event, text)
                        text = _Twice(text)
                    key = text
                    continue
                value: Any = text
                if style == "":
                    try:
                        value = resolve(text)
                    except NotKept as problem:
                        self.not_kept(event, problem)
            elif kind is MappingStartEvent or kind is SequenceStartEvent:
                nodes += 1
                if nodes > MAX_NODES or len(stack) >= MAX_DEPTH:
                    raise Refused(self.excess(event, nodes))
                if event.tag is not None or event.anchor is not None:
                    self.refuse_marks(event)
                if type(container) is dict and key is _NO_KEY:
                    raise Refused(self.not_a_key(event))
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
                    raise Refused(self.excess(event, nodes))
                self.refuse(event, "aliases (*name)", "Write the value out.")
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
        self.read.value = root[0] if root else None
        return self.read

    def start_document(self, event: DocumentStartEvent, documents: int) -> None:
        if documents > 1:
            self.refuse(event, "several documents in one file", "Put each into a file of its own.")
            raise Refused(*self.read.problems)
        if event.tags or (event.version or (1, 2)) != (1, 2):
            self.refuse(event, "directives other than %YAML 1.2", "Remove the line.")

    def refuse_marks(self, event: Any) -> None:
        if event.anchor is not None:
            self.refuse(event, "anchors (&name)", "Remove it, and write the value out where it is wanted.")
        if event.tag is not None:
            self.refuse(event, "tags (!name)", "Remove the tag: a field knows its own type.")

    def refuse(self, event: Any, what: str, advice: str) -> None:
        if self.often_said(what):
            return
        self.read.problems.append(
            NOT_ALLOWED.at(
                place_at(event.start_mark, self.file),
                f"rarms does not read {what}: a manifest says everything where it stands.",
                advice,
            )
        )

    def often_said(self, what: str) -> bool:
        self.said[what] = self.said.get(what, 0) + 1
        return self.said[what] > _MOST

    def path(self) -> tuple[str | int, ...]:
        inner = [len(container) if key is _NO_KEY else key for container, key in self.stack[1:]]
        return tuple(str(step) if isinstance(step, _Twice) else step for step in inner)

    def same_key(self, event: ScalarEvent, text: str) -> None:
        if not self.often_said("same key"):
            self.read.twice.append(((*self.path(), text), place_at(event.start_mark, self.file, len(text))))

    def not_kept(self, event: ScalarEvent, problem: NotKept) -> None:
        if not self.often_said("not kept"):
            place = place_at(event.start_mark, self.file, len(event.value))
            advice = "Write a number that can be kept, or put it into quotes if it is a text."
            self.read.problems.append(NOT_KEPT.at(place, f"The number cannot be kept: {problem}.", advice))

    def escape(self, event: ScalarEvent) -> None:
        found = HIDDEN.search(event.value)
        if found and not self.often_said("escape"):
            self.read.problems.append(hidden(found.group(), place_at(event.start_mark, self.file)))

    def not_a_key(self, event: Any) -> Diagnostic:
        return NOT_ALLOWED.at(
            place_at(event.start_mark, self.file),
            "A map or a list stands where a key is expected; a key is a text.",
            "Write a name there, followed by a colon.",
        )

    def excess(self, event: Any, nodes: int) -> Diagnostic:
        place = place_at(event.start_mark, self.file)
        if nodes > MAX_NODES:
            return TOO_MUCH.at(
                place, f"A manifest has at most {MAX_NODES:,} values; here is one more.", "Split it into several."
            )
        if len(self.stack) >= MAX_DEPTH:
            return TOO_MUCH.at(
                place, f"A manifest nests at most {MAX_DEPTH} levels deep.", "Check for brackets that are not closed."
            )
        return TOO_MUCH.at(
            place, f"A text has at most {MAX_SCALAR:,} characters; this one has more.", "Put it into a file."
        )


class _Twice:
    """Stands for a key that is there already: its value is read and dropped."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __str__(self) -> str:
        return self.text


def place_at(mark: Any, file: str, length: int = 1) -> Place:
    """A parser's position (from 0) as ours (from 1)."""
    return Place(file=file, line=mark.line + 1, column=mark.column + 1, length=max(1, length))


def _syntax(problem: YAMLError, data: bytes, file: str) -> Diagnostic:
    mark = getattr(problem, "problem_mark", None) or getattr(problem, "context_mark", None)
    said = str(getattr(problem, "problem", ""))
    if mark is not None and data.decode("utf-8")[mark.index : mark.index + 1] == "\t":
        said = "found a tab character"
    detail, advice = said_plainly(said, str(getattr(problem, "context", "") or ""))
    # The parser puts what is missing at the end onto a line of its own, which may not exist.
    end = place_of(data, len(data.rstrip()), file)
    place = end if mark is None or mark.line + 1 > end.line else place_at(mark, file)
    return NOT_YAML.at(place, detail, advice)
