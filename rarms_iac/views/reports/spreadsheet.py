"""Measurements as rows of cells, for CSV and spreadsheets: units in the headers, numbers as numbers.

What was estimated has six digits that count, far more than any interval is narrow; times of samples have the tenth of a
microsecond that data logs keep. The planner looks its reservations up in the logs, not here.

A text that a spreadsheet would take for a formula stays text: in CSV, which has no types, behind an apostrophe.
"""

import csv
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from io import BytesIO, StringIO
from math import isfinite
from typing import TYPE_CHECKING

from rarms_iac.app.report_model import IndexCurve, MeasuredPoint, Measurement, PlatformTuning, Report
from rarms_iac.model.diagnostics import Diagnostic, Finding
from rarms_iac.model.quantities import guaranteed
from rarms_iac.views.reports.summary import deciding_curves, reserved_for, verdict_of

if TYPE_CHECKING:
    from xlsxwriter import Workbook
    from xlsxwriter.worksheet import Worksheet


Cell = str | int | float | None
Rows = Iterable[Sequence[Cell]]

SETTINGS = (
    "component",
    "measured with",
    "platform",
    "interference",
    "reserve (% of the partition's VPs)",
    "processors (VPs)",
    "index",
    "unit",
    "value",
    "interval from",
    "interval to",
    "samples",
    "effective samples",
    "failed samples",
    "direction",
    "threshold",
    "verdict",
    "error of the verdict (%)",
    "remark",
    "data log",
)

SAMPLES = (
    "component",
    "measured with",
    "platform",
    "interference",
    "reserve (% of the partition's VPs)",
    "setting",
    "job",
    "began (ms)",
    "response time (ms)",
    "successful",
    "count",
    "failure",
)

DIGITS = 6
"""That count, of an estimate."""

TIME_PLACES = 4
"""Of a millisecond, as data logs keep a sample's times."""

BEGINNINGS = ("=", "+", "-", "@", "\t", "\n")
"""What a spreadsheet takes for the beginning of a formula."""


def setting_rows(report: Report) -> Iterator[Sequence[Cell]]:
    """The header, then a row a setting and index."""
    yield SETTINGS
    for measurement in report.measurements:
        for index in measurement.indexes:
            for point in index.points:
                yield _setting(measurement, index, point)


def _setting(measurement: Measurement, index: IndexCurve, point: MeasuredPoint) -> Sequence[Cell]:
    threshold = index.threshold
    return (
        index.component,
        measurement.name,
        measurement.platform,
        measurement.interference,
        point.reserve,
        measurement.processors,
        index.index.name,
        index.index.symbol,
        None if point.value is None else finite(point.value),
        None if point.value is None else finite(point.low),
        None if point.value is None else finite(point.high),
        point.samples,
        finite(point.effective),
        point.failed,
        index.index.direction,
        None if threshold is None else float(threshold.value),
        point.verdict or "",
        None if point.error is None else finite(100 * point.error),
        point.remark,
        measurement.log,
    )


def sample_rows(report: Report) -> Iterator[Sequence[Cell]]:
    """The header, then a row a sample, in the order in which they were measured."""
    yield SAMPLES
    for measurement in report.measurements:
        for number, setting in enumerate(measurement.settings, 1):
            for series in setting.series:
                for job, sample in enumerate(series.samples, 1):
                    yield (
                        series.component,
                        measurement.name,
                        measurement.platform,
                        measurement.interference,
                        setting.reserve,
                        number,
                        job,
                        round(sample.began_ms, TIME_PLACES),
                        None if sample.response_ms is None else round(sample.response_ms, TIME_PLACES),
                        int(sample.successful),
                        sample.count,
                        sample.failure,
                    )


TRAIL = (
    "platform",
    "tuned",
    "number",
    "components",
    "reserve (% of the partition's VPs)",
    "enough",
    "not met for sure by",
    "predicted (% of the partition's VPs)",
    "claim",
)


