"""A line to what it says of a job, without any process."""

import json
from base64 import b64encode, encodebytes, urlsafe_b64encode
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from urllib.parse import quote

import pytest

from rarms_iac.model.run import Field, FromEnvironment, Samples, TimeField
from rarms_iac.running.component import ComponentRun
from rarms_iac.running.orders import StartContext
from rarms_iac.running.reading import Reading, Unreadable, line_reader
from rarms_iac.running.secrets import hide_secrets
from tests.unit.running.programs import a_run

JSON = Samples(source="json_lines", response_time=TimeField(field="ms", unit="ms"))
WHOLE = Samples(
    source="json_lines",
    response_time=TimeField(field="job.took", unit="s"),
    success=Field(field="ok"),
    count=Field(field="job.frames"),
)
OPTIONAL = Samples(
    source="pattern", pattern=r"^job( took (?P<ms>\S+))?$", response_time=TimeField(field="ms", unit="ms")
)

UNREADABLE = {
    "no JSON": ("{oops \x1b[2J", 'not a JSON object: "{oops <U+001B>[2J"'),
    "a decimal comma": ('{"ms": "12,5"}', 'the field "ms" is ""12,5"", not a time'),
    "thousands": ('{"ms": "1_200"}', 'the field "ms" is ""1_200"", not a time'),
    "hexadecimal": ('{"ms": "0x10"}', 'the field "ms" is ""0x10"", not a time'),
    "not finite": ('{"ms": NaN}', 'not a JSON object: "{"ms": NaN}"'),
    "too large": ('{"ms": 1e999}', 'the field "ms" is "Infinity", not a time'),
    "no field": ('{"s": 1}', 'no field "ms" in "{"s": 1}"'),
    "no number": ('{"ms": "soon"}', 'the field "ms" is ""soon"", not a time'),
    "a truth": ('{"ms": true}', 'the field "ms" is "true", not a time'),
    "before its start": ('{"ms": -1}', 'the field "ms" is "-1", not a time'),
    "a huge number": ('{"ms": 1' + "0" * 5000 + "}", "not a JSON object"),
    "deep": ('{"ms": ' + "[" * 60_000, "not a JSON object"),
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


def test_dotted_key_comes_before_object() -> None:
    found = line_reader(WHOLE)('{"job.took": 1, "job": {"took": 2, "frames": 1}, "ok": true}')

    assert found == Reading(response_ms=1000)


def test_unmatched_group_gives_no_answer() -> None:
    read = line_reader(OPTIONAL)

    assert read("job took 12") == Reading(response_ms=12)
    assert read("job") == Reading(response_ms=None, successful=False)
    assert read("something else") is None
    assert isinstance(read("job took ages"), Unreadable)


def test_a_line_is_shown_short_and_harmless() -> None:
    unreadable = line_reader(JSON)("{\x1b]0;title\x07" + "x" * 100)

    assert unreadable == Unreadable(message='not a JSON object: "{<U+001B>]0;title<U+0007>' + "x" * 49 + '..."')


@pytest.mark.parametrize("line", ["[1]", "12", "loading the model", '"{}"', "[" * 60_000])
def test_other_text_than_an_object_is_skipped(line: str) -> None:
    assert line_reader(JSON)(line) is None


def took(pattern: str) -> Samples:
    return Samples(source="pattern", pattern=pattern, response_time=TimeField(field="t", unit="ms"))


@pytest.mark.parametrize(
    ("text", "part", "whole"),
    [
        ("1.23457e+06 us", "1.23457", "1.23457e+06"),
        ("2E5", "2", "2E5"),
        ("12,5", "12", "12,5"),
        ("1,200", "1", "1,200"),
        ("1'200", "1", "1'200"),
        ("1_200", "1", "1_200"),
        ("1\u202f200", "1", "1<U+202F>200"),
        ("0x10", "0", "0x10"),
    ],
)
def test_group_with_part_of_number_fails(text: str, part: str, whole: str) -> None:
    found = line_reader(took("took (?P<t>[0-9.]+)"))(f"took {text}, done")

    assert found == Unreadable(message=f'the field "t" reads "{part}", only a part of "{whole}"')


@pytest.mark.parametrize(
    ("pattern", "line", "whole"),
    [
        ("(?P<t>[0-9]+) us", "took 1.234 us", "1.234"),
        ("(?P<t>[0-9.]+) us", "took 1.23457e+06 us", "1.23457e+06"),
        ("(?P<t>[0-9.]+) us", "took 1,200 us", "1,200"),
        (".*(?P<t>[0-9.]+) us", "took 106 us", "106"),
        ("(?P<t>[0-9]+) us", "took -5 us", "-5"),
        ("(?P<t>[0-9]+) us", "took=.5 us", "5"),
        ("0x(?P<t>[0-9]+)", "took 0x10", "0x10"),
        ("took (?P<t>[0-9]{1,3})", "took 1234", "1234"),
        ("took (?P<t>[0-9]+)(,[0-9]+)?", "took 12,5", "12,5"),
    ],
)
def test_the_end_of_a_number_fails_too(pattern: str, line: str, whole: str) -> None:
    found = line_reader(took(pattern))(line)

    assert isinstance(found, Unreadable)
    assert found.message.endswith(f'only a part of "{whole}"')


@pytest.mark.parametrize(
    ("pattern", "line", "ms"),
    [
        ("took (?P<t>[0-9.]+)", "took 12ms", 12),
        ("took (?P<t>[0-9.]+)", "took 1.2s, done", 1.2),
        ("took (?P<t>[0-9.]+)", "took 1.2, 3.4", 1.2),
        ("took (?P<t>[0-9.]+)", "took 12.", 12),
        ("took (?P<t>[0-9.]+)", "took 12-15", 12),
        ("took (?P<t>[0-9.]+)", "took 12ex3", 12),
        (r"took (?P<t>\S+)", "took 1.5e3", 1500),
        ("t=(?P<t>[0-9]+),(?P<n>[0-9]+)", "t=12,5", 12),
        ("(?P<n>[0-9]),(?P<t>[0-9.]+) ms", "7,2.5 ms", 2.5),
        ("(?P<s>[0-9])(?P<t>[0-9]{3}) ms", "7250 ms", 250),
        ("cam0: (?P<t>[0-9]+)", "cam0: 250 ms", 250),
    ],
)
def test_whole_numbers_are_read(pattern: str, line: str, ms: float) -> None:
    assert line_reader(took(pattern))(line) == Reading(response_ms=ms)


@pytest.mark.parametrize(
    ("pattern", "line", "number"),
    [
        ("took (?P<t>[0-9.]+) us", "took 1.23457e+06 us", "1.23457e+06"),
        ("took (?P<t>[0-9.]+) us", "took 12,5 us", "12,5"),
        ("took (?P<t>[0-9.]+) us", "took 1,200 us", "1,200"),
        ("took (?P<t>[0-9.]+) us", "took 0x10 us", "0x10"),
        ("took (?P<t>[0-9.]+) us", "took -5 us", "-5"),
        ("took (?P<t>[0-9.]+) us", "took inf us", "inf"),
        ("took (?P<t>[0-9]+) us", "took 12.5 us", "12.5"),
        (r"took (?P<t>[0-9]+\.[0-9]+) us", "took 2e+06 us", "2e+06"),
        (r"^[0-9]+\.[0-9]+ took (?P<t>[0-9.]+) us", "0.5 took 2e+06 us", "2e+06"),
    ],
)
def test_a_number_that_the_pattern_cannot_take_fails(pattern: str, line: str, number: str) -> None:
    assert line_reader(took(pattern))(line) == Unreadable(message=f'the field "t" cannot have all of "{number}"')


@pytest.mark.parametrize("line", ["loading 1.5e3 files", "took 1.5e3 s", "12:30:00.5 took long", "took 5us 1e3", "1e3"])
def test_line_without_number_is_skipped(line: str) -> None:
    assert line_reader(took("took (?P<t>[0-9.]+) us"))(line) is None


def test_only_a_comma_between_two_groups_parts_values() -> None:
    for pattern, line in (
        (r"(?P<t>[0-9]+)\.(?P<n>[0-9]+) us", "12.5 us"),
        (r"(?P<t>[0-9.]+)e\+(?P<n>[0-9]+) us", "1.5e+06 us"),
    ):
        assert isinstance(line_reader(took(pattern))(line), Unreadable)


def test_part_of_success_or_count_fails_too() -> None:
    samples = Samples(
        source="pattern", pattern="ok=(?P<ok>[01]).* n=(?P<n>[0-9]+)", success=Field(field="ok"), count=Field(field="n")
    )

    assert isinstance(line_reader(samples)("ok=0.97 n=3"), Unreadable)
    assert isinstance(line_reader(samples)("ok=1 n=3e2"), Unreadable)
    assert line_reader(samples)("ok=1 n=3") == Reading(successful=True, count=3)


def test_a_long_line_of_digits_is_refused_quickly() -> None:
    assert isinstance(line_reader(took("(?P<t>[0-9]{6})"))("1," * 30_000 + "1234567"), Unreadable)
    assert line_reader(took("took (?P<t>[0-9]+)"))("1,2 -" * 13_000) is None


SECRET = 'hunter2 "&\u00e9\\x'

AS_JSON = (json.dumps(SECRET)[1:-1], json.dumps(SECRET, ensure_ascii=False)[1:-1])


@pytest.mark.parametrize("form", [SECRET, *AS_JSON, repr(SECRET)[1:-1], ascii(SECRET)[1:-1], quote(SECRET)])
def test_a_value_is_hidden_in_each_form(form: str) -> None:
    hide = hide_secrets(replace(a_run(""), environment={"TOKEN": FromEnvironment(name="MINE")}), {"MINE": SECRET}, {})

    assert hide(f"login {form} failed") == "login <MINE> failed"


@pytest.mark.parametrize("encode", [b64encode, urlsafe_b64encode])
@pytest.mark.parametrize("after", ["", "\n", " and more"])
@pytest.mark.parametrize("before", ["", "u", "me", "user:"])
def test_base64_of_a_value_is_hidden(before: str, after: str, encode: Callable[[bytes], bytes]) -> None:
    value = "s3cr3t>?value~~"
    hide = hide_secrets(replace(a_run(""), environment={"TOKEN": FromEnvironment(name="MINE")}), {"MINE": value}, {})

    text = encode(f"{before}{value}{after}".encode()).decode()

    assert before or hide(text.rstrip("=")).startswith("<MINE>")
    others = hide(text).replace("<MINE>", "")
    assert len(others) <= len(encode(f"{before}{after}".encode())) + 2  # those that are also of a neighbour
    assert len(hide(text)) > len(others)


def test_base64_of_long_value_is_hidden_in_lines() -> None:
    value = "".join(map(chr, range(33, 120)))
    hide = hide_secrets(replace(a_run(""), environment={"TOKEN": FromEnvironment(name="MINE")}), {"MINE": value}, {})

    lines = encodebytes(value.encode()).decode().splitlines()

    assert [hide(line) for line in lines] == ["<MINE>"] * len(lines)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ('not a JSON object: "login s3cr3t-va..."', 'not a JSON object: "login <MINE>..."'),
        ("RuntimeError: s3cr3t-valu", "RuntimeError: <MINE>"),
        ("3t-value failed", "<MINE> failed"),
        ("s3cr3t is a word, t-value another", "s3cr3t is a word, t-value another"),
    ],
)
def test_what_cut_left_of_value_is_hidden(text: str, shown: str) -> None:
    run = replace(a_run(""), environment={"TOKEN": FromEnvironment(name="MINE")})

    assert hide_secrets(run, {"MINE": "s3cr3t-value"}, {})(text) == shown


