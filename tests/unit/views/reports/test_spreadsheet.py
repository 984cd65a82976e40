"""CSV and XLSX: numbers are numbers, every row is there, and no text becomes a formula."""

import csv
from collections.abc import Sequence
from dataclasses import replace
from io import BytesIO, StringIO

import openpyxl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.app.report_model import Report
from rarms_iac.model.series import Sample
from rarms_iac.views.reports.spreadsheet import TooManyRows, csv_text, workbook
from rarms_iac.views.reports.tables import samples_table, settings_table
from tests.robots import a_robot, report_of_logs, the_logs

SYSTEM = a_robot()
REPORT = report_of_logs(SYSTEM, the_logs(SYSTEM))

SMALL = replace(
    REPORT,
    measurements=tuple(
        replace(measurement, settings=measurement.settings[:1]) for measurement in REPORT.measurements[:1]
    ),
)


def read(text: str) -> list[list[str]]:
    return list(csv.reader(StringIO(text)))


def with_failures(report: Report, messages: Sequence[str]) -> Report:
    """The first samples of all failed for these reasons, and nothing else was measured."""
    first, *_ = report.measurements
    setting, *_ = first.settings
    [series] = setting.series
    failed = [
        Sample(began_ms=float(number), response_ms=None, successful=False, failure=message)
        for number, message in enumerate(messages)
    ]
    broken = replace(setting, series=(replace(series, samples=(*failed, *series.samples[len(failed) :])),))
    return replace(report, measurements=(replace(first, settings=(broken,)),))


def test_csv_has_a_row_for_each_value() -> None:
    header, *rows = read(csv_text(settings_table(REPORT).for_files()))

    assert header[3:10] == [
        "interference",
        "reserve (% of the partition's VPs)",
        "processors (VPs)",
        "index",
        "unit",
        "value",
        "interval from",
    ]
    assert len(rows) == 10 + 2 * 7 + 3
    points = [point for measurement in REPORT.measurements for index in measurement.indexes for point in index.points]
    for column, values in (
        ("value", [point.value for point in points]),
        ("interval from", [point.low for point in points]),
        ("interval to", [point.high for point in points]),
        ("effective samples", [point.effective for point in points]),
    ):
        texts = [row[header.index(column)] for row in rows]
        assert [float(text) for text in texts] == pytest.approx(values, rel=1e-5), column
        assert all(len(text.replace(".", "").strip("0")) <= 6 for text in texts), column
    assert [int(row[header.index("samples")]) for row in rows] == [2000] * len(rows)


def test_csv_of_samples_has_a_row_each() -> None:
    header, *rows = read(csv_text(samples_table(REPORT).for_files()))

    assert len(rows) == 20 * 2000
    times = [row[header.index(name)] for row in rows for name in ("began (ms)", "response time (ms)")]
    assert all(float(time) >= 0 and len(time.partition(".")[2]) <= 4 for time in times)


@given(st.text())
def test_no_text_becomes_a_formula(message: str) -> None:
    [row] = read(csv_text([("=1+1", message, -1.5)]))

    assert row[0] == "'=1+1"
    assert not row[1].startswith(("=", "+", "-", "@", "\t", "\r", "\n"))
    assert row[2] == "-1.5"


def test_in_a_workbook_texts_are_text() -> None:
    messages = ["=HYPERLINK(1)", "+1", "-1", "@SUM(A1)", "{=1}", "https://example.org"]
    book = openpyxl.load_workbook(BytesIO(workbook(with_failures(REPORT, messages), samples=True)))

    header, *rows = book["samples"].iter_rows(max_row=1 + len(messages))
    column = [cell.value for cell in header].index("failure")
    cells = [row[column] for row in rows]
    assert [(cell.value, cell.data_type, cell.hyperlink) for cell in cells] == [(text, "s", None) for text in messages]


def test_workbook_has_summary_sheet_log_and_chart_curve() -> None:
    book = openpyxl.load_workbook(BytesIO(workbook(REPORT)))

    assert book.sheetnames == ["summary", "face-detection", "speech-recognition", "path-planning", "settings"]
    assert [charts_of(book[name]) for name in book.sheetnames] == [0, 1, 2, 1, 0]
    rows = list(book["summary"].iter_rows(values_only=True))
    assert rows[1][:6] == ("face-detection", "onboard", "mean_response_time", "at_most", 100, "ms")
    assert rows[1][7:9] == (1.2, 60)
    assert rows[-1][:5] == ("onboard", "onboard", 2, "exactly", 1.72)
    shown = REPORT.measurements[0].indexes[0].rows
    curve = [[float(str(cell)) for cell in row[:3]] for row in list(book["face-detection"].values)[2:93]]
    assert [reserve for reserve, _, _ in curve] == [row.reserve for row in shown]
    assert [value for _, value, _ in curve] == pytest.approx([row.value for row in shown], rel=1e-5)
    assert [safe for _, _, safe in curve] == pytest.approx([row.safe for row in shown], rel=1e-5)


def charts_of(sheet: object) -> int:
    """How many charts openpyxl found in it: it says so only in private."""
    return len(getattr(sheet, "_charts", ()))


def test_the_same_report_gives_the_same_bytes() -> None:
    assert workbook(SMALL, samples=True) == workbook(SMALL, samples=True)


def test_names_of_sheets_are_short_and_differ() -> None:
    long = [replace(measurement, components=("x" * 60,)) for measurement in REPORT.measurements]

    names = openpyxl.load_workbook(BytesIO(workbook(replace(REPORT, measurements=tuple(long))))).sheetnames

    assert len({name.lower() for name in names}) == len(names) == 5
    assert max(map(len, names)) <= 31


def test_more_samples_than_a_sheet_holds_are_refused() -> None:
    with pytest.raises(TooManyRows) as refused:
        workbook(SMALL, samples=True, most_rows=2000)

    assert (refused.value.rows, refused.value.limit) == (2001, 2000)
