"""How text takes up columns of a terminal, and how hostile text is made harmless before it is shown."""

import re
import unicodedata
from collections.abc import Iterator

TAB_STOP = 8

_UNIT = re.compile(r"(?:%|LP|us|ms|s|min|h|B|[KMGT]iB|/s|/min|/h)[.,;:!?)\"']*")
_NUMBER = re.compile(r"[(\"']?[0-9][0-9.,]*")
_ITEM = re.compile(r" *- ")
_HARMLESS = re.compile(r"[\x20-\x7e]*")


def visible(text: str, keep: str = "\n") -> str:
    """The text with everything that could act on a terminal, or has no encoding, spelt out: `<U+202E>`.

    Control characters, bidirectional and other invisible formatting, line separators and lone surrogates.
    """
    if _HARMLESS.fullmatch(text):
        return text
    return "".join(one if one in keep or not _acts(one) else f"<U+{ord(one):04X}>" for one in text)


def _acts(one: str) -> bool:
    return unicodedata.category(one) in {"Cc", "Cf", "Cs", "Zl", "Zp"}


def columns(text: str) -> int:
    """How many columns of a terminal the visible text takes: two for a wide character, none for a combining one."""
    return len(text) if text.isascii() else sum(map(_columns_of, text))


def _columns_of(one: str) -> int:
    if unicodedata.category(one) in {"Mn", "Me"}:
        return 0
    return 2 if unicodedata.east_asian_width(one) in {"W", "F"} else 1


def without_tabs(text: str, start: int = 0) -> str:
    """The visible text, tabs as spaces up to the next stop; its first character stands in column `start`."""
    parts: list[str] = []
    at = start
    for one in visible(text, keep="\t"):
        piece = " " * (TAB_STOP - at % TAB_STOP) if one == "\t" else one
        parts.append(piece)
        at += columns(piece)
    return "".join(parts)


def wrap(text: str, width: int, indent: str) -> Iterator[str]:
    """The text in lines of at most `width` columns, each behind the indent; its own line ends stay.

    A word longer than a line keeps a line of its own, and a number is not parted from its unit. The further lines of a
    list's item (`- so`, `  - and so`) stand below its first word.
    """
    for paragraph in visible(text).split("\n"):
        item = _ITEM.match(paragraph)
        start = item.group() if item else ""
        line, behind = indent + start, indent + " " * len(start)
        bare = True
        for word in _words(paragraph[len(start) :]):
            if not bare and columns(line) + 1 + columns(word) > width:
                yield line
                line, bare = behind, True
            line += word if bare else f" {word}"
            bare = False
        if not bare:
            yield line


def hanging(start: str, text: str, width: int, *, more: int = 0) -> Iterator[str]:
    """The text behind its start, wrapped; its further lines stand below the text, `more` columns to the right."""
    lines = wrap(text, width - more, " " * columns(start))
    yield start + next(lines, "").lstrip(" ")
    for line in lines:
        yield " " * more + line


def _words(text: str) -> list[str]:
    words: list[str] = []
    for word in text.split():
        if words and _UNIT.fullmatch(word) and _NUMBER.fullmatch(words[-1]):
            words[-1] += f" {word}"
        else:
            words.append(word)
    return words
