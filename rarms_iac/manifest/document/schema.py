"""The JSON Schema of the manifest, for editors and for every program that is not rarms."""

import json
import re
from collections.abc import Iterable, Iterator
from functools import cache, reduce
from typing import Any, cast

from pydantic.json_schema import GenerateJsonSchema
from pydantic_core.core_schema import DictSchema, TypedDictSchema

from rarms_iac.manifest.document.reader import Json, manifest_reader
from rarms_iac.manifest.overlays import REPLACED_WHOLE

_DIALECT = "https://json-schema.org/draft/2020-12/schema"


@cache
def manifest_schema() -> Json:
    """Return the schema that `schemas/manifest.json` holds; callers do not change it."""
    return {"$schema": _DIALECT, **manifest_reader().json_schema(schema_generator=_ForEditors)}


class _ForEditors(GenerateJsonSchema):
    """Leave out titles, which are names of our classes, and say of maps that all names must have the form."""

    def field_title_should_be_set(self, *_: Any) -> bool:
        return False

    def typed_dict_schema(self, schema: TypedDictSchema) -> Json:
        return {key: value for key, value in super().typed_dict_schema(schema).items() if key != "title"}

    def dict_schema(self, schema: DictSchema) -> Json:
        made = super().dict_schema(schema)
        for pattern, values in made.pop("patternProperties", {}).items():  # without it, other names would fit, too
            made |= {"additionalProperties": values, "propertyNames": {**made["propertyNames"], "pattern": pattern}}
        return made


_REPLACED_WHOLE = frozenset(path[-1] for path in REPLACED_WHOLE)
"""Fields that an overlay replaces as a whole: in them, and in each index of `apt`, nothing may be missing or null."""


@cache
def overlay_schema() -> Json:
    """Return the schema that `schemas/overlay.json` holds.

    Keys of the manifest may be absent there, or null to remove them.
    """
    whole = manifest_schema()
    made: Json = _relaxed({key: value for key, value in whole.items() if key != "$defs"})
    blocks = {name: _relaxed(block) for name, block in whole["$defs"].items()}
    originals = {f"Whole{name}": _renamed(block) for name, block in whole["$defs"].items()}
    title = "Overlay of a rarms manifest: only the differences from the manifest."
    return {**made, "description": title, "$defs": _reachable(made, {**blocks, **originals})}


