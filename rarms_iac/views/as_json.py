"""Output as JSON text, and the schema that says what it looks like.

`python -m rarms_iac.views.as_json > schemas/output.json` writes that.
"""

import json
import sys
from typing import TYPE_CHECKING, Annotated, Any

from rarms_iac.storage.codec import Json, encode
from rarms_iac.views.output.common import FORMAT_VERSION

if TYPE_CHECKING:
    from rarms_iac.views.output.kinds import Output


def as_json(output: "Output") -> str:
    """The whole answer in ASCII, keys in our order, ending with a line end."""
    return json.dumps(_encodable(encode(output)), indent=2) + "\n"


def output_schema() -> str:
    """The text of `schemas/output.json`."""
    from pydantic import Field, TypeAdapter

    from rarms_iac.views.output.kinds import Output

    schema = TypeAdapter(Annotated[Output, Field(discriminator="kind")]).json_schema(mode="serialization")
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"What rarms prints with --json ({FORMAT_VERSION})",
    }
    return json.dumps({**head, **_strict(schema)}, indent=2, ensure_ascii=False) + "\n"


def _strict(schema: dict[str, Any]) -> dict[str, Any]:
    """Every field is always written, so every one is required; the titles repeat the names."""
    definitions = {
        name: {
            **{key: value for key, value in definition.items() if key != "title"},
            **({"required": list(definition["properties"])} if "properties" in definition else {}),
        }
        for name, definition in schema["$defs"].items()
    }
    for definition in definitions.values():
        for field in definition.get("properties", {}).values():
            field.pop("title", None)
            field.pop("default", None)
    return {**schema, "$defs": definitions}


def _encodable(value: Json) -> Json:
    """The value without lone surrogates: strict parsers refuse their escapes."""
    match value:
        case str():
            return value.encode("utf-8", "replace").decode("utf-8")
        case list():
            return [_encodable(item) for item in value]
        case dict():
            return {key: _encodable(item) for key, item in value.items()}
        case _:
            return value


if __name__ == "__main__":
    sys.stdout.buffer.write(output_schema().encode())
