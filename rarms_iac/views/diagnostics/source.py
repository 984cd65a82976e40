"""The line of a file that a finding points at, with a caret under the spot."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from rarms_iac.model.diagnostics import Place
from rarms_iac.views.diagnostics.layout import columns, without_tabs

LINE_END = re.compile(r"\r\n|[\n\r]")
"""What ends a line for editors and for the YAML reader, which refuses the other line ends of Unicode."""

ELLIPSIS = "..."


@dataclass(frozen=True, slots=True, kw_only=True)
class Excerpt:
    """A source line and what is to be underlined in it, both ready for a terminal."""

    line: str
    before: int  # columns before the first caret
    carets: int  # columns to underline, at least 1


REACH = 400
"""Characters looked at on either side of the spot: a file of one line of megabytes is no reason to be slow."""


def source_lines(text: str | Sequence[str]) -> Sequence[str]:
    """The lines of a file without their ends and without a byte-order mark; lines are given back as they are."""
    return LINE_END.split(text.removeprefix("\ufeff")) if isinstance(text, str) else text


def line_at(lines: Sequence[str], number: int) -> str:
    """The line with that number, counted from 1; nothing where there is none."""
    try:
        return lines[number - 1] if number > 0 else ""
    except IndexError:
        return ""


def excerpt(line: str, place: Place, width: int) -> Excerpt:
    """The place in its line, cut to at most `width` columns around the spot where the line is longer."""
    first = min(max(place.column, 1) - 1, len(line))
    last = min(first + max(place.length, 1), len(line))
    before = without_tabs(line[max(first - REACH, 0) : first])
    under = without_tabs(line[first : min(last, first + REACH)], columns(before))
    after = without_tabs(line[last : last + REACH], columns(before) + columns(under))
    if columns(before) + columns(under) + columns(after) <= width:
        return Excerpt(line=(before + under + after).rstrip(), before=columns(before), carets=max(columns(under), 1))
    return _cut(before, under, after, width)


def _cut(before: str, under: str, after: str, width: int) -> Excerpt:
    """Shortened where it is too long: the end first, for the key stands at the start."""
    under = _fitting(under, width // 2)
    room = width - columns(under) - 2 * len(ELLIPSIS)
    fits = columns(before) <= room + len(ELLIPSIS)
    start = before if fits else ELLIPSIS + _fitting(before[::-1], room * 2 // 3)[::-1]
    rest = width - columns(start) - columns(under)
    end = after if columns(after) <= rest else _fitting(after, rest - len(ELLIPSIS)) + ELLIPSIS
    return Excerpt(line=(start + under + end).rstrip(), before=columns(start), carets=max(columns(under), 1))


def _fitting(text: str, width: int) -> str:
    taken = text[:width]
    while columns(taken) > width:
        taken = taken[:-1]
    return taken
