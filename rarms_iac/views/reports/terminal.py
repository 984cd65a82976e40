"""The report in the terminal: levels, totals, and a plot of every curve with its band, settings, threshold and reserve.

Braille draws eight dots a character; where only ASCII can be shown, letters and dashes say the same. Colour adds
nothing that a sign does not say.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rarms_iac.app.report_model import IndexCurve, Measurement, Report
from rarms_iac.model.commands import prose
from rarms_iac.model.outcomes import Achievement
from rarms_iac.texts.indexes import show_threshold
from rarms_iac.texts.quantities import show_number
from rarms_iac.views.console import paragraph, stack
from rarms_iac.views.reports.scale import Scale, scale_of
from rarms_iac.views.reports.tables import levels_table, proofs_table, tuned_table, verdict_of
from rarms_iac.views.status import applied_text, fit_text
from rarms_iac.views.tune import tuning_text
from rarms_iac.views.verdicts import advise_to_measure

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
    from rich.text import Text

HEIGHT = 14
LABELS = 9  # columns left of the axis
NARROWEST, WIDEST = 20, 68  # columns of the field
MARKS = (0, 20, 40, 60, 80, 100)


@dataclass(frozen=True, slots=True, kw_only=True)
class Signs:
    """The signs of a plot."""

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

STYLES = {"curve": "blue", "measured": "bold blue", "threshold": "red", "reserve": "green"}

Cells = dict[tuple[int, int], tuple[str, str]]
"""Column and row from the top -> the sign, and what it stands for."""


def report_text(report: Report, *, ascii_only: bool = False) -> "RenderableType":
    """Return the summary, each host's total, and a plot of every curve."""
    return stack(*_parts(report, ascii_only=ascii_only))


def _parts(report: Report, *, ascii_only: bool) -> Iterator["RenderableType"]:
    yield levels_table(report)
    for fit in report.capacities:
        yield paragraph(f"{', '.join(fit.hosts)}: {fit_text(fit)}")
    if missing := advise_to_measure(report.verdicts):
        yield paragraph(missing)
    for host in report.hosts:
        yield paragraph(prose(f"{host.name}: ", applied_text(host, is_planned=report.is_planned)))
    if report.proofs:
        yield ""
        yield "All components together, from the last `rarms prove`:"
        yield proofs_table(report)
    for tuning in report.tunings:
        yield ""
        yield paragraph(f"Combining on {tuning.platform}: {tuning_text(tuning)}")
        yield tuned_table(tuning)
    for measurement in report.measurements:
        for index in measurement.indexes:
            yield ""
            title = f"{measurement.name} against {measurement.interference} on {measurement.platform}"
            yield paragraph(title + _remark(measurement))
            if not measurement.stale:  # what no longer holds is named, and not drawn
                yield terminal_plot(measurement, index, ascii_only=ascii_only)
    yield ""
    yield legend(ascii_only=ascii_only)


def _remark(measurement: Measurement) -> str:
    if measurement.stale:
        return f" (stale: {'; '.join(measurement.stale)})"
    return "" if measurement.decides else " (for comparison only)"


@dataclass(frozen=True, slots=True, kw_only=True)
class TerminalPlot:
    """A curve in lines as wide as the terminal allows; words where nothing was measured."""

    curve: IndexCurve
    achievement: str = ""  # of its threshold; empty: it is there to compare
    ascii_only: bool = False

    def __rich_console__(self, console: "Console", options: "ConsoleOptions") -> "RenderResult":
        scale = scale_of(self.curve)
        unit = self.curve.index.symbol + (", log scale" if scale.logarithmic else "")
        yield paragraph(f"{self.curve.component}: {self.curve.index.name} ({unit}) against CR (% of its VPs)")
        if not self.curve.curve.points:
            yield paragraph("No result yet.", indent=2)
            return
        signs = ASCII if self.ascii_only else UNICODE
        field = max(NARROWEST, min(options.max_width - LABELS - 3, WIDEST))
        yield from _field(scale, _cells(self.curve, scale, field, signs, dots=not self.ascii_only), field, signs)
        yield _marks(field, signs)
        yield _numbers(field)
        yield paragraph(_conclusion(self.curve, self.achievement))


