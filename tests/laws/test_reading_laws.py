"""Any text as a manifest: what is wrong is told in words with a place, and nothing raises."""

import copy
import json
import random
import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from datetime import date
from functools import cache
from typing import Any, NewType, get_args, get_type_hints

import jsonschema
import pytest
from hypothesis import given, note, settings
from hypothesis import strategies as st

from rarms_iac.manifest.document.messages import findings_of_structure
from rarms_iac.manifest.document.schema import manifest_schema
from rarms_iac.manifest.document.validate_document import NotAManifest, validate_document
from rarms_iac.manifest.load import load_system
from rarms_iac.manifest.text.reading import read_text
from rarms_iac.manifest.text.tree import ManifestPlaces, first_line, plain
from rarms_iac.model.diagnostics import Severity
from rarms_iac.model.journal import RunClosed, RunStarted, ScriptStarted, StepRecorded
from rarms_iac.model.state import State
from rarms_iac.providers.hyperv.observation import HostObservation
from rarms_iac.providers.simulated.content import Content
from rarms_iac.storage.codec import NotDecodable, decoder_of_field, has_numbers
from rarms_iac.storage.datalog.decisions import Chosen, Proven, TuningRun
from rarms_iac.storage.datalog.log import Header, LogRecord
from rarms_iac.storage.plan_file import PlanFile
from rarms_iac.storage.ranges import BY_SETTING, RANGES, range_of
from tests.effort import examples
from tests.unit.manifest.examples import EVERYTHING

SCRAPS = [
    *"abc-:,?#&*!|>'\"%@`[]{}\n\t \\0",
    "\n  ",
    ": ",
    "- ",
    "---\n",
    "...\n",
    "<<: ",
    "&a ",
    "*a ",
    "!x ",
    "\\u202e",
    "é",
]
YAML = st.lists(st.sampled_from(SCRAPS), max_size=40).map("".join)


@settings(max_examples=examples(400))
@given(st.one_of(YAML.map(str.encode), st.binary(max_size=60)))
def test_any_bytes_are_read_or_told(data: bytes) -> None:
    read = read_text(data, "rarms.yaml", ".")

    errors = [diagnostic for diagnostic in read.diagnostics if diagnostic.severity is Severity.ERROR]
    assert read.readable or errors
    assert all(error.place and error.place.line >= 1 and error.place.column >= 1 for error in errors)
    lines = list(read.source.lines)
    assert all(error.place and error.place.line <= len(lines) for error in errors)


@settings(max_examples=examples(400))
@given(YAML)
def test_positions_and_values_come_from_the_same_text(text: str) -> None:
    read = read_text(text.encode(), "rarms.yaml", ".")

    if read.readable:
        assert plain(read.tree().root) == read.value


@settings(max_examples=examples(200))
@given(st.integers(min_value=0, max_value=2**32))
def test_every_error_has_words_of_its_own(seed: int) -> None:
    document = copy.deepcopy(DOCUMENT)
    dice = random.Random(seed)
    for _ in range(4):
        _mutate(document, dice)
    text = json.dumps(document, ensure_ascii=True)
    read = read_text(text.encode(), "rarms.yaml", ".")
    if not read.readable:
        return

    try:
        validate_document(read.value, ManifestPlaces(lambda: read.tree().root))
    except NotAManifest as problem:
        told = findings_of_structure(problem)
        assert not any(" cannot be " in diagnostic.detail for diagnostic in told)
        assert all(
            diagnostic.place and diagnostic.place.file == "rarms.yaml" and diagnostic.detail and diagnostic.advice
            for diagnostic in told
        )
        assert not any("rarms_" in diagnostic.detail or "Input should" in diagnostic.detail for diagnostic in told)