def test_a_line_of_a_value_is_hidden() -> None:
    run = replace(a_run(""), environment={"TOKEN": FromEnvironment(name="MINE")})

    assert hide_secrets(run, {"MINE": "first-line\nsecond-line"}, {})("read second-line;") == "read <MINE>;"


def test_value_in_long_line_is_in_no_reason(tmp_path: Path) -> None:
    run = a_run("say('{' + 'x' * 39 + os.environ['TOKEN'])\ntime.sleep(60)", until=1, failures=1)
    run = replace(run, environment={**run.environment, "TOKEN": FromEnvironment(name="MINE")})
    context = StartContext(base=tmp_path, environment={"MINE": "s3cr3t-value" * 4, "PATH": ""})

    with ComponentRun("vision", run, context) as running:
        (sample,) = list(running)

    assert "s3cr3t" not in sample.failure
    assert "<MINE>..." in sample.failure


def test_short_value_and_one_of_another_variable_stay() -> None:
    run = replace(a_run(""), environment={"TOKEN": FromEnvironment(name="MINE"), "OTHER": "visible text"})

    assert hide_secrets(run, {"MINE": "short"}, {})("a short, visible text") == "a short, visible text"


def test_printed_secrets_are_not_recorded(tmp_path: Path) -> None:
    program = "import os\nsys.stderr.write(os.environ['TOKEN'])\nsys.stderr.flush()\nsay('{x' + os.environ['TOKEN'])\n"
    run = a_run(f"{program}time.sleep(60)", until=1, failures=1)
    run = replace(run, environment={**run.environment, "TOKEN": FromEnvironment(name="MINE")})
    context = StartContext(base=tmp_path, environment={"MINE": "s3cr3t-value", "PATH": ""})

    with ComponentRun("vision", run, context) as running:
        (sample,) = list(running)

    assert "s3cr3t-value" not in sample.failure + running.tail
    assert "<MINE>" in sample.failure
