"""The tables as CSV and as a spreadsheet: units in the headers, numbers as numbers.

A text that a spreadsheet would take for a formula stays text: in CSV, which has no types, behind an apostrophe.
"""

import csv
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from io import BytesIO, StringIO
from typing import TYPE_CHECKING

from rarms_iac.app.report_model import Measurement, Report
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.texts.findings import NOT_DONE
from rarms_iac.views.reports.tables import levels_table, samples_table, settings_table, totals_table, trail_table
from rarms_iac.views.table import finite

if TYPE_CHECKING:
    from xlsxwriter import Workbook
    from xlsxwriter.worksheet import Worksheet


Rows = Iterable[Sequence[str | int | float | None]]

BEGINNINGS = ("=", "+", "-", "@", "\t", "\n")
"""What a spreadsheet takes for the beginning of a formula."""


def csv_text(rows: Rows) -> str:
    """Write comma-separated rows, quoted where needed, lines ending in LF."""
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for row in rows:
        writer.writerow([_inert(cell) for cell in row])
    return text.getvalue()


def _inert(cell: str | float | None) -> str | float | None:
    if not isinstance(cell, str):
        return cell
    text = cell.replace("\r\n", "\n").replace("\r", "\n")  # Python's writer leaves a lone CR unquoted
    return f"'{text}" if text.startswith(BEGINNINGS) else text


MOST_ROWS = 1_048_576
LONGEST_NAME = 31  # of a sheet
MADE = datetime(2000, 1, 1, tzinfo=UTC)
"""Stands in every file, so that the same report gives the same bytes."""

CURVE = ("reserve (%)", "value", "safe side", "from", "to")


class TooManyRows(Exception):
    """A sheet ends before the samples do."""

    def __init__(self, rows: int, limit: int) -> None:
        super().__init__(f"{rows} rows, and a sheet holds {limit}")
        self.rows = rows
        self.limit = limit

    def finding(self) -> Diagnostic:
        """Say it to who asked for the file."""
        return NOT_DONE.at(
            None,
            "{samples} samples are more than the {most_rows} rows of a sheet.",
            "Export them to a .csv file, or name fewer components.",
            samples=self.rows,
            most_rows=self.limit,
        )


def workbook(report: Report, *, samples: bool = False, most_rows: int = MOST_ROWS) -> bytes:
    """Return the whole file (XLSX).

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
    _rows(book, book.add_worksheet("settings"), settings_table(report).for_files())
    if report.tunings:
        _rows(book, book.add_worksheet("tuning"), trail_table(report.tunings).for_files())
    if samples:
        rows = list(samples_table(report).for_files())
        if len(rows) > most_rows:
            raise TooManyRows(len(rows), most_rows)
        _rows(book, book.add_worksheet("samples"), rows)
    book.close()
    return data.getvalue()


def _names(measurements: Sequence[Measurement]) -> list[str]:
    """Return a name a sheet: the components', short enough and unlike every other."""
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
    last = _rows(book, sheet, levels_table(report).for_files())
    _rows(book, sheet, totals_table(report).for_files(), top=last + 1)


def _measurement(book: "Workbook", name: str, measurement: Measurement) -> None:
    """Write the curves of a measurement below one another, each with its chart."""
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
    """Write the rows, the first one as their header; the number of the row below them."""
    header, at = book.add_format({"bold": True, "bottom": 1, "text_wrap": True, "valign": "top"}), top
    for at, row in enumerate(rows, top):
        for column, cell in enumerate(row):
            if isinstance(cell, str):
                sheet.write_string(at, column, cell, header if at == top else None)
            elif cell is not None:
                sheet.write_number(at, column, cell)
    sheet.set_column(0, 19, 16)
    return at + 1
