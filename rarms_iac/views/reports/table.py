"""A table of the report: text, page, CSV and spreadsheet lay out the columns that have a heading there."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import compress
from math import isfinite

from rarms_iac.model.quantities import plain

DIGITS = 6
"""That count, of an estimate: far more than any interval is narrow."""

Value = str | int | float | Fraction | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """What the cells below one another are; a kind of reader for whom there is no heading is not shown them."""

    field: str = ""  # in files, with the unit
    title: str = ""  # on the page
    short: str = ""  # in a terminal, with the unit
    unit: str = ""  # of its numbers
    style: str = ""  # classes of its cells on the page
    wraps: bool = False  # whether its cells may be broken in a terminal
    right: bool = False  # whether they stand at the right there


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """A cell that is something else for people than for programs."""

    text: str
    value: Value = None
    missed: bool = False  # whether it says that something is not as it must be


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportTable:
    """Columns, and rows with as many cells."""

    columns: tuple[Column, ...]
    rows: tuple[Sequence[Cell | Value], ...]

    def select(self, heading: Callable[[Column], str]) -> "ReportTable":
        """Return the table without the columns that have no such heading."""
        chosen = [bool(heading(column)) for column in self.columns]
        return ReportTable(
            columns=tuple(compress(self.columns, chosen)),
            rows=tuple(tuple(compress(row, chosen)) for row in self.rows),
        )

    def for_files(self) -> Iterator[Sequence[str | int | float | None]]:
        """Yield the header, with units, then the rows, whose numbers are numbers."""
        table = self.select(lambda column: column.field)
        yield tuple(column.field for column in table.columns)
        yield from (tuple(map(_value, row)) for row in table.rows)


def _value(cell: Cell | Value) -> str | int | float | None:
    value = cell.value if isinstance(cell, Cell) else cell
    return float(value) if isinstance(value, Fraction) else value


def show_cell(cell: Cell | Value, unit: str = "") -> str:
    """Return what people read in a cell.

    Args:
        unit: What goes behind its number, where it has no text of its own.
    """
    if isinstance(cell, Cell):
        return cell.text
    if cell is None or isinstance(cell, str):
        return cell or ""
    return f"{plain(Fraction(cell))} {unit}".rstrip()


def finite(value: float | None) -> float | None:
    """Return an estimate with the digits that count.

    The text is empty for a side without a bound, because spreadsheets do not know infinity.
    """
    return float(f"{value:.{DIGITS}g}") if value is not None and isfinite(value) else None
