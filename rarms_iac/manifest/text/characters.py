"""Bytes of a file -> text that shows what it is: UTF-8, LF, no invisible characters; and the places in it."""

import unicodedata
from codecs import BOM_UTF8
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import overload

from yaml.error import YAMLError

from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.texts.findings import NOT_READ, NOT_YAML, Finding
from rarms_iac.texts.messages import HIDDEN

UNSEEN = Finding.error("RARMS005", "An invisible character")

_UTF16_32 = (b"\xff\xfe", b"\xfe\xff", b"\x00\x00\xfe\xff")
_ASCII_CONTROL = bytes({*range(0x20), 0x7F} - set(b"\t\n\r"))
_MOST = 20  # places shown of a kind: a file full of them needs no million lines


class Lines(Sequence[str]):
    """The lines of a text without their ends; one that is shown is found by counting, however many there are."""

    def __init__(self, text: str) -> None:
        self._text = text

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> list[str]: ...
    def __getitem__(self, index: int | slice) -> str | list[str]:
        """Return the line at this index, counted from 0; IndexError past the end."""
        if isinstance(index, slice):
            return [self[at] for at in range(*index.indices(len(self)))]
        number = index + len(self) if index < 0 else index
        if not 0 <= number < len(self):
            raise IndexError(index)
        start = self._start_of(number)
        end = self._text.find("\n", start)
        return self._text[start : None if end < 0 else end]

    def __len__(self) -> int:
        """Return the number of lines."""
        return self._text.count("\n") + 1

    def _start_of(self, number: int) -> int:
        """Return the begin of a line, behind the end of the one before it."""
        text, least, most = self._text, 0, len(self._text)
        counted = 0  # line ends before `least`
        while least < most:
            middle = (least + most) // 2
            ends = counted + text.count("\n", least, middle)
            if ends < number:
                counted, least = ends + text.startswith("\n", middle), middle + 1
            else:
                most = middle
        return least


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """A file as it was read."""

    file: str  # as messages name it: with slashes, `<stdin>` for standard input
    folder: str = ""  # what its paths are relative to
    stored: bytes = field(default=b"", repr=False)  # as the file has them
    text: str = field(default="", repr=False)  # the same without a byte order mark, its lines ended by LF

    @property
    def lines(self) -> Lines:
        """The lines of the text."""
        return Lines(self.text)

    def place(self, at: int, length: int = 1) -> Place:
        """Return line and column of a character."""
        line_start = self.text.rfind("\n", 0, at) + 1
        line = self.text.count("\n", 0, line_start) + 1
        return Place(file=self.file, line=line, column=at - line_start + 1, length=max(1, length))


class UnreadableText(Exception):
    """Reading a text stops here; `diagnostics` say why."""

    def __init__(self, *diagnostics: Diagnostic) -> None:
        super().__init__(*diagnostics)
        self.diagnostics = diagnostics


def unified(stored: bytes) -> bytes:
    """Return the bytes without a byte order mark, their lines ended by LF."""
    return stored.removeprefix(BOM_UTF8).replace(b"\r\n", b"\n").replace(b"\r", b"\n")


def check_text(source: Source) -> None:
    """Check the characters of a text.

    Raises:
        UnreadableText: it is not UTF-8, or holds invisible characters.
    """
    if source.stored.startswith(_UTF16_32):
        raise UnreadableText(
            NOT_READ.at(
                Place(file=source.file, line=1, column=1),
                "The file seems to be UTF-16 or UTF-32.",
                "Save the file as UTF-8 and try again.",
                file=source.file,
            )
        )
    _check_utf8(source)
    if findings := _unseen(source):
        raise UnreadableText(*findings)


def _check_utf8(source: Source) -> None:
    if "\ufffd" not in source.text:  # what stands for a byte that was not read
        return
    try:
        unified(source.stored).decode("utf-8")
    except UnicodeDecodeError as problem:
        byte = problem.object[problem.start]
        raise UnreadableText(
            NOT_READ.at(
                source.place(len(problem.object[: problem.start].decode("utf-8"))),
                "The byte {_hexadecimal} (hexadecimal) at this place is not UTF-8.",
                "Save the file as UTF-8 and try again.",
                file=source.file,
                byte=byte,
                _hexadecimal=f"{byte:02X}",
            )
        ) from None


def _unseen(source: Source) -> list[Diagnostic]:
    if source.stored.isascii() and source.stored.translate(None, _ASCII_CONTROL) == source.stored:
        return []  # 1.5 ms earlier for 1,000 components
    return [unseen(found.group(), source.place(found.start())) for found in islice(HIDDEN.finditer(source.text), _MOST)]


