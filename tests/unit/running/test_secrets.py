"""What a component got from rarms' own environment is in no reason and in no tail that is shown or recorded."""

import json
from base64 import b64encode, encodebytes, urlsafe_b64encode
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from urllib.parse import quote

import pytest

from rarms_iac.model.run import FromEnvironment
from rarms_iac.running.component import ComponentRun
from rarms_iac.running.secrets import hide_secrets
from rarms_iac.running.start import StartContext
from tests.unit.running.programs import a_run

SECRET = 'hunter2 "&\u00e9\\x'


AS_JSON = (json.dumps(SECRET)[1:-1], json.dumps(SECRET, ensure_ascii=False)[1:-1])


@pytest.mark.parametrize("form", [SECRET, *AS_JSON, repr(SECRET)[1:-1], ascii(SECRET)[1:-1], quote(SECRET)])
def test_a_value_is_hidden_in_each_form(form: str) -> None:
    hide = hide_secrets(replace(a_run(""), environment={"TOKEN": FromEnvironment(name="MINE")}), {"MINE": SECRET})

    assert hide(f"login {form} failed") == "login <MINE> failed"


@pytest.mark.parametrize("encode", [b64encode, urlsafe_b64encode])
@pytest.mark.parametrize("after", ["", "\n", " and more"])
@pytest.mark.parametrize("before", ["", "u", "me", "user:"])
def test_base64_of_a_value_is_hidden(before: str, after: str, encode: Callable[[bytes], bytes]) -> None:
    value = "s3cr3t>?value~~"
    hide = hide_secrets(replace(a_run(""), environment={"TOKEN": FromEnvironment(name="MINE")}), {"MINE": value})

    text = encode(f"{before}{value}{after}".encode()).decode()

    assert before or hide(text.rstrip("=")).startswith("<MINE>")
    others = hide(text).replace("<MINE>", "")
    assert len(others) <= len(encode(f"{before}{after}".encode())) + 2  # those that are also of a neighbour
    assert len(hide(text)) > len(others)


def test_base64_of_long_value_is_hidden_in_lines() -> None:
    value = "".join(map(chr, range(33, 120)))
    hide = hide_secrets(replace(a_run(""), environment={"TOKEN": FromEnvironment(name="MINE")}), {"MINE": value})

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

    assert hide_secrets(run, {"MINE": "s3cr3t-value"})(text) == shown


def test_a_line_of_a_value_is_hidden() -> None:
    run = replace(a_run(""), environment={"TOKEN": FromEnvironment(name="MINE")})

    assert hide_secrets(run, {"MINE": "first-line\nsecond-line"})("read second-line;") == "read <MINE>;"


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

    assert hide_secrets(run, {"MINE": "short"})("a short, visible text") == "a short, visible text"


def test_printed_secrets_are_not_recorded(tmp_path: Path) -> None:
    program = "import os\nsys.stderr.write(os.environ['TOKEN'])\nsys.stderr.flush()\nsay('{x' + os.environ['TOKEN'])\n"
    run = a_run(f"{program}time.sleep(60)", until=1, failures=1)
    run = replace(run, environment={**run.environment, "TOKEN": FromEnvironment(name="MINE")})
    context = StartContext(base=tmp_path, environment={"MINE": "s3cr3t-value", "PATH": ""})

    with ComponentRun("vision", run, context) as running:
        (sample,) = list(running)

    assert "s3cr3t-value" not in sample.failure + running.tail
    assert "<MINE>" in sample.failure
