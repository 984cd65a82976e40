"""A curve in the terminal: PI against reserve, with its band, its settings, the threshold and the reserve.

Braille draws eight dots a character; where only ASCII can be shown, letters and dashes say the same. Colour adds
nothing that a sign does not say.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rarms_iac.app.report_model import IndexCurve
from rarms_iac.model.indexes import show_threshold
from rarms_iac.views.reports.scale import UNIT_TEXT, Scale, digits, scale_of

HEIGHT = 14
LABELS = 9  # columns left of the axis
NARROWEST, WIDEST = 20, 72  # columns of the field
MARKS = (0, 20, 40, 60, 80, 100)
RESET = "\x1b[0m"


@dataclass(frozen=True, slots=True, kw_only=True)
class Signs:
    """What each thing is drawn with."""

    curve: str  # in the legend; empty: braille dots
    band: str
    measured: str
    threshold: str
    reserve: str
    crossing: str
    axis: str
    tick: str
    corner: str
    base: str
    mark: str


UNICODE = Signs(
    curve="⠒",
    band="░",
    measured="●",
    threshold="╌",
    reserve="┊",
    crossing="┼",
    axis="│",
    tick="┤",
    corner="└",
    base="─",
    mark="┴",
)
ASCII = Signs(
    curve="*",
    band=".",
    measured="o",
    threshold="-",
    reserve=":",
    crossing="+",
    axis="|",
    tick="+",
    corner="+",
    base="-",
    mark="+",
)

COLOURS = {"curve": "\x1b[34m", "measured": "\x1b[1;34m", "threshold": "\x1b[31m", "reserve": "\x1b[32m"}

Cells = dict[tuple[int, int], tuple[str, str]]
"""Column and row from the top -> the sign, and what it stands for."""


def plot_text(shown: IndexCurve, *, width: int = 80, ascii_only: bool = False, colour: bool = False) -> str:
    """The curve in lines of at most `width` columns, ending with a line end; words where nothing was measured."""
    unit = UNIT_TEXT[shown.index.unit] + (", log scale" if scale_of(shown).logarithmic else "")
    title = f"{shown.component}: {shown.index.name} ({unit}) against CPU reservation (%)"
    if not shown.curve.points:
        return f"{title}\n  Nothing can be said yet.\n"
    signs = ASCII if ascii_only else UNICODE
    field = max(NARROWEST, min(width - LABELS - 3, WIDEST))
    cells = _cells(shown, scale_of(shown), field, signs, dots=not ascii_only)
    lines = [*_wrapped(title, width), *_field(scale_of(shown), cells, field, signs, colour=colour)]
    return (
        "\n".join(
            [
                *lines,
                _marks(field, signs),
                _numbers(field),
                *_wrapped(_legend(signs), width),
                *_wrapped(_says(shown), width),
            ]
        )
        + "\n"
    )


def _cells(shown: IndexCurve, scale: Scale, field: int, signs: Signs, *, dots: bool) -> Cells:
    """Later ones lie above earlier ones."""
    cells: Cells = {}
    rows, least = shown.rows, shown.least
    for row in rows:
        top, bottom = _row(scale, row.high), _row(scale, row.low)
        for line in range(top, bottom + 1) if bottom - top > 1 else ():
            cells[_column(row.reserve, field), line] = signs.band, "band"
    if shown.threshold is not None:
        line = _row(scale, float(shown.threshold.value))
        cells.update({(column, line): (signs.threshold, "threshold") for column in range(field)})
    if least is not None:
        column = _column(least.reserve, field)
        for line in range(HEIGHT):
            crosses = cells.get((column, line), ("", ""))[1] == "threshold"
            cells[column, line] = (signs.crossing, "threshold") if crosses else (signs.reserve, "reserve")
    cells.update(_braille(shown, scale, field) if dots else _stars(shown, scale, field, signs))
    for point in shown.points:
        if point.value is not None:
            cells[_column(point.reserve, field), _row(scale, point.value)] = signs.measured, "measured"
    return cells


def _column(reserve: float, field: int) -> int:
    return min(int(reserve / 100 * field), field - 1)


def _row(scale: Scale, value: float) -> int:
    return min(int((1 - scale.height(value)) * HEIGHT), HEIGHT - 1)


def _sampled(shown: IndexCurve, steps: int) -> Iterator[tuple[int, float]]:
    """The curve's value at each of so many steps over the axis, where there is one."""
    for step in range(steps):
        point = shown.curve.value_at(100 * (step + 0.5) / steps)
        if point is not None:
            yield step, point.value


def _stars(shown: IndexCurve, scale: Scale, field: int, signs: Signs) -> Cells:
    return {(column, _row(scale, value)): (signs.curve, "curve") for column, value in _sampled(shown, field)}


_DOTS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))
"""The bits of a braille sign, by column and row of its dots."""


def _braille(shown: IndexCurve, scale: Scale, field: int) -> Cells:
    bits: dict[tuple[int, int], int] = {}
    for step, value in _sampled(shown, 2 * field):
        dot = min(int((1 - scale.height(value)) * 4 * HEIGHT), 4 * HEIGHT - 1)
        cell = step // 2, dot // 4
        bits[cell] = bits.get(cell, 0) | _DOTS[step % 2][dot % 4]
    return {cell: (chr(0x2800 + found), "curve") for cell, found in bits.items()}


def _field(scale: Scale, cells: Cells, field: int, signs: Signs, *, colour: bool) -> Iterator[str]:
    labels = {_row(scale, float(tick)): digits(float(tick)) for tick in scale.ticks()}
    for line in range(HEIGHT):
        drawn = "".join(_drawn(cells.get((column, line)), colour=colour) for column in range(field))
        axis = signs.tick if line in labels else signs.axis
        yield f"{labels.get(line, ''):>{LABELS}} {axis}{drawn}".rstrip()


def _drawn(cell: tuple[str, str] | None, *, colour: bool) -> str:
    if cell is None:
        return " "
    sign, kind = cell
    return f"{COLOURS[kind]}{sign}{RESET}" if colour and kind in COLOURS else sign


def _marks(field: int, signs: Signs) -> str:
    marked = {_column(mark, field) for mark in MARKS}
    return (
        " " * (LABELS + 1) + signs.corner + "".join(signs.mark if at in marked else signs.base for at in range(field))
    )


def _numbers(field: int) -> str:
    line = [" "] * (field + 3)
    for mark in MARKS:
        text = str(mark)
        at = max(_column(mark, field) - len(text) // 2, 0)
        line[at : at + len(text)] = text
    return (" " * (LABELS + 2) + "".join(line)).rstrip()


def _legend(signs: Signs) -> str:
    named = ("curve", "band", "measured", "threshold", "reserve")
    return "  ".join(f"{getattr(signs, name)} {name}" for name in named)


def _wrapped(text: str, width: int) -> Sequence[str]:
    lines = [""]
    for word in text.split(" "):
        longer = f"{lines[-1]} {word}" if lines[-1] else word
        if len(longer) > width and lines[-1]:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def _says(shown: IndexCurve) -> str:
    if shown.threshold is None:
        return "No APT yet."
    wanted, least = show_threshold(shown.index, shown.threshold), shown.least
    if least is None:
        return f"{wanted}: no measured reserve is enough"
    return f"{wanted}: reserve {least.reserve} %, {'interpolated' if least.interpolated else 'measured'}"
