"""The pieces that every text for a person is made of, and `render`, which lets rich lay them out.

A view's `..._text` function takes values and returns a renderable: pieces of this module, stacked. `terminal` knows
the width and the colours of the stream and renders it there; a test renders it with `render` at 80 columns. What a
program reads (JSON, SARIF, JUnit, GitHub annotations, scripts) is plain `str` and does not come here: rich takes about
70 ms to import, so it is imported inside these functions, and only there.
"""

import io
import re
from collections.abc import Iterator, MutableSequence, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from itertools import zip_longest
from typing import TYPE_CHECKING, Protocol, TextIO, TypeAlias, Union, cast

from rarms_iac.model.commands import Prose, plain_text
from rarms_iac.views.harmless import GLUE, visible

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
    from rich.live import Live
    from rich.text import Text


Content: TypeAlias = Union["Text", str]
"""Text of one style, or of several; a `str` is made harmless where it is shown."""

_MANIFEST = ContextVar("manifest", default="")
"""What recommended commands end with while something is rendered: ` -f cell`."""

WIDTH = 80
UNLIMITED = 1_000_000
"""Columns of a pipe or a file: no line is broken there, so that `grep` and `diff` find it whole."""

NARROWEST_COLUMN = 8

ERROR, WARNING, NOTE, DIM, STRONG = "bold red", "bold yellow", "bold cyan", "dim", "bold"
GOOD, CHANGED, BAD = "green", "yellow", "red"

_UNIT = re.compile(r"(?<=[0-9]) (?=(?:%|LP|us|ms|s|min|h|B|[KMGT]iB|/s|/min|/h)(?![\w/]))")
_ITEM = re.compile(r" *- ")


def show_seconds(time: float) -> str:
    """`0.1 s`, `75 s`: no more digits than a person reads."""
    return f"{time:.1f} s" if time < 10 else f"{time:.0f} s"


def columns(text: str) -> int:
    """How many columns of a terminal the visible text takes: two for a wide character, none for a combining one."""
    if text.isascii():
        return len(text)
    from rich.cells import cell_len

    return cell_len(text)


def styled(*parts: Content | tuple[str, str]) -> "Text":
    """One text of several parts; a pair is a part and its style, such as `("done", GOOD)`."""
    from rich.text import Text

    text = Text()
    for part in parts:
        if isinstance(part, Text):
            text.append_text(part)
        else:
            words, style = (part, "") if isinstance(part, str) else part
            text.append(_UNIT.sub(GLUE, visible(words)), style)
    return text


def stack(*parts: "RenderableType | None") -> "RenderableType":
    """Return the parts, one below the other; `""` is an empty line, None is nothing."""
    from rich.console import Group

    return Group(*(part for part in parts if part is not None))


def paragraph(
    content: Content | Prose, *, indent: int = 0, more: int = 0, start: Content = "", lead: Content = ""
) -> "RenderableType":
    """Return running text, wrapped between words; a word longer than a line keeps a line of its own.

    Its own line ends stay. The further lines of an item (`- so`) stand below the item's first word.

    Args:
        content: the text; commands in it name the manifest that this one was given.
        indent: columns before every line.
        more: further columns before every line but the first.
        start: what stands before the first line; the other lines stand below what follows it.
        lead: what the text begins with, in a style of its own.
    """
    if isinstance(content, Prose):
        return _Recommendation(content=content, indent=indent, more=more, start=start, lead=lead)
    head = styled(" " * indent, start)
    lines = [_item(line) for line in styled(lead, content).split("\n", allow_blank=True)]
    below = styled(" " * head.cell_len)
    return stack(
        *(_HangingIndent(head=below if number else head, more=more, content=line) for number, line in enumerate(lines))
    )


def _item(line: "Text") -> "RenderableType":
    marker = _ITEM.match(line.plain)
    return _HangingIndent(head=line[: marker.end()], more=0, content=line[marker.end() :]) if marker else line


@dataclass(frozen=True, slots=True, kw_only=True)
class _Recommendation:
    """A paragraph with commands, which are written out when it is rendered: only then the manifest's name is known."""

    content: Prose
    indent: int
    more: int
    start: Content
    lead: Content

    def __rich__(self) -> "RenderableType":
        text = plain_text(self.content, _MANIFEST.get())
        return paragraph(text, indent=self.indent, more=self.more, start=self.start, lead=self.lead)


def indented(content: "RenderableType", indent: int) -> "RenderableType":
    """Anything, some columns to the right."""
    return _HangingIndent(head=styled(" " * indent), more=0, content=content)


