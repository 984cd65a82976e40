"""The JSON Schema of what `storage.codec` writes, made from the same type hints."""

from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from datetime import date
from enum import Enum
from fractions import Fraction
from inspect import cleandoc
from types import NoneType, UnionType
from typing import Any, Literal, NewType, Union, get_args, get_origin, get_type_hints

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


def schema_of(record: type) -> Schema:
    """The schema of a dataclass, with a definition for each that it uses, sorted by name."""
    definitions: dict[str, Schema] = {}
    reference = _schema(record, definitions)
    return {"$schema": DIALECT, **reference, "$defs": dict(sorted(definitions.items()))}


def _schema(hint: Any, definitions: dict[str, Schema]) -> Schema:
    while isinstance(hint, NewType):
        hint = hint.__supertype__
    if hint in _PLAIN:
        return dict(_PLAIN[hint])
    if isinstance(hint, type) and issubclass(hint, Enum):
        return {"enum": [member.value for member in hint]}
    if isinstance(hint, type) and is_dataclass(hint):
        return _record(hint, definitions)
    return _compound(get_origin(hint), get_args(hint), definitions)


def _compound(origin: Any, arguments: tuple[Any, ...], definitions: dict[str, Schema]) -> Schema:
    if origin is Literal:
        return {"enum": list(arguments)}
    if origin in (Union, UnionType):
        return _union(arguments, definitions)
    if origin is Mapping:
        return {"type": "object", "additionalProperties": _schema(arguments[1], definitions)}
    if origin is frozenset or (origin is tuple and arguments[1:] == (...,)):
        return {"type": "array", "items": _schema(arguments[0], definitions)}
    if origin is tuple:
        items = [_schema(argument, definitions) for argument in arguments]
        return {"type": "array", "prefixItems": items, "minItems": len(items), "maxItems": len(items)}
    raise TypeError(f"no schema for {origin!r}")


def _record(cls: type, definitions: dict[str, Schema]) -> Schema:
    name = cls.__name__
    if name not in definitions:
        definitions[name] = {}  # a type may contain itself
        hints = get_type_hints(cls)
        parts = fields(cls)
        definitions[name] = {
            "description": cleandoc(cls.__doc__ or ""),
            "type": "object",
            "properties": {part.name: _schema(hints[part.name], definitions) for part in parts},
            "required": [part.name for part in parts if part.default is MISSING and part.default_factory is MISSING],
            "additionalProperties": False,
        }
    return {"$ref": f"#/$defs/{name}"}


def _union(members: tuple[Any, ...], definitions: dict[str, Schema]) -> Schema:
    records = [member for member in members if isinstance(member, type) and is_dataclass(member)]
    wrapped = [
        record for record in records if len(records) > 1 and "kind" not in {part.name for part in fields(record)}
    ]
    return {
        "anyOf": [
            _wrapped(member, definitions) if member in wrapped else _schema(member, definitions) for member in members
        ]
    }


def _wrapped(cls: type, definitions: dict[str, Schema]) -> Schema:
    """A member without a `kind` is told by its name around it."""
    return {
        "type": "object",
        "properties": {cls.__name__: _schema(cls, definitions)},
        "required": [cls.__name__],
        "additionalProperties": False,
    }
