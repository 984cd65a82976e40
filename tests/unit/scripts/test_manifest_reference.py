"""The manifest's reference says what the format is."""

from pathlib import Path
from typing import Any

import jsonschema
import pytest

from rarms_iac.manifest.document.schema import manifest_schema
from rarms_iac.manifest.edit.formatting import format_text
from rarms_iac.manifest.text.reading import read_text
from scripts.manifest_reference import examples, reference_markdown

_NAMED = {"Host", "Component", "PartitionRequest", "TaskRequest", "Acceptance"}
_NAMED |= {"BusyLoop", "Bursts", "Browser", "CommandLoad", "Stress"}


def test_the_page_is_the_generated_one() -> None:
    page = Path(__file__).parents[3] / "docs" / "manifest.md"

    assert page.read_text(encoding="utf-8") == reference_markdown()


def test_every_key_is_on_the_page() -> None:
    page = reference_markdown()

    for block in _blocks().values():
        assert all(f"| `{key}` |" in page for key in block["properties"])
        assert block["description"] in page


@pytest.mark.parametrize("name", examples())
def test_every_example_is_valid_and_canonical(name: str) -> None:
    text = examples()[name]
    value: Any = read_text(text.encode(), "example", "").value
    if name != "System":
        value = next(iter(value.values()))
    document = manifest_schema()
    schema = document if name == "System" else document["$defs"].get(name)
    if name == "apt":
        schema = document["$defs"]["Component"]["properties"]["apt"]

    for entry in value.values() if name in _NAMED else [value]:
        jsonschema.validate(entry, {**schema, "$defs": document["$defs"]})
    assert format_text(text, "example") == text


def _blocks() -> dict[str, Any]:
    return {name: shape for name, shape in manifest_schema()["$defs"].items() if "properties" in shape}