def trail_rows(tunings: Iterable[PlatformTuning]) -> Iterator[Sequence[Cell]]:
    """The header, then a row a setting that tuning asked for, in order; the last says what is claimed of the layout."""
    yield TRAIL
    for tuning in tunings:
        for number, setting in enumerate(tuning.run.trail, 1):
            enough = "no" if setting.worse else "yes"
            names, worse = "+".join(setting.components), " ".join(setting.worse)
            claim = tuning.run.claim if number == len(tuning.run.trail) and tuning.run.strategy == "default" else ""
            yield (
                tuning.platform,
                tuning.run.when,
                number,
                names,
                setting.reserve,
                enough,
                worse,
                setting.predicted,
                claim,
            )


def finite(value: float) -> float | None:
    """An estimate with the digits that count; empty for a side without a bound, as no spreadsheet knows infinity."""
    return float(f"{value:.{DIGITS}g}") if isfinite(value) else None


def csv_text(rows: Rows) -> str:
    """Comma-separated, quoted where it must be, lines ending in LF."""
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for row in rows:
        writer.writerow([_inert(cell) for cell in row])
    return text.getvalue()


def _inert(cell: Cell) -> Cell:
    if not isinstance(cell, str):
        return cell
    text = cell.replace("\r\n", "\n").replace("\r", "\n")  # Python's writer leaves a lone CR unquoted
    return f"'{text}" if text.startswith(BEGINNINGS) else text


MOST_ROWS = 1_048_576
LONGEST_NAME = 31  # of a sheet
MADE = datetime(2000, 1, 1, tzinfo=UTC)
"""Stands in every file, so that the same report gives the same bytes."""

SUMMARY = (
    "component",
    "index",
    "direction",
    "threshold",
    "unit",
    "expected at the reserve",
    "reserve (% of the partition's VPs)",
    "bandwidth (LP)",
    "interpolated",
    "verdict",
)

CURVE = ("reserve (%)", "value", "safe side", "from", "to")


TOO_LONG = Finding.error("RARMS292", "A sheet cannot hold so many rows")


class TooManyRows(Exception):
    """A sheet ends before the samples do."""

    def __init__(self, rows: int, limit: int) -> None:
        super().__init__(f"{rows} rows, and a sheet holds {limit}")
        self.rows = rows
        self.limit = limit

    def finding(self) -> Diagnostic:
        """Say it to who asked for the file."""
        message = f"{self.rows} samples are more than the {self.limit} rows of a sheet."
        return TOO_LONG.at(None, message, "Export them to a .csv file, or name fewer components.")


def workbook(report: Report, *, samples: bool = False, most_rows: int = MOST_ROWS) -> bytes:
    """The whole file (XLSX).

    Raises:
        TooManyRows: the samples do not fit one sheet.
    """
    from xlsxwriter import Workbook

    data = BytesIO()
    book = Workbook(data, {"in_memory": True, "strings_to_formulas": False, "strings_to_urls": False})
    book.set_properties({"title": report.application, "created": MADE.replace(tzinfo=None)})
    _summary(book, report)
    names = _names(report.measurements)
    for name, measurement in zip(names, report.measurements, strict=True):
        _measurement(book, name, measurement)
    _rows(book, book.add_worksheet("settings"), setting_rows(report))
    if report.tunings:
        _rows(book, book.add_worksheet("tuning"), trail_rows(report.tunings))
    if samples:
        rows = list(sample_rows(report))
        if len(rows) > most_rows:
            raise TooManyRows(len(rows), most_rows)
        _rows(book, book.add_worksheet("samples"), rows)
    book.close()
    return data.getvalue()


def _names(measurements: Sequence[Measurement]) -> list[str]:
    """A name a sheet: the components', short enough and unlike every other."""
    names: list[str] = []
    used = {"summary", "settings", "samples", "tuning"}
    for measurement in measurements:
        name, number = measurement.name[:LONGEST_NAME], 1
        while name.lower() in used:
            number += 1
            name = f"{measurement.name[: LONGEST_NAME - len(str(number)) - 1]} {number}"
        used.add(name.lower())
        names.append(name)
    return names


