"""The one form of a table: columns, rows and totals as data, for terminal, Markdown, page and files.

`Table` is a renderable for a terminal. `markdown.table_markdown` writes it for a pull request, the templates of the
page show it by `table_of` (`templates/report/table.html.j2`), and `for_files` yields its numbers for CSV and XLSX.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import compress, zip_longest
from math import isfinite
from typing import TYPE_CHECKING, Protocol, TypeAlias, Union

from rarms_iac.texts.quantities import plain
from rarms_iac.views.console import STRONG, Harmless, columns, indented, paragraph, stack, styled

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
    from rich.live import Live
    from rich.text import Text

DIGITS = 6
"""That count, of an estimate: far more than any interval is narrow."""

Value: TypeAlias = str | int | float | Fraction | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """The cells below one another. People are shown it if it has a title, files get it if it has a heading there."""

    title: str = field(default="", kw_only=False)
    right: bool = False  # numbers stand at the right
    wraps: bool = False  # its cells may go on in a second line; a name or a number is never broken
    unit: str = ""  # of its numbers, for people
    in_files: str = ""  # its heading there, with the unit
    page_only: bool = False  # a terminal has no room for it
    if_differs: bool = False  # a terminal leaves it out where all its cells are equal
    style: str = ""  # classes of its cells on the page

    @property
    def heading(self) -> str:
        """The title as the page writes it."""
        return self.title[:1].upper() + self.title[1:]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """A cell that is something else for people than for programs."""

    text: str
    value: Value = None
    missed: bool = False  # whether it says that something is not as it must be


Content: TypeAlias = Union[Cell, Value, "Text"]
Row: TypeAlias = Sequence[Content]


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Rows of cells below the titles of their columns, then lines that sum them up.

    In a terminal the columns are two spaces apart. Where it is too wide, the widest column that may wrap gives first;
    where none can give more, the cells of the rows with the longest words stand below one another.

    NOTE: rich's `Table` takes the same from all wide columns, and then some of them would break a word; and it takes
    five times as long for a thousand rows.
    """

    columns: Sequence[Column] = field(kw_only=False)
    rows: Sequence[Row] = field(kw_only=False)
    totals: Sequence[str] = ()
    header: bool = True  # whether a terminal shows the titles
    indent: int = 0

    def on_page(self) -> "Table":
        """Return the columns that the page shows."""
        return self._select([bool(column.title) for column in self.columns])

    def for_files(self) -> Iterator[Sequence[str | int | float | None]]:
        """Yield the header, with units, then the rows, whose numbers are numbers."""
        table = self._select([bool(column.in_files) for column in self.columns])
        yield tuple(column.in_files for column in table.columns)
        yield from (tuple(map(_number, row)) for row in table.rows)

    def _select(self, chosen: Sequence[bool]) -> "Table":
        rows = tuple(tuple(compress(row, chosen)) for row in self.rows)
        return Table(tuple(compress(self.columns, chosen)), rows, totals=self.totals)

    def __rich_console__(self, console: "Console", options: "ConsoleOptions") -> "RenderResult":
        shown = self._select([self._has_room(at) for at in range(len(self.columns))])
        yield from self._shown(shown, console, options.max_width - self.indent)
        yield from (paragraph(line, indent=self.indent, more=2) for line in self.totals)

    def _has_room(self, at: int) -> bool:
        column = self.columns[at]
        is_constant = len({str(row[at]) for row in self.rows}) < 2
        return bool(column.title) and not column.page_only and not (column.if_differs and is_constant)

    def _shown(self, shown: "Table", console: "Console", space: int) -> "Iterator[RenderableType]":
        if not shown.rows:
            return
        rows = [
            [styled(text_of_cell(cell, column)) for cell, column in zip(row, shown.columns, strict=True)]
            for row in shown.rows
        ]
        titles = [styled((column.title, STRONG)) for column in shown.columns]
        grid = _Grid.of(shown.columns, [titles, *rows] if self.header else rows)
        needs = [grid.needs_of(row) for row in rows]
        order = sorted(range(len(rows)), key=lambda at: sum(needs[at]), reverse=True)
        apart = 0  # rows that stand below their first cell, those with the longest words
        while (widths := grid.widths(space)) is None and 2 * apart < len(rows):
            apart += 1
            kept = [rows[at] for at in sorted(order[apart:])]
            grid = _Grid.of(shown.columns, [titles, *kept] if self.header else kept)
        if widths is None:
            yield indented(
                stack(*(_stacked(shown.columns, row, space, is_named=self.header) for row in rows)), self.indent
            )
            return
        if self.header:
            yield from self._lines(shown.columns, titles, widths, console)
        for at, row in enumerate(rows):
            if at in order[:apart]:
                yield indented(_stacked(shown.columns, row, space, is_named=self.header), self.indent)
            else:
                yield from self._lines(shown.columns, row, widths, console)

    def _lines(
        self, shown: Sequence[Column], row: "Sequence[Text]", widths: Sequence[int], console: "Console"
    ) -> "Iterator[Text]":
        """Yield the lines of a row, each cell filled up to its column's width."""
        blank = styled()
        for line in zip_longest(*(_fold(cell, width, console) for cell, width in zip(row, widths, strict=True))):
            text = styled(" " * self.indent)
            text.no_wrap, text.overflow = True, "ignore"
            for at, (part, width) in enumerate(zip(line, widths, strict=True)):
                words = part or blank
                fill = " " * (width - words.cell_len)
                text.append(f"{'  ' if at else ''}{fill if shown[at].right else ''}")
                text.append_text(words).append("" if shown[at].right else fill)
            yield text