@settings(max_examples=examples(100))
@given(st.data())
def test_manifest_with_line_lost_or_changed_never_raises(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    lines = EVERYTHING.splitlines()
    at = data.draw(st.integers(min_value=0, max_value=len(lines) - 1))
    lines[at : at + 1] = [data.draw(st.sampled_from(["", "  x", lines[at][1:], lines[at][:-1], lines[at] * 2, "\t"]))]
    path = tmp_path_factory.getbasetemp() / "rarms.yaml"
    path.write_text("\n".join(lines), encoding="utf-8", newline="\n")

    loaded = load_system(str(path), today=date(2026, 1, 1))

    assert loaded.system is not None or loaded.has_errors


READ = (
    *(State, PlanFile, RunStarted, StepRecorded, RunClosed, ScriptStarted, HostObservation, Content),
    *(Header, LogRecord, Chosen, Proven, TuningRun),
)
"""The types of what is read."""


def records_in(hint: Any, known: dict[type, None]) -> None:
    while isinstance(hint, NewType):
        hint = hint.__supertype__
    if isinstance(hint, type) and is_dataclass(hint):
        if hint not in known:
            known[hint] = None
            for inner in get_type_hints(hint).values():
                records_in(inner, known)
        return
    for argument in get_args(hint):
        records_in(argument, known)


@cache
def numbers() -> tuple[tuple[str, str, Any], ...]:
    known: dict[type, None] = {}
    for record in READ:
        records_in(record, known)
    return tuple(
        (record.__name__, part.name, hint)
        for record in known
        if is_dataclass(record) and record is not HostObservation  # a probe of it is read by its own type
        for part in fields(record)
        if has_numbers(hint := get_type_hints(record)[part.name])
    )


def test_every_range_belongs_to_a_read_number() -> None:
    names = {name for record, field, _ in numbers() for name in (field, f"{record}.{field}")}

    assert set(RANGES) <= names
    assert len(numbers()) > 100


def documents(number: float) -> Iterator[Any]:
    yield from (number, [number], {"reserve": number}, [[number]], {"reserve": [number]})


@pytest.mark.parametrize(("record", "name", "hint"), numbers())
def test_a_number_just_beyond_its_range_is_refused(record: str, name: str, hint: Any) -> None:
    least, most = range_of(*(("PartitionSettings", "reserve") if f"{record}.{name}" in BY_SETTING else (record, name)))
    read = decoder_of_field(record, name, hint)
    for number in (least - 1, most + 1, most * 2):
        if abs(number) == float("inf"):
            continue
        messages = []
        for document in documents(number):
            with pytest.raises(NotDecodable) as refused:
                read(document, name)
            messages.append(str(refused.value))
        assert any(re.search("is not between .* and |more than 64 bits", message) for message in messages)


DOCUMENT = read_text(EVERYTHING.encode(), "rarms.yaml", ".").value
SCHEMA = jsonschema.Draft202012Validator(manifest_schema())

ODD = [
    *(None, True, False, 0, 1, 2, 3, -1, 7, 8, 9, 1.5, 10_000, 10_001, 10**12),
    *("", "x", "a\n", "Bad_Name", "a-", "0", "true", "closed", "measured", "simulated", "hyperv", "linux", "High"),
    *("88 ms", "88ms", "88  ms", " 88 ms", "88 ms\n", "0 ms", "0.0 s", "-1 ms", "1e3 ms", "512 MiB", "512 MB", "0 B"),
    *(
        "70 %",
        "1.4 LP",
        "24 /s",
        "0 %",
        "0 LP",
        "88",
        "８８ ms",
        "٣ ms",
        "1234567890123456 ms",
        "a:b",
        "a.b:c",
        "user@host",
    ),
    *("rarms/v1", "busy_loop", "command", "pattern"),
    *("json_lines", "Audio", "Pro Audio", "1Audio", "é", "TERM", "KILL", "RARMS041", "p95_response_time"),
    *([], [1], ["a"], ["a", "a"], {}, {"a": 1}, {"at_most": "1 ms"}, {"at_least": "1 %"}, {"every": "33 ms"}),
    *({"samples": 3}, {"samples": 3, "elapsed": "3 s"}, {"from_env": "X"}, {"kind": "browser"}, {"field": "x"}),
]
KEYS = [
    "x",
    "7",
    "X",
    "a b",
    "",
    "name\n",
    "con",
    "RARMS041",
    "p95_response_time",
    "p0_response_time",
    "p05_response_time",
]
FIELDS = sorted({name for block in manifest_schema()["$defs"].values() for name in block.get("properties", {})})


def _containers(value: Any) -> list[Any]:
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    found = [container for child in inner for container in _containers(child)]
    return [value, *found] if isinstance(value, dict | list) else found


def _mutate(document: Any, dice: random.Random) -> None:
    """Changes one spot: drops, replaces, adds, renames or moves something."""
    container = dice.choice(_containers(document))
    keys = list(container) if isinstance(container, dict) else list(range(len(container)))
    key = dice.choice(keys) if keys else None
    what = dice.choice(["drop", "odd", "odd", "add", "rename", "swap"])
    if isinstance(container, dict) and what == "add":
        container[dice.choice([*KEYS, *FIELDS])] = copy.deepcopy(dice.choice(ODD))
    elif key is None:
        return
    elif what == "drop":
        del container[key]
    elif what == "rename" and isinstance(container, dict):
        container[dice.choice([*KEYS, *FIELDS])] = container.pop(key)
    elif what == "swap":
        container[key] = copy.deepcopy(dice.choice(_containers(document)))
    else:
        container[key] = copy.deepcopy(dice.choice(ODD))


def _rarms_takes(document: Any) -> bool:
    try:
        validate_document(document, first_line("rarms.yaml"))
    except NotAManifest as problem:
        # What month has 31 days is beyond JSON Schema, and no matter of structure.
        note(str(problem))
        return all(error.kind == "rarms_no_day" for error in problem.errors)
    return True


@settings(max_examples=examples(300))
@given(st.integers(min_value=0, max_value=2**32), st.integers(min_value=1, max_value=3))
def test_rarms_and_a_schema_library_agree(seed: int, mutations: int) -> None:
    document = copy.deepcopy(DOCUMENT)
    dice = random.Random(seed)
    for _ in range(mutations):
        _mutate(document, dice)
    complaints = [f"{error.json_path}: {error.message[:200]}" for error in SCHEMA.iter_errors(document)]
    note(str(complaints[:3]))

    assert _rarms_takes(document) == (not complaints)