def _summary(book: "Workbook", report: Report) -> None:
    sheet = book.add_worksheet("summary")
    last = _rows(book, sheet, (SUMMARY, *_levels(report)))
    totals: list[Sequence[Cell]] = [("platform", "hosts", "capacity (LP)", "reserved (LP)", "headroom (LP)", "fits")]
    for fit in report.capacities:
        numbers = (float(fit.capacity_lp), float(fit.reserved_lp), float(fit.headroom_lp))
        totals.append((fit.platform, ", ".join(fit.hosts), *numbers, "yes" if fit.fits else "no"))
    _rows(book, sheet, totals, top=last + 1)


def _levels(report: Report) -> Iterator[Sequence[Cell]]:
    for measurement, curve in deciding_curves(report):
        yield _level(measurement, curve)
    for capacity in report.capacities:
        for part in capacity.fixed:
            yield part.name, None, None, None, None, None, None, float(part.reserved_lp), None, "fixed by the manifest"


def _level(measurement: Measurement, index: IndexCurve) -> Sequence[Cell]:
    assert index.threshold is not None
    reserve = reserved_for(measurement, index)
    point = None if reserve is None else index.curve.value_at(reserve)
    measured = {each.reserve for each in index.points}
    return (
        index.component,
        index.index.name,
        index.index.direction,
        float(index.threshold.value),
        index.index.symbol,
        None if point is None else finite(point.value),
        reserve,
        None if reserve is None else float(guaranteed(reserve, measurement.processors)),
        "" if reserve is None else "no" if reserve in measured else "yes",
        verdict_of(index, reserve),
    )


def _measurement(book: "Workbook", name: str, measurement: Measurement) -> None:
    """Its curves below each other, each with its chart beside it."""
    sheet = book.add_worksheet(name)
    top = 0
    for index in measurement.indexes:
        unit = index.index.symbol
        title = f"{index.index.name} of {index.component} ({unit})"
        sheet.write_string(top, 0, title, book.add_format({"bold": True}))
        measured = {point.reserve: finite(point.value) for point in index.points if point.value is not None}
        curve = [
            (row.reserve, *map(finite, (row.value, row.safe, row.low, row.high)), measured.get(row.reserve))
            for row in index.rows
        ]
        header = tuple(f"{word} ({unit})" if place else word for place, word in enumerate(CURVE))
        last = _rows(book, sheet, ((*header, f"measured ({unit})"), *curve), top=top + 1)
        if curve:
            _chart(book, sheet, title, top + 2, last - 1)
        top = max(last + 1, top + 22)


def _chart(book: "Workbook", sheet: "Worksheet", title: str, first: int, last: int) -> None:
    name = sheet.get_name()
    chart = book.add_chart({"type": "scatter", "subtype": "straight"})
    for column, words, dots in ((1, "curve", False), (2, "safe side", False), (5, "measured", True)):
        chart.add_series(
            {
                "name": words,
                "categories": [name, first, 0, last, 0],
                "values": [name, first, column, last, column],
                "marker": {"type": "circle", "size": 6} if dots else {"type": "none"},
                "line": {"none": True} if dots else {"width": 2, "dash_type": "dash" if column == 2 else "solid"},
            }
        )
    chart.set_title({"name": title, "overlay": False, "name_font": {"size": 12}})
    chart.set_x_axis({"name": "reserve (% of the partition's VPs)", "min": 0, "max": 100})
    chart.set_y_axis({"name": title})
    chart.set_size({"width": 640, "height": 360})
    sheet.insert_chart(first - 2, 7, chart)


def _rows(book: "Workbook", sheet: "Worksheet", rows: Rows, top: int = 0) -> int:
    """Writes the rows, the first one as their header; the number of the row below them."""
    header, at = book.add_format({"bold": True, "bottom": 1, "text_wrap": True, "valign": "top"}), top
    for at, row in enumerate(rows, top):
        for column, cell in enumerate(row):
            if isinstance(cell, str):
                sheet.write_string(at, column, cell, header if at == top else None)
            elif cell is not None:
                sheet.write_number(at, column, cell)
    sheet.set_column(0, 19, 16)
    return at + 1