def _relaxed(schema: Any) -> Any:
    """Drop the required keys, and allow null where a key may be removed."""
    if isinstance(schema, list):
        return [_relaxed(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    made = {key: _relaxed(value) for key, value in schema.items() if key not in {"required", "allOf", "properties"}}
    alternatives = made.pop("oneOf", [])
    if any(set(alternative) != set() for alternative in alternatives):
        made["anyOf"] = alternatives
    if "properties" in schema:
        made["properties"] = {key: _or_null(_overlaid(key, value)) for key, value in schema["properties"].items()}
    if isinstance(made.get("additionalProperties"), dict):
        made["additionalProperties"] = _or_null(made["additionalProperties"])
    return made


def _overlaid(key: str, schema: Json) -> Json:
    """Return a field of this name in an overlay."""
    if key in _REPLACED_WHOLE:
        return cast(Json, _renamed(schema))
    if key == "apt":
        indexes = {
            keyword: {name: _or_null(index) for name, index in schema[keyword].items()}
            for keyword in ("properties", "patternProperties")
        }
        return {**schema, **indexes}
    return cast(Json, _relaxed(schema))


def _renamed(schema: Any) -> Any:
    """Return the schema of an overlay, which refers to the blocks of a whole manifest."""
    if isinstance(schema, list):
        return [_renamed(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    made = {key: _renamed(value) for key, value in schema.items()}
    if isinstance(made.get("$ref"), str):
        made["$ref"] = made["$ref"].replace("#/$defs/", "#/$defs/Whole")
    return made


def _or_null(schema: Json) -> Json:
    outside = {key: value for key, value in schema.items() if key in {"description", "errorMessage"}}
    return {**outside, "anyOf": [schema, {"type": "null"}]}


def _reachable(schema: Json, blocks: Json) -> Json:
    """Return the blocks that the schema leads to, by name."""
    names, waiting = set[str](), [schema]
    while waiting:
        found = set(re.findall(r'"#/\$defs/(\w+)"', json.dumps(waiting.pop()))) - names
        names |= found
        waiting += [blocks[name] for name in found]
    return {name: blocks[name] for name in sorted(names)}


Path = tuple[str | int, ...]


class ValueShape:
    """The values that a place of the manifest may have: its schemas, and their alternatives."""

    def __init__(self, schemas: Iterable[Json]) -> None:
        self.schemas = tuple(each for schema in schemas for each in _alternatives(schema))
        self.keys = tuple(dict.fromkeys(key for schema in self.schemas for key in schema.get("properties", {})))
        self._named = [named for schema in self.schemas for named in _schemas_of_any_name(schema)]
        self._below: dict[str | int, ValueShape] = {}

    @property
    def has_names(self) -> bool:
        """Whether users name its keys."""
        return bool(self._named)

    @property
    def is_quantity(self) -> bool:
        """Whether a text with a unit may stand here."""
        return any("examples" in schema for schema in self.schemas)  # as `marks.py` has them

    def rank(self, key: str) -> int:
        """Return the place of a key in the canonical order; unknown keys and those that users name come last."""
        return self.keys.index(key) if key in self.keys and not self.has_names else len(self.keys)

    def of(self, step: str | int) -> "ValueShape":
        """Return the shape of the value under a key, or of an item of a list."""
        kind = step if step in self.keys else "" if isinstance(step, str) else 0
        if kind not in self._below:
            self._below[kind] = ValueShape(self._children(kind))
        return self._below[kind]

    def _children(self, kind: str | int) -> Iterator[Json]:
        for schema in self.schemas:
            if kind in schema.get("properties", {}):
                yield schema["properties"][kind]
            elif kind == 0 and "items" in schema:
                yield schema["items"]
        if kind == "":
            yield from self._named


def _schemas_of_any_name(schema: Json) -> Iterator[Json]:
    yield from schema.get("patternProperties", {}).values()
    if isinstance(schema.get("additionalProperties"), dict):
        yield schema["additionalProperties"]


def _alternatives(schema: Json) -> Iterator[Json]:
    """Yield the schema itself, what it refers to, and each of its alternatives."""
    yield schema
    if "$ref" in schema:
        yield from _alternatives(manifest_schema()["$defs"][schema["$ref"].removeprefix("#/$defs/")])
    for choice in (*schema.get("oneOf", ()), *schema.get("anyOf", ())):
        yield from _alternatives(choice)


@cache
def manifest_shape() -> ValueShape:
    """Return the shape of a whole manifest; an overlay has the same."""
    return ValueShape([manifest_schema()])


def shape_at(path: Path) -> ValueShape:
    """Return the shape of the value at this path."""
    return reduce(ValueShape.of, path, manifest_shape())


def choices_at(path: Path) -> tuple[str, ...]:
    """Return the values that may stand at this path; none where there are too many to list."""
    found: list[str] = []
    for schema in shape_at(path).schemas:
        found += [str(value) for value in schema.get("enum", ())]
        if "const" in schema:
            found.append(str(schema["const"]))
    return tuple(dict.fromkeys(found))


def keys_of_map(path: Path) -> tuple[str, ...]:
    """Return the keys that a map at this path must have; none where no map may stand there, or it needs none."""
    maps = (schema for schema in shape_at(path).schemas if schema.get("additionalProperties") is False)
    return tuple(dict.fromkeys(key for schema in maps for key in schema.get("required", ())))


def keys_for(path: Path, value: str | int) -> tuple[str, ...]:
    """Return the keys of a map at this path that take this value: `every` takes `40 ms`.

    Where the map needs keys, only those are returned.
    """
    shape = shape_at(path)
    keys = dict.fromkeys(key for schema in shape.schemas if "type" in schema for key in schema.get("properties", ()))
    found = tuple(key for key in keys if any(_takes(schema, value) for schema in shape.of(key).schemas))
    return tuple(key for key in found if key in keys_of_map(path)) or found


def _takes(schema: Json, value: str | int) -> bool:
    """Return whether a scalar's own schema names the value; a schema for any text does not count."""
    if isinstance(value, int):
        return schema.get("type") == "integer" and schema.get("minimum", value) <= value <= schema.get("maximum", value)
    choices = (*schema.get("enum", ()), *((schema["const"],) if "const" in schema else ()))
    return value in choices or ("pattern" in schema and re.search(schema["pattern"], value) is not None)


def describe(path: Path) -> str:
    """Return the description of the field at this path; empty where there is none."""
    return next((schema["description"] for schema in shape_at(path).schemas if "description" in schema), "")
