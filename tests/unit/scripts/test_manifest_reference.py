"""The manifest's reference says what the format is."""

from pathlib import Path
from typing import Any

import jsonschema
import pytest

from rarms_iac.manifest.document.schema import manifest_schema
from rarms_iac.manifest.edit.formatting import format_text
from rarms_iac.manifest.edit.order import MANIFEST, ValueShape
from rarms_iac.manifest.text.reading import read_text
from scripts.manifest_reference import examples, reference_markdown

_NAMED = {"HostBlock", "ComponentBlock", "PartitionBlock", "TaskBlock", "AcceptanceBlock"}
_NAMED |= {"BusyLoopBlock", "BrowserBlock", "CommandLoadBlock", "StressBlock"}


def test_the_page_is_the_generated_one() -> None:
    page = Path(__file__).parents[3] / "docs" / "manifest.md"

    assert page.read_text(encoding="utf-8") == reference_markdown()


def test_every_block_and_key_has_its_place_on_the_page() -> None:
    page = reference_markdown()

    for block in _blocks().values():
        assert all(f"| `{key}` |" in page for key in block["properties"])
        assert block["description"] in page


@pytest.mark.parametrize("name", examples())
def test_every_example_is_valid_and_canonical(name: str) -> None:
    text = examples()[name]
    value: Any = read_text(text.encode(), "example", "").value
    if name != "ManifestDocument":
        value = next(iter(value.values()))
    document = manifest_schema()
    schema = document if name == "ManifestDocument" else document["$defs"].get(name)
    if name == "apt":
        schema = document["$defs"]["ComponentBlock"]["properties"]["apt"]

    for entry in value.values() if name in _NAMED else [value]:
        jsonschema.validate(entry, {**schema, "$defs": document["$defs"]})
    assert format_text(text, "example") == text


def test_the_formatter_knows_exactly_the_keys_that_there_are() -> None:
    document = manifest_schema()

    assert _shape_keys(MANIFEST) == _schema_keys(document, document)


def test_the_formatter_knows_exactly_the_quantities_that_there_are() -> None:
    document = manifest_schema()

    assert _quantities(MANIFEST) == _schema_quantities(document, document)


def _blocks() -> dict[str, Any]:
    return {name: shape for name, shape in manifest_schema()["$defs"].items() if "properties" in shape}


def _shape_keys(shape: ValueShape, path: str = "") -> set[str]:
    inner = [(f"{path}.{key}", inside) for key, inside in shape.keys.items()]
    if shape.each:
        inner.append((f"{path}.*", shape.each))
    return {there for there, _ in inner if there[-1] != "*"}.union(
        *(_shape_keys(inside, there) for there, inside in inner)
    )


def _quantities(shape: ValueShape, path: str = "") -> set[str]:
    inner = [(f"{path}.{key}", inside) for key, inside in shape.keys.items()]
    if shape.each:
        inner.append((f"{path}.*", shape.each))
    return ({path} if shape.is_quantity else set()).union(*(_quantities(inside, there) for there, inside in inner))


def _inside(schema: Any, document: Any, path: str) -> list[tuple[str, Any]]:
    """Paths and schemas right below a schema; performance indexes count as names."""
    inner: list[tuple[str, Any]] = []
    for part in [schema, *schema.get("oneOf", ()), *schema.get("anyOf", ())]:
        there = document["$defs"].get(part.get("$ref", "").removeprefix("#/$defs/"), part)
        indexes = "patternProperties" in there
        for key, value in there.get("properties", {}).items():
            inner.append((f"{path}.{'*' if indexes else key}", value))
        if isinstance(below := there.get("additionalProperties"), dict):
            inner.append((f"{path}.*", below))
        if there is not part and there.get("oneOf") and "properties" not in there:
            inner += _inside(there, document, path)
    return inner


def _schema_keys(schema: Any, document: Any, path: str = "") -> set[str]:
    inner = _inside(schema, document, path)
    keys = {there for there, _ in inner if there[-1] != "*"}
    return keys.union(*(_schema_keys(part, document, there) for there, part in inner))


def _schema_quantities(schema: Any, document: Any, path: str = "") -> set[str]:
    here = {path} if any("examples" in part for part in [schema, *schema.get("anyOf", ())]) else set()
    return here.union(*(_schema_quantities(part, document, there) for there, part in _inside(schema, document, path)))
