"""Rows of text in columns, within a terminal's width."""

import re
from collections.abc import Iterator, Sequence
from itertools import zip_longest

from rarms_iac.views.diagnostics.layout import columns, visible, wrap

GAP = "  "
NARROWEST = 6
"""No column is made narrower: what does not fit even so is wider than the terminal."""

_PIECES = re.compile(r"[^-_+/]*[-_+/]|[^-_+/]+")


def table(rows: Sequence[Sequence[str]], width: int) -> str:
    """Lines with every column as wide as its widest cell, two spaces apart.

    Where that is wider than `width`, the widest columns are narrowed and their cells continue on lines below: between
    words first, within a name such as `mean_response_time` where it must be.
    """
    shown = [[visible(cell, keep="") for cell in row] for row in rows]
    widths = [max(map(columns, column)) for column in zip(*shown, strict=True)]
    words = [max(map(_longest_word, column)) for column in zip(*shown, strict=True)]
    widths = _narrowed(_narrowed(widths, words, width), [NARROWEST] * len(widths), width)
    return "".join(f"{line}\n" for row in shown for line in _lines(row, widths))


def _longest_word(cell: str) -> int:
    """A number and its unit count as one."""
    return max(map(columns, wrap(cell, 1, "")), default=0)


def _narrowed(widths: Sequence[int], least: Sequence[int], width: int) -> list[int]:
    """The widest columns as narrow as it takes, none below its least."""
    narrowed = list(widths)
    while sum(narrowed) + len(GAP) * (len(narrowed) - 1) > width:
        above = [at for at, wide in enumerate(narrowed) if wide > least[at]]
        if not above:
            break
        narrowed[max(above, key=lambda at: narrowed[at])] -= 1
    return narrowed


def _lines(row: Sequence[str], widths: Sequence[int]) -> Iterator[str]:
    cells = [list(_within(cell, width)) for cell, width in zip(row, widths, strict=True)]
    for parts in zip_longest(*cells, fillvalue=""):
        yield GAP.join(part + " " * (width - columns(part)) for part, width in zip(parts, widths, strict=True)).rstrip()


def _within(cell: str, width: int) -> Iterator[str]:
    if columns(cell) <= width:
        yield cell
        return
    for line in wrap(cell, width, ""):
        yield from [line] if columns(line) <= width else _broken(line, width)


def _broken(line: str, width: int) -> Iterator[str]:
    """A word that is too long, after its hyphens and underscores; a piece without one where the column ends."""
    part = ""
    for piece in _PIECES.findall(line):
        if part and columns(part + piece) > width:
            yield part
            part = ""
        part += piece
        while columns(part) > width:
            yield part[:width]
            part = part[width:]
    if part:
        yield part