@dataclass(frozen=True, slots=True)
class _Grid:
    """The width of each column if nothing is broken, and if no word is."""

    columns: Sequence[Column]
    widest: Sequence[int]
    least: Sequence[int]

    @classmethod
    def of(cls, shown: Sequence[Column], rows: "Sequence[Sequence[Text]]") -> "_Grid":
        widest = [max((_widest(row[at]) for row in rows), default=0) for at in range(len(shown))]
        grid = cls(shown, widest, widest)
        return cls(shown, widest, [max(needs, default=0) for needs in zip(*map(grid.needs_of, rows), strict=True)])

    def needs_of(self, row: "Sequence[Text]") -> Sequence[int]:
        """Return the columns that each cell needs at least."""
        return [
            max(map(columns, cell.plain.split()), default=0) if column.wraps else _widest(cell)
            for cell, column in zip(row, self.columns, strict=True)
        ]

    def widths(self, space: int) -> Sequence[int] | None:
        """Return widths that fit: the widest column that may wrap gives first; None: a word would be broken."""
        widths = list(self.widest)
        while sum(widths) + 2 * (len(widths) - 1) > space:
            shrinkable = [at for at, width in enumerate(widths) if width > self.least[at]]
            if not shrinkable:
                return None
            widths[max(shrinkable, key=widths.__getitem__)] -= 1
        return widths


def _widest(cell: "Text") -> int:
    return max(map(columns, cell.plain.split("\n")))


def text_of_cell(cell: Content, column: Column) -> "Text | str":
    """Return the text of a cell, with its styles."""
    if cell is None or isinstance(cell, Cell | str | int | float | Fraction):
        return show_cell(cell, column.unit)
    return cell


def _stacked(shown: Sequence[Column], row: "Sequence[Text]", width: int, *, is_named: bool) -> "RenderableType":
    """Return a row as its first cell, with the others below it, each after the title of its column.

    A cell is not broken where it fits on a line of its own.
    """
    first, *others = row
    parts: list[RenderableType] = [paragraph(first)] if first.plain else []
    names = [f"{column.title}: " if is_named else "" for column in shown[1:]]
    line = styled()
    for named in (styled(name, cell) for name, cell in zip(names, others, strict=True) if cell.plain):
        if line.plain and line.cell_len + 2 + named.cell_len > width - 2:
            parts.append(paragraph(line, indent=2, more=2))
            line = styled()
        line = styled(line, "  ", named) if line.plain else named
    return stack(*parts, paragraph(line, indent=2, more=2))


def _fold(cell: "Text", width: int, console: "Console") -> "Sequence[Text]":
    """Return the lines of a cell."""
    return [cell] if cell.cell_len <= width and "\n" not in cell.plain else list(cell.wrap(console, width))


def _number(cell: Content) -> str | int | float | None:
    value = cell.value if isinstance(cell, Cell) else cell
    if isinstance(value, Fraction):
        return float(value)
    assert value is None or isinstance(value, str | int | float), "text with colours is for a terminal"
    return value


def show_cell(cell: Content, unit: str = "") -> str:
    """Return the text of a cell; a number is followed by the unit of its column."""
    match cell:
        case Cell(text=text):
            return text
        case None:
            return ""
        case str():
            return cell
        case int() | float() | Fraction():
            return f"{plain(Fraction(cell))} {unit}".rstrip()
        case _:
            return cell.plain


def finite(value: float | None) -> float | None:
    """Return an estimate with the digits that count; None for a side without a bound: spreadsheets have no infinity."""
    return float(f"{value:.{DIGITS}g}") if value is not None and isfinite(value) else None


class LiveRow(Protocol):
    """A row that changes while something runs, on a terminal or on a page."""

    def show(self, row: Sequence[str]) -> None:
        """Show what runs now."""

    def hide(self) -> None:
        """Take it away."""


def cut_row(row: Sequence[str], width: int) -> Sequence[str]:
    """Cut a row to one line, so that it stays one line while it changes.

    The last cell is cut to the rest of the line. If less than a third of the line is left, the first cell is cut too.
    """
    first, *others = row
    between = sum(columns(cell) + 2 for cell in others[:-1]) + 2
    last = others.pop()
    first = _cut(first, width - between - min(columns(last), width // 3))
    return (first, *others, _cut(last, width - between - columns(first)))


def _cut(cell: str, width: int) -> str:
    if columns(cell) <= width:
        return cell
    while cell and columns(cell) > width - 3:
        cell = cell[:-1]
    return f"{cell}..."


class LiveLine:
    """A row at the end of a terminal that changes while something runs; it is gone when it is hidden.

    Args:
        console: of standard error, where it is a terminal.
    """

    def __init__(self, console: "Console") -> None:
        self._console = console
        self._live: Live | None = None

    def show(self, row: Sequence[str]) -> None:
        """Show this row in place of the one before."""
        from rich.live import Live

        if self._live is None:
            self._live = Live(console=self._console, transient=True, auto_refresh=False)
            self._live.start()
        row = cut_row(row, self._console.width)
        shown = [Column(str(number), wraps=True) for number in range(len(row))]
        self._live.update(Harmless(Table(shown, [row], header=False)), refresh=True)

    def hide(self) -> None:
        """Take it from the terminal, and give the cursor back."""
        if self._live is not None:
            self._live.stop()
            self._live = None
