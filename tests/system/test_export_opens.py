"""The exported spreadsheet as LibreOffice sees it."""

import csv
import subprocess
from pathlib import Path

import pytest

from rarms_iac.reports.building import report_of
from rarms_iac.reports.workbook import workbook
from tests.measured_robot import a_robot, the_logs

pytestmark = pytest.mark.needs("libreoffice")


def test_libreoffice_opens_every_sheet_and_its_numbers_are_numbers(tmp_path: Path) -> None:
    system = a_robot()
    report = report_of(system, the_logs(system))
    (tmp_path / "measured.xlsx").write_bytes(workbook(report))
    every_sheet = "csv:Text - txt - csv (StarCalc):44,34,76,1,,0,true,true,false,false,false,-1"
    words = ["soffice", f"-env:UserInstallation={(tmp_path / 'profile').as_uri()}", "--headless", "--convert-to"]

    done = subprocess.run(
        [*words, every_sheet, "--outdir", str(tmp_path), str(tmp_path / "measured.xlsx")],
        capture_output=True,
        timeout=120,
        stdin=subprocess.DEVNULL,
    )

    assert done.returncode == 0, done.stderr
    sheets = {path.stem.removeprefix("measured-") for path in tmp_path.glob("measured-*.csv")}
    assert sheets == {"summary", "face-detection", "speech-recognition", "path-planning", "settings"}
    with (tmp_path / "measured-face-detection.csv").open(encoding="utf-8", newline="") as file:
        quoted = csv.reader(file, quoting=csv.QUOTE_NONNUMERIC)  # texts are quoted, and stay texts
        rows: list[list[object]] = [list(row) for row in quoted]
    shown = report.measurements[0].indexes[0].rows
    assert [row[0] for row in rows[2:93]] == [row.reserve for row in shown]
    assert [row[1] for row in rows[2:93]] == pytest.approx([row.value for row in shown], rel=1e-9)
