"""The same measurements as rows of cells, for spreadsheets: units in the headers, numbers as numbers.

What was estimated has six digits that count, far more than any interval is narrow; times of samples have the tenth of a
microsecond that data logs keep. The planner looks its reservations up in the logs, not here.

A text that a spreadsheet would take for a formula stays text: in CSV, which has no types, behind an apostrophe.
"""

import csv
from collections.abc import Iterable, Iterator, Sequence
from io import StringIO
from math import isfinite

from rarms_iac.views.reports.model import Measurement, Point, Report, Shown, Tuning
from rarms_iac.views.reports.scale import UNIT_TEXT

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


def _setting(measurement: Measurement, index: Shown, point: Point) -> Sequence[Cell]:
    threshold = index.threshold
    return (
        index.component,
        measurement.name,
        measurement.platform,
        measurement.interference,
        point.reserve,
        measurement.processors,
        index.index.name,
        UNIT_TEXT[index.index.unit],
        None if point.value is None else finite(point.value),
        None if point.value is None else finite(point.low),
        None if point.value is None else finite(point.high),
        point.samples,
        finite(point.effective),
        point.failed,
        index.index.direction,
        None if threshold is None else float(threshold.value),
        point.verdict,
        None if point.error is None else finite(100 * point.error),
        point.remark,
        measurement.path,
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


def trail_rows(tunings: Iterable[Tuning]) -> Iterator[Sequence[Cell]]:
    """The header, then a row a setting that tuning asked for, in order; the last says what is claimed of the layout."""
    yield TRAIL
    for tuning in tunings:
        for number, asked in enumerate(tuning.run.trail, 1):
            enough = "no" if asked.worse else "yes"
            names, worse = "+".join(asked.components), " ".join(asked.worse)
            claim = tuning.run.claim if number == len(tuning.run.trail) and tuning.run.strategy == "default" else ""
            yield tuning.platform, tuning.run.when, number, names, asked.reserve, enough, worse, asked.predicted, claim


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