def unseen(character: str, place: Place) -> Diagnostic:
    """Return the finding for a character of `HIDDEN`."""
    code = ord(character)
    name = unicodedata.name(character, "control character" if code < 0xA0 else "no character")
    return UNSEEN.at(
        place,
        "{character} ({name}) is invisible and can change the meaning of the text.",
        "Remove the character.",
        character=f"U+{code:04X}",
        name=name.lower(),
    )


def syntax_finding(problem: YAMLError, source: Source) -> Diagnostic:
    """Return the finding for what the parser cannot read: at the place that it names, or at the end of the text."""
    mark = getattr(problem, "problem_mark", None) or getattr(problem, "context_mark", None)
    complaint = str(getattr(problem, "problem", ""))
    if mark is not None and source.text.startswith("\t", mark.index):
        complaint = "found a tab character"
    detail, advice = _explain(complaint, str(getattr(problem, "context", "") or ""))
    # The parser puts what is missing at the end onto a line of its own, which may not exist.
    end = source.place(len(source.text.rstrip(" \t\n")))
    place = end if mark is None or mark.line >= end.line else source.place(mark.index)
    return NOT_YAML.at(place, "{_detail}", advice, _detail=detail, parser=complaint)


_COMPLAINTS: tuple[tuple[str, str, str], ...] = (
    (
        "mapping values are not allowed",
        "A colon is not allowed here.",
        "Put a text that contains ': ' in quotes, or check the indentation of this line.",
    ),
    (
        "could not find expected ':'",
        "A key has no colon.",
        "Write `key: value`, with a space after the colon. Check the line before, too.",
    ),
    (
        "found character that cannot start any token",
        "This character cannot start a value.",
        "Put the value in quotes. Indent with spaces, not tabs.",
    ),
    ("found a tab character", "A tab is not allowed in the indentation.", "Indent with spaces."),
    (
        "did not find expected ',' or ']'",
        "A list that starts with [ is not closed, or lacks a comma.",
        "Add the missing comma or ].",
    ),
    (
        "did not find expected ',' or '}'",
        "A map that starts with { is not closed, or lacks a comma.",
        "Add the missing comma or }.",
    ),
    (
        "did not find expected key",
        "A key is expected here.",
        "Check the indentation of this line and of those before it, and that quotes are closed.",
    ),
    (
        "did not find expected '-' indicator",
        "The next item of the list is expected here.",
        "Start it with '- ', or check the indentation.",
    ),
    (
        "block sequence entries are not allowed",
        "A list item is not allowed here.",
        "Start the list on a line of its own.",
    ),
    ("found unexpected end of stream", "The text ends inside quotes.", "Close the quotes."),
    ("found unexpected document indicator", "The document ends inside quotes.", "Close the quotes."),
    (
        "found unknown escape character",
        "This backslash sequence has no meaning in double quotes.",
        "Write a backslash twice, or use single quotes.",
    ),
    (
        "invalid Unicode character escape code",
        "This backslash sequence is not a character.",
        "Write the character itself.",
    ),
    (
        "did not find expected hexdecimal number",
        "This backslash sequence needs hexadecimal digits.",
        "Write \\xHH, \\uHHHH or \\UHHHHHHHH.",
    ),
    (
        "did not find expected node content",
        "A value is expected here.",
        "Write a value, or remove the comma before it.",
    ),
    (
        "did not find expected <document start>",
        "Text is not allowed after the end of the document.",
        "Check the indentation of this line.",
    ),
    ("undefined tag handle", "rarms does not read tags (!name).", "Remove the tag: the type of each field is fixed."),
    (
        "did not find expected alphabetic or numeric character",
        "rarms does not read anchors (&name) and aliases (*name).",
        "Put a text that starts with & or * in quotes.",
    ),
    ("incompatible YAML document", "rarms reads YAML 1.2.", "Remove the line that starts with %YAML."),
    (
        "chomping or indentation indicator",
        "This text is not allowed after | or >.",
        "Start the text on the next line, or put it in quotes.",
    ),
)
"""What the parser says, and the same as (detail, advice) for a user."""


def _explain(problem: str, context: str) -> tuple[str, str]:
    """Return the parser's complaint as (detail, advice)."""
    for complaint in (problem, context):
        for words, detail, advice in _COMPLAINTS:
            if words in complaint:
                return detail, advice
    complaint = " ".join(part for part in (context, problem) if part)
    return f"The text cannot be read as YAML here ({complaint}).", "Check this line and the one before it."
