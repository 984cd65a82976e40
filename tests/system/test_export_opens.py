"""The exported spreadsheet as LibreOffice sees it."""

import csv
import subprocess
import zipfile
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from rarms_iac.app.report_model import Report
from rarms_iac.views.reports.spreadsheet import workbook
from tests.robots import a_robot, report_of_logs, the_logs

pytestmark = pytest.mark.needs("libreoffice")


CHART = "{urn:oasis:names:tc:opendocument:xmlns:chart:1.0}"


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Report]:
    """The workbook of a measured robot, and what it shows."""
    system = a_robot()
    report = report_of_logs(system, the_logs(system))
    path = tmp_path_factory.mktemp("export") / "measured.xlsx"
    path.write_bytes(workbook(report))
    return path, report


def converted(path: Path, form: str) -> Path:
    """What LibreOffice makes of it, in this folder."""
    profile = (path.parent / "profile").as_uri()
    words = ["soffice", f"-env:UserInstallation={profile}", "--headless", "--convert-to", form]
    done = subprocess.run(
        [*words, "--outdir", str(path.parent), str(path)],
        capture_output=True,
        timeout=120,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 0, done.stderr
    return path.parent


def test_libreoffice_opens_sheets_with_real_numbers(exported: tuple[Path, Report]) -> None:
    path, report = exported

    folder = converted(path, "csv:Text - txt - csv (StarCalc):44,34,76,1,,0,true,true,false,false,false,-1")

    sheets = {path.stem.removeprefix("measured-") for path in folder.glob("measured-*.csv")}
    assert sheets == {"summary", "face-detection", "speech-recognition", "path-planning", "settings"}
    with (folder / "measured-face-detection.csv").open(encoding="utf-8", newline="") as file:
        quoted = csv.reader(file, quoting=csv.QUOTE_NONNUMERIC)  # texts are quoted, and stay texts
        rows: list[list[object]] = [list(row) for row in quoted]
    shown = report.measurements[0].indexes[0].rows
    assert [row[0] for row in rows[2:93]] == [row.reserve for row in shown]
    assert [row[1] for row in rows[2:93]] == pytest.approx([row.value for row in shown], rel=1e-5)


def test_libreoffice_keeps_each_chart_with_its_series(exported: tuple[Path, Report]) -> None:
    path, report = exported

    charts = list(charts_of(converted(path, "ods") / "measured.ods"))

    curves = [index for measurement in report.measurements for index in measurement.indexes]
    assert len(charts) == len(curves)
    for chart in charts:
        series = list(chart.iter(f"{CHART}series"))
        assert len(series) == 3, "the curve, its safe side, what was measured"
        assert all(element.get(f"{CHART}values-cell-range-address") for element in series)
    titles = ["".join(chart.find(f".//{CHART}title").itertext()) for chart in charts]  # type: ignore[union-attr]
    assert sorted(titles) == sorted(
        f"{curve.index.name} of {curve.component} ({curve.index.symbol})" for curve in curves
    )


def charts_of(book: Path) -> Iterator[ET.Element]:
    """The charts that an OpenDocument sheet holds."""
    with zipfile.ZipFile(book) as parts:
        for name in sorted(parts.namelist()):
            if name.startswith("Object ") and name.endswith("/content.xml") and name.count("/") == 1:
                chart = ET.fromstring(parts.read(name)).find(f".//{CHART}chart")
                if chart is not None:
                    yield chart
