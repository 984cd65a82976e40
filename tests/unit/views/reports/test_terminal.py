"""The plot in the terminal: complete without colour, as wide as there is room, in ASCII where that is all there is."""

import re
from dataclasses import replace

import pytest

from rarms_iac.app.report_model import IndexCurve
from rarms_iac.model.indexes import find_index
from rarms_iac.statistics.curves import curve_of
from rarms_iac.views.console import render
from rarms_iac.views.reports.terminal import ASCII, UNICODE, TerminalPlot, report_text
from tests.builders import a_run, at_most
from tests.robots import a_robot, report_of_logs, the_logs

SYSTEM = a_robot()
REPORT = report_of_logs(SYSTEM, the_logs(SYSTEM))
FACES = REPORT.measurements[0].indexes[0]


def plot_text(curve: IndexCurve, *, width: int = 80, ascii_only: bool = False, colour: bool = False) -> str:
    return render(TerminalPlot(curve=curve, ascii_only=ascii_only), width, colour=colour)


def nothing_known() -> IndexCurve:
    index = find_index("mean_response_time")
    assert index is not None
    curve = curve_of([], "vision", index.name, a_run())
    return IndexCurve(component="vision", index=index, threshold=at_most(100), curve=curve, points=())


def field_of(text: str, axis: str, tick: str) -> list[str]:
    """The rows of the field, right of the axis."""
    return [re.split(f"[{re.escape(axis + tick)}]", line, maxsplit=1)[1] for line in text.splitlines()[1:15]]


def test_threshold_and_reserve_are_lines() -> None:
    text = plot_text(FACES, width=80, ascii_only=True)

    field = field_of(text, "|", "+")
    assert len([row for row in field if row.count(ASCII.threshold) > 40]) == 1
    column = int(60 / 100 * 68)
    assert {row.ljust(80)[column] for row in field} <= {":", "+", "o", "*"}
    assert sum(row.count("o") for row in field) == 10
    assert text.splitlines()[-1] == "at most 100 ms: reserve 60 % of its VPs"


def test_a_scale_that_is_logarithmic_is_called_so() -> None:
    shares = next(index for each in REPORT.measurements for index in each.indexes if index.index.name == "success_rate")

    assert plot_text(FACES).splitlines()[0].endswith("mean_response_time (ms, log scale) against CR (% of its VPs)")
    assert plot_text(shares).splitlines()[0].endswith("success_rate (%) against CR (% of its VPs)")


@pytest.mark.parametrize("width", [40, 60, 80, 120])
@pytest.mark.parametrize("ascii_only", [False, True])
def test_no_line_is_wider_than_the_terminal(width: int, ascii_only: bool) -> None:
    for measurement in REPORT.measurements:
        for shown in measurement.indexes:
            lines = plot_text(shown, width=width, ascii_only=ascii_only).splitlines()
            assert max(map(len, lines)) <= width


def test_ascii_is_ascii_and_otherwise_braille_is_drawn() -> None:
    assert plot_text(FACES, ascii_only=True).isascii()
    assert any("\u2800" < sign <= "\u28ff" for sign in plot_text(FACES))
    assert plot_text(FACES).count(UNICODE.measured) == 10


def test_colour_changes_no_sign() -> None:
    coloured = plot_text(FACES, colour=True)

    assert "\x1b[" in coloured
    plain = re.sub(r"\x1b\[[0-9;]*m", "", coloured)
    assert [line.rstrip() for line in plain.splitlines()] == plot_text(FACES).splitlines()


def test_what_cannot_be_plotted_is_said() -> None:
    assert plot_text(nothing_known()).splitlines()[1] == "  No result yet."
    assert plot_text(replace(FACES, threshold=at_most(1))).splitlines()[-1] == (
        "at most 1 ms: not known with this load"
    )
    assert plot_text(replace(FACES, threshold=None)).splitlines()[-1] == "No threshold yet."


def test_text_report_has_summary_total_and_every_plot() -> None:
    text = render(report_text(REPORT))

    assert "onboard: 1.72 LP of 2 LP reserved (86 % of onboard)" in text
    assert re.search(r"face-detection +onboard +mean.* 1\.2 LP +met", text)
    assert text.count("against CR") == 4