@dataclass(frozen=True, slots=True, kw_only=True)
class _HangingIndent:
    """Content whose first line stands behind a head, and whose further lines stand below the first.

    NOTE: rich's `Padding` would cut a word that is longer than the line.
    """

    head: "Text"
    more: int
    content: "RenderableType"

    def __rich_console__(self, console: "Console", options: "ConsoleOptions") -> "RenderResult":
        from rich.segment import Segment
        from rich.text import Text

        width = max(options.max_width - self.head.cell_len - self.more, NARROWEST_COLUMN)
        blank = Segment(" " * (self.head.cell_len + self.more))
        content = self.content
        if isinstance(content, Text):
            content = content.copy()
            content.overflow = "ignore"
            content = Text("\n", no_wrap=True, overflow="ignore").join(content.wrap(console, width))
        for number, line in enumerate(Segment.split_lines(console.render(content, options.update_width(width)))):
            yield from [blank] if number else self.head.render(console)
            yield from line
            yield Segment.line()


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of cells as data, for every form of a result; as it stands, a renderable for a terminal.

    In a terminal its columns are two spaces apart. Where it is too wide, the widest column that may wrap gives first;
    where none can give more, the cells of a row stand below one another.

    NOTE: rich's `Table` takes the same from all wide columns, and then some of them would break a word; and it takes
    five times as long for a thousand rows.
    """

    rows: Sequence[Sequence[Content]]  # of equal length
    header: Sequence[str] = ()  # a name for each column; empty: the table has no header
    wrap: Sequence[int] = ()  # columns whose cells may go on in a second line; a name or a number is never broken
    right: Sequence[int] = ()  # columns whose cells stand at the right, for numbers
    indent: int = 0

    def __rich_console__(self, console: "Console", options: "ConsoleOptions") -> "RenderResult":
        space = options.max_width - self.indent
        cells = [[styled(cell) for cell in row] for row in self.rows]
        widths, least = self._widths(cells)
        while sum(widths) + 2 * (len(widths) - 1) > space:
            shrinkable = [number for number, width in enumerate(widths) if width > least[number]]
            if not shrinkable:
                yield indented(self._stacked(cells, space), self.indent)
                return
            widths[max(shrinkable, key=widths.__getitem__)] -= 1
        if self.header:
            yield from self._lines([styled((name, STRONG)) for name in self.header], widths, console)
        for row in cells:
            yield from self._lines(row, widths, console)

    def _widths(self, cells: "Sequence[Sequence[Text]]") -> tuple[list[int], list[int]]:
        """Return the width of each column where nothing is broken, and where no word is."""
        widest: list[int] = []
        least: list[int] = []
        for number in range(max(map(len, cells), default=len(self.header))):
            texts = [*self.header[number : number + 1], *(row[number].plain for row in cells)]
            widest.append(max((columns(line) for text in texts for line in text.split("\n")), default=0))
            words = [word for text in texts for word in text.split()]
            least.append(max(map(columns, words), default=0) if number in self.wrap else widest[-1])
        return widest, least

    def _lines(self, row: "Sequence[Text]", widths: Sequence[int], console: "Console") -> "Iterator[Text]":
        """Yield the lines of a row, each cell filled up to its column's width."""
        blank = styled()
        for line in zip_longest(*(_fold(cell, width, console) for cell, width in zip(row, widths, strict=True))):
            text = styled(" " * self.indent)
            text.no_wrap, text.overflow = True, "ignore"
            for number, (part, width) in enumerate(zip(line, widths, strict=True)):
                words = part or blank
                fill = " " * (width - words.cell_len)
                text.append(f"{'  ' if number else ''}{fill if number in self.right else ''}")
                text.append_text(words).append("" if number in self.right else fill)
            yield text

    def _stacked(self, cells: "Sequence[Sequence[Text]]", width: int) -> "RenderableType":
        """Each row as its first cell, with the others below it: what a column is called stands before its cell.

        A cell is not broken where it fits on a line of its own.
        """
        parts: list[RenderableType] = []
        for first, *others in cells:
            parts += [paragraph(first)] if first.plain else []
            names = [f"{name}: " for name in self.header[1:]] or [""] * len(others)
            line = styled()
            for named in (styled(name, cell) for name, cell in zip(names, others, strict=True) if cell.plain):
                if line.plain and line.cell_len + 2 + named.cell_len > width - 2:
                    parts.append(paragraph(line, indent=2, more=2))
                    line = styled()
                line = styled(line, "  ", named) if line.plain else named
            parts.append(paragraph(line, indent=2, more=2))
        return stack(*parts)


