"""The JSON Schema of what `--json` prints: `python -m scripts.output_schema > schemas/output.json`."""

import json
import sys
from functools import reduce
from operator import or_
from typing import Annotated, Any

from pydantic import Field, TypeAdapter

from rarms_iac.views.output import combining, common, hosts, measuring, plan
from rarms_iac.views.output.common import FORMAT_VERSION, Output


def output_schema() -> str:
    """The text of `schemas/output.json`."""
    kinds = tuple(
        kind
        for module in (plan, hosts, common, measuring, combining)
        for kind in vars(module).values()
        if isinstance(kind, type) and issubclass(kind, Output) and kind is not Output
    )
    answer = reduce(or_, kinds)
    adapter: TypeAdapter[Any] = TypeAdapter(Annotated[answer, Field(discriminator="kind")])  # type: ignore[arg-type]  # found just now
    schema = adapter.json_schema(mode="serialization")
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


if __name__ == "__main__":
    sys.stdout.buffer.write(output_schema().encode())
