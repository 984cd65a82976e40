"""The JSON Schemas of what `storage.codec` writes, made from the same type hints: our files, and output."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from datetime import date
from enum import Enum
from fractions import Fraction
from inspect import cleandoc
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NewType, Union, get_args, get_origin, get_type_hints

from rarms_iac.model.output import OpenBound, OutputText, output_hints
from rarms_iac.model.series import Sample

DIALECT = "https://json-schema.org/draft/2020-12/schema"
Schema = dict[str, Any]

_PLAIN: Mapping[Any, Schema] = {
    str: {"type": "string"},
    bool: {"type": "boolean"},
    int: {"type": "integer"},
    float: {"type": "number"},
    NoneType: {"type": "null"},
    Fraction: {"type": "string", "pattern": "^-?[0-9]{1,40}(/[1-9][0-9]{0,40})?$"},
    date: {"type": "string", "format": "date"},
}


_SAMPLES: Schema = {
    "description": "Samples as columns, in the order in which their jobs ended.",
    "type": "object",
    "properties": {
        "began_ms": {
            "type": "array",
            "items": {"type": "number"},
            "description": "When each job began; of a periodic job, when it was due; may be below 0.",
        },
        "response_ms": {
            "type": "array",
            "items": {"type": ["number", "null"]},
            "description": "The response time of each; null: no answer.",
        },
        "unsuccessful": {
            "type": "array",
            "items": {"type": "integer", "minimum": 0},
            "description": "Which were unsuccessful, from 0; absent: none.",
        },
        "counts": {
            "type": "array",
            "items": {"type": "number"},
            "description": "How much each did; absent: one each.",
        },
        "failures": {
            "type": "object",
            "additionalProperties": {"type": "string"},
            "description": "Why a sample failed, by its number from 0; absent: none.",
        },
    },
    "required": ["began_ms", "response_ms"],
    "additionalProperties": False,
}
"""As the codec writes samples."""


def schema_of(record: type) -> Schema:
    """Return the schema of a dataclass in a file of ours, with a definition for each that it uses, sorted by name."""
    definitions: dict[str, Schema] = {}
    reference = _schema(record, definitions, _stored)
    return {"$schema": DIALECT, **reference, "$defs": dict(sorted(definitions.items()))}


def output_schema_of(answers: Iterable[type]) -> Schema:
    """Return the schema of output that is one of these dataclasses; fields may be added to any of them."""
    definitions: dict[str, Schema] = {}
    references = [_schema(answer, definitions, _output) for answer in answers]
    return {"$schema": DIALECT, "anyOf": references, "$defs": dict(sorted(definitions.items()))}


def _schema(hint: Any, definitions: dict[str, Schema], record: "Record") -> Schema:
    while isinstance(hint, NewType):
        hint = hint.__supertype__
    if get_origin(hint) is Annotated:
        return {"type": ["number", "null"]} if hint == OpenBound else _schema(get_args(hint)[0], definitions, record)
    if hint in _PLAIN:
        return {"type": "number"} if hint is Fraction and record is _output else dict(_PLAIN[hint])
    if isinstance(hint, type) and issubclass(hint, OutputText) and record is _output:
        return {"type": "string"}
    if isinstance(hint, type) and issubclass(hint, Enum):
        return {"enum": [member.value for member in hint]}
    if isinstance(hint, type) and is_dataclass(hint):
        return _reference(hint, definitions, record)
    return _compound(get_origin(hint), get_args(hint), definitions, record)


def _compound(origin: Any, arguments: tuple[Any, ...], definitions: dict[str, Schema], record: "Record") -> Schema:
    parts = [
        argument if origin is Literal else _schema(argument, definitions, record)
        for argument in arguments
        if argument is not ...
    ]
    if origin is Literal:
        return {"enum": parts}
    if origin in (Union, UnionType):
        return {"anyOf": parts if record is _output else _told_by_names(arguments, parts)}
    if origin is Mapping:
        return {"type": "object", "additionalProperties": parts[1]}
    if origin is Sequence and arguments == (Sample,) and record is not _output:
        return _SAMPLES
    if origin in (frozenset, Sequence) or (origin is tuple and arguments[1:] == (...,)):
        return {"type": "array", "items": parts[0]}
    if origin is tuple:
        return {"type": "array", "prefixItems": parts, "minItems": len(parts), "maxItems": len(parts)}
    raise TypeError(f"no schema for {origin!r}")


def _reference(cls: type, definitions: dict[str, Schema], record: "Record") -> Schema:
    name = cls.__name__
    if name not in definitions:
        definitions[name] = {}  # a type may contain itself
        definitions[name] = {
            "description": cleandoc(cls.__doc__ or ""),
            "type": "object",
            **record(cls, lambda hint: _schema(hint, definitions, record)),
        }
    return {"$ref": f"#/$defs/{name}"}


Record = Callable[[type, Callable[[Any], Schema]], Schema]
"""The properties of a dataclass, given how the type of each becomes a schema."""


def _stored(cls: type, schema: Callable[[Any], Schema]) -> Schema:
    hints = get_type_hints(cls)
    parts = fields(cls)
    return {
        "properties": {part.name: schema(hints[part.name]) for part in parts},
        "required": [part.name for part in parts if part.default is MISSING and part.default_factory is MISSING],
        "additionalProperties": False,
    }


def _output(cls: type, schema: Callable[[Any], Schema]) -> Schema:
    properties = {name: schema(hint) for name, hint in output_hints(cls).items()}
    return {"properties": properties, "required": list(properties)}


def _told_by_names(members: tuple[Any, ...], schemas: list[Schema]) -> list[Schema]:
    """Return the members of a union; a dataclass among several that has no `kind` is marked by its name around it."""
    records = {member for member in members if isinstance(member, type) and is_dataclass(member)}
    return [
        {
            "type": "object",
            "properties": {member.__name__: schema},
            "required": [member.__name__],
            "additionalProperties": False,
        }
        if member in records and len(records) > 1 and "kind" not in {part.name for part in fields(member)}
        else schema
        for member, schema in zip(members, schemas, strict=True)
    ]
