"""Rows of text in columns."""

from collections.abc import Sequence

from rarms_iac.views.diagnostics.layout import columns, visible


def table(rows: Sequence[Sequence[str]]) -> str:
    """Lines with every column as wide as its widest cell, two spaces apart."""
    shown = [[visible(cell, keep="") for cell in row] for row in rows]
    widths = [max(map(columns, column)) for column in zip(*shown, strict=True)]
    return "".join(_line(row, widths) + "\n" for row in shown)


def _line(row: Sequence[str], widths: Sequence[int]) -> str:
    return "  ".join(cell + " " * (width - columns(cell)) for cell, width in zip(row, widths, strict=True)).rstrip()
