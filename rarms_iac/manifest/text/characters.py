"""Bytes -> text that shows what it is: UTF-8 without invisible characters."""

import re
import unicodedata
from typing import Any

from rarms_iac.model.commands import INIT, command, prose
from rarms_iac.model.diagnostics import Diagnostic, Finding, Place
from rarms_iac.model.shared_findings import NOT_READ
from rarms_iac.storage.reading import STANDARD_INPUT

UNSEEN = Finding.error("RARMS005", "An invisible character")
BYTE_ORDER_MARK = Finding.note("RARMS006", "The file starts with a byte order mark")

_BOM = b"\xef\xbb\xbf"
_UTF16_32 = (b"\xff\xfe", b"\xfe\xff", b"\x00\x00\xfe\xff")

# The same in UTF-8: a file is searched as bytes, so that one emoji does not make it four times as large in memory.
_HIDDEN_BYTES = re.compile(
    rb"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]|\xc2[\x80-\x9f]|\xd8\x9c|\xe2\x80[\x8e\x8f\xa8-\xae]"
    rb"|\xe2\x81[\xa6-\xa9]|\xef\xbb\xbf|\xef\xbf[\xbe\xbf]"
)
_MOST = 20  # places shown of a kind: a file full of them needs no million lines


class UnreadableText(Exception):
    """Reading a text stops here; `diagnostics` say why."""

    def __init__(self, *diagnostics: Diagnostic) -> None:
        super().__init__(*diagnostics)
        self.diagnostics = diagnostics


def check_text(data: bytes, file: str) -> tuple[bytes, tuple[Diagnostic, ...]]:
    """Check the characters of a text.

    Args:
        file: the name that messages use (`ParsedText`, `<stdin>` for standard input).

    Returns:
        The text without its byte order mark, and a note where it had one.

    Raises:
        UnreadableText: it is empty, not UTF-8, or holds invisible characters.
    """
    start = Place(file=file, line=1, column=1)
    if data.startswith(_UTF16_32):
        raise UnreadableText(
            NOT_READ.at(start, "The file seems to be UTF-16 or UTF-32.", "Save it as UTF-8 and try again.", file=file)
        )
    marked = data.startswith(_BOM)
    data = data.removeprefix(_BOM)
    if not data.strip():
        raise UnreadableText(
            NOT_READ.at(
                start, "The file has no content.", prose("Write a manifest, or let ", INIT, " write one."), file=file
            )
        )
    _check_utf8(data, file)
    _check_hidden(data, file)
    formatter = command("fmt", STANDARD_INPUT if file == "<stdin>" else file)
    note = BYTE_ORDER_MARK.at(
        start,
        "The three bytes EF BB BF at the start mean nothing in UTF-8. rarms reads the file without them.",
        prose("Save it as UTF-8 without a byte order mark, or let ", formatter, " do it."),
        file=file,
    )
    return data, (note,) if marked else ()


def _check_utf8(data: bytes, file: str) -> None:
    try:
        data.decode("utf-8")
    except UnicodeDecodeError as problem:
        raise UnreadableText(
            NOT_READ.at(
                place_of(data, problem.start, file),
                "The byte {_hexadecimal} (hexadecimal) at this place is not UTF-8.",
                "Save the file as UTF-8 and try again.",
                file=file,
                byte=data[problem.start],
                _hexadecimal=f"{data[problem.start]:02X}",
            )
        ) from None


def _check_hidden(data: bytes, file: str) -> None:
    findings: list[Diagnostic] = []
    for match in _HIDDEN_BYTES.finditer(data):
        if len(findings) == _MOST:
            break
        findings.append(hidden(match.group().decode("utf-8"), place_of(data, match.start(), file)))
    if findings:
        raise UnreadableText(*findings)


def hidden(character: str, place: Place) -> Diagnostic:
    """Return the finding for a character that `HIDDEN` names."""
    code = ord(character)
    name = unicodedata.name(character, "control character" if code < 0xA0 else "no character")
    return UNSEEN.at(
        place,
        "{character} ({name}) is invisible and can change how the text is read.",
        "Remove it.",
        character=f"U+{code:04X}",
        name=name.lower(),
    )


def place_of(data: bytes, offset: int, file: str) -> Place:
    """Line and column of a byte."""
    before = data[:offset]
    line = before.count(b"\n") + before.count(b"\r") - before.count(b"\r\n")
    start = max(before.rfind(b"\n"), before.rfind(b"\r")) + 1
    column = len(before[start:].decode("utf-8", errors="replace"))
    return Place(file=file, line=line + 1, column=column + 1)


def place_at(mark: Any, file: str, length: int = 1) -> Place:
    """Return a parser's position (from 0) as ours (from 1)."""
    return Place(file=file, line=mark.line + 1, column=mark.column + 1, length=max(1, length))
