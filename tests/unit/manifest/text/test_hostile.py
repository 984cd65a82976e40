"""Hostile input gives a finding with a position, and never needs much memory."""

import subprocess
import sys
from datetime import date
from pathlib import Path

import pytest

from rarms_iac.manifest.load import load_system
from tests.effort import Attempt, tried
from tests.hostile import HOSTILE, HOSTILE_VALUES, Hostile

TODAY = date(2026, 1, 1)
FOLDER = Path(__file__).parents[4]

MEASURE = """
import resource, sys
from datetime import date
from rarms_iac.manifest.load import load_system
import rarms_iac.manifest.document.messages, rarms_iac.manifest.checks
from rarms_iac.manifest.document.reader import manifest_reader
manifest_reader()
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for path in sys.argv[1:]:
    load_system(path, today=date(2026, 1, 1))
    print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024, path)
"""


def told(path: Path, hostile: Hostile) -> list[tuple[str, int, int]]:
    path.write_bytes(hostile.make())
    tried(Attempt.DOCUMENT)
    return [
        (diagnostic.code, diagnostic.place.line, diagnostic.place.column)
        for diagnostic in load_system(str(path), today=TODAY).diagnostics
        if diagnostic.place is not None
    ]


@pytest.mark.parametrize("hostile", HOSTILE, ids=lambda hostile: hostile.name)
def test_hostile_text_is_told_where_it_stands(tmp_path: Path, hostile: Hostile) -> None:
    assert (hostile.code, hostile.line, hostile.column) in told(tmp_path / "rarms.yaml", hostile)


@pytest.mark.parametrize("hostile", HOSTILE_VALUES, ids=lambda hostile: hostile.name)
def test_hostile_values_are_told_where_they_stand(tmp_path: Path, hostile: Hostile) -> None:
    assert (hostile.code, hostile.line, hostile.column) in told(tmp_path / "rarms.yaml", hostile)


@pytest.mark.needs("posix")  # the resource module reads a process's memory
def test_no_hostile_input_needs_more_than_64_mib(tmp_path: Path) -> None:
    """One process reads them all: its peak is that of the worst, and the first line above 64 names it."""
    paths = [tmp_path / f"{at}.yaml" for at in range(len(HOSTILE) + len(HOSTILE_VALUES))]
    for path, hostile in zip(paths, (*HOSTILE, *HOSTILE_VALUES), strict=True):
        path.write_bytes(hostile.make())

    done = subprocess.run(
        [sys.executable, "-c", MEASURE, *map(str, paths)], cwd=FOLDER, capture_output=True, text=True, check=True
    )

    peaks = done.stdout.splitlines()
    assert len(peaks) == len(paths)
    assert [peak for peak in peaks if int(peak.split()[0]) > 64] == []


def test_a_file_of_100_mb_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "rarms.yaml"
    with path.open("wb") as file:
        file.truncate(100_000_000)

    finding = load_system(str(path), today=TODAY).diagnostics[0]

    assert finding.code == "RARMS001"
    assert "more than 8 MiB" in finding.detail


def test_a_missing_file(tmp_path: Path) -> None:
    assert [diagnostic.code for diagnostic in load_system(str(tmp_path / "none.yaml"), today=TODAY).diagnostics] == [
        "RARMS001"
    ]


def test_a_name_that_no_file_can_have() -> None:
    assert [diagnostic.code for diagnostic in load_system("rarms\0.yaml", today=TODAY).diagnostics] == ["RARMS001"]


def test_standard_input_is_read_up_to_the_limit() -> None:
    program = "from datetime import date; from rarms_iac.manifest.load import load_system; "
    program += "print(*[(d.code, str(d.place)) for d in load_system('-', today=date(2026, 1, 1)).diagnostics])"

    done = subprocess.run(
        [sys.executable, "-c", program], cwd=FOLDER, input=b"#" * 9_000_000, capture_output=True, check=True
    )

    assert done.stdout.decode().strip() == "('RARMS001', '<stdin>:1:1')"
