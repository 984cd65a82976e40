"""Hostile input gives a finding with a position, and never needs much memory."""

import re
import subprocess
import sys
import time
from datetime import date
from pathlib import Path
from typing import Any

import pytest

from rarms_iac.manifest.load import load_system
from rarms_iac.manifest.text.events import NotRepresentable, plain_scalar
from rarms_iac.manifest.text.reading import MAX_BYTES, read_text
from rarms_iac.manifest.text.tree import ManifestPlaces, dotted
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
    assert "larger than 8 MiB" in finding.detail


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


TEXT = """\
a:
  b: [x, {c: 'é d'}]
"e f":
  g: 1
"""
PLACES = ManifestPlaces(lambda: read_text(TEXT.encode(), "f.yaml", ".").tree().root)


@pytest.mark.parametrize(
    ("path", "value", "key"),
    [
        ((), (1, 1), (1, 1)),
        (("a",), (2, 3), (1, 1)),
        (("a", "b"), (2, 6), (2, 3)),
        (("a", "b", 0), (2, 7), (2, 7)),
        (("a", "b", 1, "c"), (2, 14), (2, 11)),
        (("e f", "g"), (4, 6), (4, 3)),
        (("e f", "none"), (3, 1), (3, 1)),
        (("none", "deeper"), (1, 1), (1, 1)),
        (("a", "b", 7), (2, 3), (2, 3)),
    ],
)
def test_a_path_has_a_place(path: tuple[str | int, ...], value: tuple[int, int], key: tuple[int, int]) -> None:
    found, named = PLACES.value(*path), PLACES.key(*path)

    assert ((found.line, found.column), (named.line, named.column)) == (value, key)
    assert found.path == named.path == dotted(path)


def test_a_place_says_how_much_to_underline() -> None:
    assert PLACES.value("a", "b", 1, "c").length == len("'é d'")
    assert PLACES.key("e f").length == len('"e f"')


def test_a_path_is_written_as_people_do() -> None:
    assert dotted(("components", "a b", "apart", 0)) == "components.a b.apart[0]"
    assert dotted(("p99.9_response_time", "x")) == '"p99.9_response_time".x'


@pytest.mark.parametrize(
    ("text", "value"),
    [
        *[(word, word) for word in ("no", "yes", "on", "off", "y", "N", "nO", "2027-01-31", "1_000", "0b1", "12:30")],
        *[
            (word, word)
            for word in ("88 ms", "1.4 LP", "１２", "٣", "+", "-", ".", "0x", "0o8", "nul", "truE", "1e", "é")
        ],
        *[(word, None) for word in ("", "~", "null", "Null", "NULL")],
        *[(word, True) for word in ("true", "True", "TRUE")],
        *[(word, False) for word in ("false", "False", "FALSE")],
        *[("0640", 640), ("-7", -7), ("+7", 7), ("0o17", 15), ("0xfF", 255), ("007", 7), ("0" * 30 + "1", 1)],
        *[("1.5", 1.5), (".5", 0.5), ("1e3", 1000), ("2.0", 2), ("-0.0", 0), ("1e300", 1e300), ("1.", 1)],
    ],
)
def test_plain_word_means_what_yaml_1_2_says(text: str, value: Any) -> None:
    found = plain_scalar(text)

    assert (type(found), found) == (type(value), value)


@pytest.mark.parametrize(
    "text", ["9" * 16, "-" + "9" * 5000, "0x" + "f" * 16, "1e999", ".inf", "-.Inf", ".nan", ".NaN"]
)
def test_what_cannot_be_kept_is_refused(text: str) -> None:
    with pytest.raises(NotRepresentable):
        plain_scalar(text)


TEXTS = [b"", b"\n", b"a", b"a\nb", b"a\r\nb\rc\n\nd", b"\r\r\n\r", "\u00e9\n\u00fc\r".encode()]


@pytest.mark.parametrize("data", TEXTS)
def test_each_line_is_what_stands_between_line_ends(data: bytes) -> None:
    expected = re.split("\r\n|\n|\r", data.decode())
    lines = read_text(data, "x", ".").source.lines

    assert list(lines) == expected
    assert [lines[-at] for at in range(1, len(expected) + 1)] == expected[::-1]
    assert lines[1:] == expected[1:]
    with pytest.raises(IndexError):
        lines[len(expected)]


def test_megabytes_of_carriage_returns_are_quick() -> None:
    data = b"\r" * (MAX_BYTES - 1) + b"["
    began = time.process_time()

    source = read_text(data, "x", ".").source

    assert source.lines[MAX_BYTES - 1] == "["
    assert source.place(MAX_BYTES - 1).line == MAX_BYTES
    assert time.process_time() - began < 2
