"""The JSON Schema of the manifest, for editors and for every program that is not rarms."""

import json
import re
from collections.abc import Iterator
from functools import cache
from typing import Any, cast

from rarms_iac.manifest.document.reader import manifest_blocks

_DIALECT = "https://json-schema.org/draft/2020-12/schema"


@cache
def manifest_schema() -> dict[str, Any]:
    """Return the schema that `schemas/manifest.json` holds; callers do not change it."""
    blocks = dict(manifest_blocks())
    whole = blocks.pop("System")
    return {"$schema": _DIALECT, "$defs": blocks, **whole}


_REPLACED_WHOLE = frozenset({"samples", "until"})
"""Fields that an overlay replaces as a whole, like each index of `apt`: in them nothing may be missing or null."""


@cache
def overlay_schema() -> dict[str, Any]:
    """Return the schema that `schemas/overlay.json` holds.

    Keys of the manifest may be absent there, or null to remove them.
    """
    whole = manifest_schema()
    made: dict[str, Any] = _relaxed({key: value for key, value in whole.items() if key != "$defs"})
    blocks = {name: _relaxed(block) for name, block in whole["$defs"].items()}
    originals = {f"Whole{name}": _renamed(block) for name, block in whole["$defs"].items()}
    title = "Overlay of a rarms manifest: only what differs from it."
    return {**made, "description": title, "$defs": _reachable(made, {**blocks, **originals})}


def _relaxed(schema: Any) -> Any:
    """Without what must be there, and with null where a key may be removed."""
    if isinstance(schema, list):
        return [_relaxed(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    made = {key: _relaxed(value) for key, value in schema.items() if key not in {"required", "allOf", "properties"}}
    alternatives = made.pop("oneOf", [])
    if any(set(alternative) != set() for alternative in alternatives):
        made["anyOf"] = alternatives
    made.pop("discriminator", None)
    if "properties" in schema:
        made["properties"] = {key: _or_null(_overlaid(key, value)) for key, value in schema["properties"].items()}
    if isinstance(made.get("additionalProperties"), dict):
        made["additionalProperties"] = _or_null(made["additionalProperties"])
    return made


def _overlaid(key: str, schema: dict[str, Any]) -> dict[str, Any]:
    """Return a field of this name in an overlay."""
    if key in _REPLACED_WHOLE:
        return cast(dict[str, Any], _renamed(schema))
    if key == "apt":
        indexes = {
            keyword: {name: _or_null(index) for name, index in schema[keyword].items()}
            for keyword in ("properties", "patternProperties")
        }
        return {**schema, **indexes}
    return cast(dict[str, Any], _relaxed(schema))


def _renamed(schema: Any) -> Any:
    """Return the schema of an overlay, which refers to the blocks of a whole manifest."""
    if isinstance(schema, list):
        return [_renamed(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    made = {key: _renamed(value) for key, value in schema.items()}
    if isinstance(made.get("$ref"), str):
        made["$ref"] = made["$ref"].replace("#/$defs/", "#/$defs/Whole")
    made.pop("discriminator", None)
    return made


def _or_null(schema: dict[str, Any]) -> dict[str, Any]:
    outside = {key: value for key, value in schema.items() if key in {"description", "errorMessage"}}
    return {**outside, "anyOf": [schema, {"type": "null"}]}


def _reachable(schema: dict[str, Any], blocks: dict[str, Any]) -> dict[str, Any]:
    """Return the blocks that the schema leads to, by name."""
    names, waiting = set[str](), [schema]
    while waiting:
        found = set(re.findall(r'"#/\$defs/(\w+)"', json.dumps(waiting.pop()))) - names
        names |= found
        waiting += [blocks[name] for name in found]
    return {name: blocks[name] for name in sorted(names)}


Path = tuple[str | int, ...]


def keys_at(path: Path) -> tuple[str, ...]:
    """Return the keys that a block at this path may have; none where its keys are free names."""
    return tuple(dict.fromkeys(key for schema in _schemas(path) for key in schema.get("properties", {})))


def choices_at(path: Path) -> tuple[str, ...]:
    """Return the values that may stand at this path; none where there are too many to list."""
    found: list[str] = []
    for schema in _schemas(path):
        found += [str(value) for value in schema.get("enum", ())]
        if "const" in schema:
            found.append(str(schema["const"]))
    return tuple(dict.fromkeys(found))


def keys_of_map(path: Path) -> tuple[str, ...]:
    """Return the keys that a map at this path must have; none where no map may stand there, or it needs none."""
    maps = (schema for schema in _schemas(path) if schema.get("additionalProperties") is False)
    return tuple(dict.fromkeys(key for schema in maps for key in schema.get("required", ())))


def keys_for(path: Path, value: str | int) -> tuple[str, ...]:
    """Return the keys of a map at this path that take this value: `every` takes `40 ms`.

    Where the map needs keys, only those are returned.
    """
    properties = [key for schema in _schemas(path) if "type" in schema for key in schema.get("properties", ())]
    found = [key for key in dict.fromkeys(properties) if any(_takes(each, value) for each in _schemas((*path, key)))]
    return tuple(key for key in found if key in keys_of_map(path)) or tuple(found)


def _takes(schema: dict[str, Any], value: str | int) -> bool:
    """Whether a scalar's own schema takes the value; a schema that takes any text does not count."""
    if isinstance(value, int):
        return schema.get("type") == "integer" and schema.get("minimum", value) <= value <= schema.get("maximum", value)
    choices = (*schema.get("enum", ()), *((schema["const"],) if "const" in schema else ()))
    return value in choices or ("pattern" in schema and re.search(schema["pattern"], value) is not None)


def describe(path: Path) -> str:
    """Return the description of the field at this path; empty where there is none."""
    return next((schema["description"] for schema in _schemas(path) if "description" in schema), "")


def _schemas(path: Path) -> list[dict[str, Any]]:
    found = list(alternatives(manifest_schema()))
    for step in path:
        found = [
            alternative for schema in found for child in _children(schema, step) for alternative in alternatives(child)
        ]
    return found


def alternatives(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the schema itself, what it refers to, and each of its alternatives."""
    yield schema
    if "$ref" in schema:
        yield from alternatives(manifest_schema()["$defs"][schema["$ref"].removeprefix("#/$defs/")])
    for choice in (*schema.get("oneOf", ()), *schema.get("anyOf", ())):
        yield from alternatives(choice)


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