def terminal_plot(measurement: Measurement, index: IndexCurve, *, ascii_only: bool) -> TerminalPlot:
    """Return the plot of a curve, with the verdict on its threshold where the measurement decides."""
    achievement = verdict_of(measurement.verdict, index) if measurement.decides else ""
    return TerminalPlot(curve=index, achievement=achievement, ascii_only=ascii_only)


def _cells(index_curve: IndexCurve, scale: Scale, field: int, signs: Signs, *, dots: bool) -> Cells:
    """Draw the layers in order; later ones cover earlier ones."""
    cells: Cells = {}
    rows, least = index_curve.rows, index_curve.least
    for row in rows:
        top, bottom = _row(scale, row.high), _row(scale, row.low)
        for line in range(top, bottom + 1) if bottom - top > 1 else ():
            cells[_column(row.reserve, field), line] = signs.band, "band"
    if index_curve.threshold is not None:
        line = _row(scale, float(index_curve.threshold.value))
        cells.update({(column, line): (signs.threshold, "threshold") for column in range(field)})
    if least is not None:
        column = _column(least, field)
        for line in range(HEIGHT):
            crosses = cells.get((column, line), ("", ""))[1] == "threshold"
            cells[column, line] = (signs.crossing, "threshold") if crosses else (signs.reserve, "reserve")
    cells.update(_braille(index_curve, scale, field) if dots else _stars(index_curve, scale, field, signs))
    for point in index_curve.points:
        if point.value is not None:
            cells[_column(point.reserve, field), _row(scale, point.value)] = signs.measured, "measured"
    return cells


def _column(reserve: float, field: int) -> int:
    return min(int(reserve / 100 * field), field - 1)


def _row(scale: Scale, value: float) -> int:
    return min(int((1 - scale.height(value)) * HEIGHT), HEIGHT - 1)


def _curve_points(index_curve: IndexCurve, steps: int) -> Iterator[tuple[int, float]]:
    """Yield the curve's value at each of so many steps over the axis, where there is one."""
    for step in range(steps):
        point = index_curve.curve.value_at(100 * (step + 0.5) / steps)
        if point is not None:
            yield step, point.value


def _stars(index_curve: IndexCurve, scale: Scale, field: int, signs: Signs) -> Cells:
    return {(column, _row(scale, value)): (signs.curve, "curve") for column, value in _curve_points(index_curve, field)}


_DOTS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))
"""The bits of a braille sign, by column and row of its dots."""


def _braille(index_curve: IndexCurve, scale: Scale, field: int) -> Cells:
    bits: dict[tuple[int, int], int] = {}
    for step, value in _curve_points(index_curve, 2 * field):
        dot = min(int((1 - scale.height(value)) * 4 * HEIGHT), 4 * HEIGHT - 1)
        cell = step // 2, dot // 4
        bits[cell] = bits.get(cell, 0) | _DOTS[step % 2][dot % 4]
    return {cell: (chr(0x2800 + pattern), "curve") for cell, pattern in bits.items()}


def _field(scale: Scale, cells: Cells, field: int, signs: Signs) -> Iterator["Text"]:
    from rich.text import Text

    labels = {_row(scale, float(tick)): show_number(float(tick)) for tick in scale.ticks()}
    for line in range(HEIGHT):
        axis = signs.tick if line in labels else signs.axis
        text = Text(f"{labels.get(line, ''):>{LABELS}} {axis}", no_wrap=True)
        for column in range(field):
            sign, kind = cells.get((column, line), (" ", ""))
            text.append(sign, STYLES.get(kind))
        yield text


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


def legend(*, ascii_only: bool) -> "RenderableType":
    """Return the meaning of each sign of a plot."""
    signs = ASCII if ascii_only else UNICODE
    names = ("curve", "band", "measured", "threshold", "reserve")
    return paragraph("  ".join(f"{getattr(signs, name)} {name}" for name in names))


def _conclusion(index_curve: IndexCurve, achievement: str) -> str:
    if index_curve.threshold is None:
        return "No threshold yet."
    threshold, least = show_threshold(index_curve.index, index_curve.threshold), index_curve.least
    if least is None or achievement not in ("", Achievement.MET):
        return f"{threshold}: {achievement or 'not known with this load'}"
    return f"{threshold}: reserve {least} % of its VPs"
