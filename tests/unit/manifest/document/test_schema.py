"""The JSON Schema that editors use is the one that the code makes, and it describes every field."""

from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from rarms_iac.manifest.document.schema import manifest_schema, overlay_schema
from rarms_iac.manifest.load import load_system
from rarms_iac.manifest.text.reading import read_text
from tests.unit.manifest.examples import EVERYTHING, no_checks

SCHEMAS = Path(__file__).parents[4] / "schemas"


def test_the_schema_is_one() -> None:
    meta = jsonschema.Draft202012Validator(jsonschema.Draft202012Validator.META_SCHEMA)

    assert list(meta.iter_errors(manifest_schema())) == []


def test_a_manifest_that_says_everything_fits() -> None:
    value = read_text(EVERYTHING.encode(), "rarms.yaml", ".").value

    assert list(jsonschema.Draft202012Validator(manifest_schema()).iter_errors(value)) == []


def test_the_example_says_every_field_there_is() -> None:
    said = set(_keys(read_text(EVERYTHING.encode(), "rarms.yaml", ".").value))

    fields = {name for block in _blocks() for name in block["properties"]}

    assert fields <= said


def test_every_field_has_a_description_for_the_editor() -> None:
    fields = [(name, field) for block in _blocks() for name, field in block["properties"].items()]

    silent = [name for name, field in fields if not (field.get("description") or _referred(field).get("description"))]

    assert silent == []


def _blocks() -> list[dict[str, Any]]:
    schema = manifest_schema()
    return [block for block in (schema, *schema["$defs"].values()) if "properties" in block]


def _referred(field: dict[str, Any]) -> dict[str, Any]:
    return dict(manifest_schema()["$defs"].get(field.get("$ref", "").removeprefix("#/$defs/"), {}))


def _keys(value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield key
            yield from _keys(inner)
    if isinstance(value, list):
        for inner in value:
            yield from _keys(inner)


EXAMPLES = sorted((SCHEMAS.parent / "manifests").glob("*/rarms.yaml"))


INVALID = sorted((SCHEMAS.parent / "tests" / "cases" / "findings").glob("*/rarms.yaml"))
OF_STRUCTURE = {"RARMS015", "RARMS016", "RARMS017", "RARMS042"}
BEYOND = "There is no such day"  # JSON Schema cannot say which days there are


@pytest.mark.parametrize("path", INVALID, ids=lambda path: path.parent.name)
def test_case_that_can_be_read_is_judged_alike(path: Path) -> None:
    read = read_text(path.read_bytes(), "rarms.yaml", str(path.parent))
    told = load_system(str(path), today=date(2026, 1, 1), checks=no_checks).diagnostics
    wrong = [each for each in told if each.code in OF_STRUCTURE and BEYOND not in each.detail]

    if read.readable and read.value is not None:
        assert jsonschema.Draft202012Validator(manifest_schema()).is_valid(read.value) == (not wrong)
    else:
        assert told
        assert not wrong


OVERLAY = jsonschema.Draft202012Validator(overlay_schema())


@pytest.mark.parametrize("file", sorted(SCHEMAS.parent.glob("manifests/*/*.yaml")), ids=lambda file: file.stem)
def test_manifests_and_overlays_are_overlays_of_some_manifest(file: Path) -> None:
    assert list(OVERLAY.iter_errors(read_text(file.read_bytes(), file.name, ".").value)) == []


@pytest.mark.parametrize(
    ("overlay", "right"),
    [
        ("components: { arm: null, door: { memory: null, task: null } }", True),
        ("components: { arm: { apt: { mean_response_time: null, jitter: { at_most: 5 ms } } } }", True),
        ("hosts: { cell: { hyperv: { switch: north } } }", True),
        ("interference: { browsers: { instances: 3 } }", True),
        ("components: { arm: { apt: { jitter: {} } } }", False),
        ("components: { arm: { run: { samples: { from: pattern } } } }", False),
        ("components: { arm: { criticalty: 3 } }", False),
        ("components: { arm: { memory: 3 } }", False),
    ],
)
def test_overlay_may_lack_and_remove_but_not_misspell(overlay: str, *, right: bool) -> None:
    assert OVERLAY.is_valid(read_text(overlay.encode(), "robot-7.yaml", ".").value) is right


def test_every_pattern_says_what_is_written_instead() -> None:
    patterns = [node for node in _nodes(manifest_schema()) if isinstance(node.get("pattern"), str)]

    silent = {node["pattern"] for node in patterns if "errorMessage" not in node}

    assert patterns
    assert silent == set()


def _nodes(value: Any) -> Iterator[dict[str, Any]]:
    if isinstance(value, dict):
        yield value
        for inner in value.values():
            yield from _nodes(inner)
    if isinstance(value, list):
        for inner in value:
            yield from _nodes(inner)
