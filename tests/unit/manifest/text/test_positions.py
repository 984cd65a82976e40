"""Places: where a value and its key stand."""

import pytest

from rarms_iac.manifest.text.positions import ManifestPlaces, dotted
from rarms_iac.manifest.text.reading import Lines
from rarms_iac.manifest.text.tree import build_positions

TEXT = """\
a:
  b: [x, {c: 'é d'}]
"e f":
  g: 1
"""
PLACES = ManifestPlaces(lambda: build_positions(TEXT, "f.yaml"))


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


def test_lines_end_as_editors_end_them() -> None:
    lines = Lines(b"a\r\nb\rc\n")

    assert list(lines) == ["a", "b", "c", ""]
    assert (lines[0], lines[2], lines[-1], len(lines), lines[1:3]) == ("a", "c", "", 4, ["b", "c"])
    with pytest.raises(IndexError):
        lines[4]
