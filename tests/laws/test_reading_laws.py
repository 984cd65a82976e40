"""Any text as a manifest: what is wrong is told in words with a place, and nothing raises."""

import copy
import json
import random
from datetime import date

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rarms_iac.manifest.document.messages import findings_of_structure
from rarms_iac.manifest.document.validate_document import NotAManifest, validate_document
from rarms_iac.manifest.load import load_system
from rarms_iac.manifest.text.positions import ManifestPlaces
from rarms_iac.manifest.text.reading import read_text
from rarms_iac.manifest.text.tree import plain
from rarms_iac.model.diagnostics import Severity
from tests.effort import examples
from tests.laws.test_schema_agrees import DOCUMENT, _mutate
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
        assert plain(read.source.positions()) == read.value


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
        validate_document(read.value, ManifestPlaces(read.source.positions))
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