def _fold(cell: "Text", width: int, console: "Console") -> "Sequence[Text]":
    """Return the lines of a cell."""
    return [cell] if cell.cell_len <= width and "\n" not in cell.plain else list(cell.wrap(console, width))


def render(content: "RenderableType", width: int = WIDTH, *, colour: bool = False, manifest: str = "") -> str:
    """Lay the content out as text that ends with a line end, without blanks at line ends.

    Args:
        width: columns; `UNLIMITED` breaks no line.
        colour: with escape sequences; without, the same text in the same lines.
        manifest: what recommended commands end with, such as ` -f cell`.
    """
    out = io.StringIO()
    token = _MANIFEST.set(manifest)
    try:
        _console(out, width, terminal=False, colour=colour).print(_Harmless(content), crop=False, end="")
    finally:
        _MANIFEST.reset(token)
    text = out.getvalue().replace(GLUE, " ")
    return "".join(f"{line.rstrip(' ')}\n" for line in text.removesuffix("\n").split("\n"))


@dataclass(frozen=True, slots=True)
class _Harmless:
    """What rich lays out, with nothing in it that could act on a terminal but what rich itself writes."""

    content: "RenderableType"

    def __rich_console__(self, console: "Console", options: "ConsoleOptions") -> "RenderResult":
        from rich.segment import Segment

        for segment in console.render(self.content, options):
            yield segment if segment.control else Segment(visible(segment.text, keep=f"\n{GLUE}"), segment.style)


def live_console(stream: TextIO, width: int, *, colour: bool) -> "Console":
    """Return a console for what rich updates in place on a terminal (`rich.live`, `rich.progress`)."""
    return _console(cast("TextIO", _PlainSpaces(stream)), width, terminal=True, colour=colour)


class _PlainSpaces:
    """A stream that writes spaces where no line is to be broken as spaces."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> object:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write the text."""
        return self._stream.write(text.replace(GLUE, " "))


def _console(stream: TextIO, width: int, *, terminal: bool, colour: bool) -> "Console":
    from rich.console import Console

    return Console(
        file=stream,
        width=width,
        force_terminal=terminal or colour,
        color_system="standard" if colour else None,
        legacy_windows=False,
        markup=False,
        highlight=False,
        emoji=False,
        _environ={},  # COLUMNS and NO_COLOR are asked by who knows the stream
    )


class LiveRows(Protocol):
    """A table whose last row changes while something runs, on a terminal or on a page."""

    rows: MutableSequence[Sequence[str]]
    """The finished ones."""

    def show(self, row: Sequence[str]) -> None:
        """Show the finished rows and this one below them."""

    def hide(self) -> None:
        """Take the running row away."""


def cut_row(row: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> Sequence[str]:
    """Cut the last cell of what runs to what the line has left, so that it stays one line while it changes.

    Args:
        rows: those above it, whose cells its columns are as wide as.

    Returns:
        The row; as it is where less than a third of the line is left for the last cell.
    """
    *others, last = row
    taken = sum(
        max(columns(each[number]) for each in (row, *rows) if number < len(each)) + 2 for number in range(len(others))
    )
    space = width - taken
    if columns(last) <= space or space < width // 3:
        return row
    while columns(last) > space - 3:
        last = last[:-1]
    return (*others, f"{last}...")


class LiveTable:
    """A table on a terminal whose last row changes while something runs; it is gone when it is hidden.

    Args:
        console: of standard error, where it is a terminal.
        header: names of the columns.
    """

    def __init__(self, console: "Console", header: Sequence[str] = ()) -> None:
        self._console = console
        self._header = header
        self._live: Live | None = None
        self.rows: MutableSequence[Sequence[str]] = []

    def show(self, row: Sequence[str]) -> None:
        """Show the finished rows and this one below them."""
        from rich.live import Live

        if self._live is None:
            self._live = Live(console=self._console, transient=True, auto_refresh=False)
            self._live.start()
        wrapped = range(len(row))
        row = cut_row(row, self.rows, self._console.width)
        self._live.update(_Harmless(Table([*self.rows, row], header=self._header, wrap=wrapped)), refresh=True)

    def hide(self) -> None:
        """Take the table from the terminal, and give the cursor back."""
        if self._live is not None:
            self._live.stop()
            self._live = None
