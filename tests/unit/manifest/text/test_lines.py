"""Lines of a text are found by counting line ends of every kind."""

import re
import time

import pytest

from rarms_iac.manifest.text.characters import place_of
from rarms_iac.manifest.text.reading import MAX_BYTES, Lines

TEXTS = [b"", b"\n", b"a", b"a\nb", b"a\r\nb\rc\n\nd", b"\r\r\n\r", "\u00e9\n\u00fc\r".encode()]


@pytest.mark.parametrize("data", TEXTS)
def test_each_line_is_what_stands_between_line_ends(data: bytes) -> None:
    expected = re.split("\r\n|\n|\r", data.decode())
    lines = Lines(data)

    assert list(lines) == expected
    assert [lines[-at] for at in range(1, len(expected) + 1)] == expected[::-1]
    assert lines[1:] == expected[1:]
    with pytest.raises(IndexError):
        lines[len(expected)]


def test_megabytes_of_carriage_returns_are_quick() -> None:
    data = b"\r" * (MAX_BYTES - 1) + b"["
    began = time.process_time()

    assert Lines(data)[MAX_BYTES - 1] == "["
    assert place_of(data, MAX_BYTES - 1, "x").line == MAX_BYTES
    assert time.process_time() - began < 2
