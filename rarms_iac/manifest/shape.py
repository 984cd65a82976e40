"""What may stand at a path of the manifest, read from its JSON Schema: for messages only."""

import re
from collections.abc import Iterator
from typing import Any

from rarms_iac.manifest.json_schema import manifest_schema

Path = tuple[str | int, ...]


def keys_at(path: Path) -> tuple[str, ...]:
    """The keys that a block at this path may have; none where its keys are free names."""
    return tuple(dict.fromkeys(key for schema in _schemas(path) for key in schema.get("properties", {})))


def choices_at(path: Path) -> tuple[str, ...]:
    """The values that may stand at this path; none where there are too many to list."""
    found: list[str] = []
    for schema in _schemas(path):
        found += [str(value) for value in schema.get("enum", ())]
        if "const" in schema:
            found.append(str(schema["const"]))
    return tuple(dict.fromkeys(found))


def described(path: Path) -> str:
    """The description of what stands at this path; empty where there is none."""
    return next((schema["description"] for schema in _schemas(path) if "description" in schema), "")


def _schemas(path: Path) -> list[dict[str, Any]]:
    found = list(_alternatives(manifest_schema()))
    for step in path:
        found = [
            alternative for schema in found for child in _children(schema, step) for alternative in _alternatives(child)
        ]
    return found


def _alternatives(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The schema itself, what it refers to, and each of its alternatives."""
    yield schema
    if "$ref" in schema:
        yield from _alternatives(manifest_schema()["$defs"][schema["$ref"].removeprefix("#/$defs/")])
    for choice in (*schema.get("oneOf", ()), *schema.get("anyOf", ())):
        yield from _alternatives(choice)


def _children(schema: dict[str, Any], step: str | int) -> Iterator[dict[str, Any]]:
    if isinstance(step, int):
        if "items" in schema:
            yield schema["items"]
    elif step in schema.get("properties", {}):
        yield schema["properties"][step]
    else:
        yield from (child for pattern, child in schema.get("patternProperties", {}).items() if re.search(pattern, step))
        if isinstance(schema.get("additionalProperties"), dict):
            yield schema["additionalProperties"]
