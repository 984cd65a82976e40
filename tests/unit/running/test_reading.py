"""A line to what it says of a job, without any process."""

from fractions import Fraction

import pytest

from rarms_iac.model.run import Field, Samples
from rarms_iac.running.reading import Reading, Unreadable, line_reader

JSON = Samples(source="json_lines", response_time=Field(name="ms"))
WHOLE = Samples(
    source="json_lines",
    response_time=Field(name="job.took", factor=Fraction(1000)),
    success=Field(name="ok"),
    count=Field(name="job.frames"),
)
OPTIONAL = Samples(
    source="pattern", pattern=r"^job( took (?P<ms>\S+))?$", response_time=Field(name="ms"), success=None, count=None
)

UNREADABLE = {
    "no object": ("[1]", 'not a JSON object: "[1]"'),
    "no JSON": ("oops \x1b[2J", 'not a JSON object: "oops <U+001B>[2J"'),
    "not finite": ('{"ms": NaN}', 'not a JSON object: "{"ms": NaN}"'),
    "too large": ('{"ms": 1e999}', 'the field "ms" is "Infinity", not a time'),
    "no field": ('{"s": 1}', 'no field "ms" in "{"s": 1}"'),
    "no number": ('{"ms": "soon"}', 'the field "ms" is ""soon"", not a time'),
    "a truth": ('{"ms": true}', 'the field "ms" is "true", not a time'),
    "before its start": ('{"ms": -1}', 'the field "ms" is "-1", not a time'),
    "a huge number": ('{"ms": 1' + "0" * 5000 + "}", "not a JSON object"),
    "deep": ("[" * 60_000, "not a JSON object"),
}


@pytest.mark.parametrize(("line", "message"), UNREADABLE.values(), ids=UNREADABLE.keys())
def test_what_is_no_sample_says_why(line: str, message: str) -> None:
    found = line_reader(JSON)(line)

    assert isinstance(found, Unreadable)
    assert found.message.startswith(message)
    assert found.message.isprintable()


@pytest.mark.parametrize(
    ("line", "reading"),
    [
        ('{"ms": 1.5}', Reading(response_ms=1.5)),
        ('{"ms": "1.5", "more": [1]}', Reading(response_ms=1.5)),
        ('{"ms": null}', Reading(response_ms=None, successful=False)),
    ],
)
def test_a_field_is_a_number_or_null(line: str, reading: Reading) -> None:
    assert line_reader(JSON)(line) == reading


@pytest.mark.parametrize(
    ("success", "means"),
    [("true", True), ("false", False), ("1", True), ("0", False), ('"True"', True), ('"0"', False)],
)
def test_dots_lead_into_objects_and_units_into_ours(success: str, means: bool) -> None:
    found = line_reader(WHOLE)('{"job": {"took": 0.25, "frames": 3}, "ok": ' + success + "}")

    assert found == Reading(response_ms=250, successful=means, count=3)


def test_a_key_with_a_dot_in_it_comes_before_the_way_into_an_object() -> None:
    found = line_reader(WHOLE)('{"job.took": 1, "job": {"took": 2, "frames": 1}, "ok": true}')

    assert found == Reading(response_ms=1000)


def test_a_group_that_took_no_part_is_a_job_without_an_answer() -> None:
    read = line_reader(OPTIONAL)

    assert read("job took 12") == Reading(response_ms=12)
    assert read("job") == Reading(response_ms=None, successful=False)
    assert read("something else") is None
    assert isinstance(read("job took ages"), Unreadable)


def test_a_line_is_shown_short_and_harmless() -> None:
    unreadable = line_reader(JSON)("\x1b]0;title\x07" + "x" * 100)

    assert unreadable == Unreadable(message='not a JSON object: "<U+001B>]0;title<U+0007>' + "x" * 50 + '..."')
