"""The types of the model -> what reads their values (a schema of pydantic) and what describes them (JSON Schema).

A dataclass becomes a map of those of its fields that have a `Key`; the marks of `model/keys.py` say which values fit.
Of a union the keys of a map choose the member. Begin with `manifest_reader`.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from datetime import date
from enum import Enum
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NewType, TypeVar, Union, get_args, get_origin, get_type_hints

from pydantic_core import CoreSchema, PydanticCustomError, SchemaValidator
from pydantic_core import core_schema as core

from rarms_iac.manifest.document.marks import (
    FORMS,
    quantity_reader,
    quantity_schema,
    read_thresholds,
    thresholds_schema,
    write_quantity,
)
from rarms_iac.manifest.document.rules import RULES
from rarms_iac.model.host import Host
from rarms_iac.model.keys import Form, Key, Quantity, Shape, Within
from rarms_iac.model.loads import LOADS_WITHOUT_ENTRY
from rarms_iac.model.run import Periodic, Run
from rarms_iac.model.system import Component, Measured, PartitionRequest, RunsOn, System

Json = dict[str, Any]
M = TypeVar("M")

TAG = "\0"
"""Begins the name of an alternative, which pydantic puts into the path of an error. No text of a manifest has it."""


@dataclass(frozen=True, slots=True)
class ValueType:
    """How a value is read, and how editors are told of it."""

    core: CoreSchema
    json: Json


@cache
def manifest_reader() -> SchemaValidator:
    """Return the reader of plain values; its errors have their paths."""
    return SchemaValidator(_reading(System).core)


@cache
def manifest_blocks() -> Mapping[str, Json]:
    """Return the JSON Schema of each block of the manifest, by the name of its class; that of `System` is the whole."""
    _reading(System)
    return dict(sorted(_blocks.items()))


_blocks: dict[str, Json] = {}


def _bare(hint: Any, marks: tuple[Any, ...] = ()) -> tuple[Any, tuple[Any, ...]]:
    """Return the type without its marks and `None` (a key may be absent, but not null), and the marks."""
    if get_origin(hint) is Annotated:
        inner, *more = get_args(hint)
        return _bare(inner, (*more, *marks))
    if isinstance(hint, NewType):
        return _bare(hint.__supertype__, marks)
    if get_origin(hint) in (Union, UnionType):
        members = tuple(member for member in get_args(hint) if member is not NoneType)
        return _bare(members[0], marks) if len(members) == 1 else (members, marks)
    return hint, marks


def _mark(kind: type[M], marks: tuple[Any, ...]) -> M | None:
    return next((mark for mark in marks if isinstance(mark, kind)), None)


def _reading(hint: Any) -> ValueType:
    bare, marks = _bare(hint)
    if quantity := _mark(Quantity, marks):
        word = Measured.MEASURED if isinstance(bare, tuple) and Measured in bare else None
        reader = core.no_info_plain_validator_function(quantity_reader(quantity, word))
        return ValueType(reader, quantity_schema(quantity, word))
    if Shape.THRESHOLDS in marks:
        return ValueType(core.no_info_plain_validator_function(read_thresholds), thresholds_schema())
    if isinstance(bare, tuple):
        return _union(bare)
    arguments = get_args(bare)
    match get_origin(bare) or bare:
        case origin if origin is tuple:
            return _list(arguments[0], marks)
        case origin if origin is Mapping:
            return _map(*arguments, filled=Shape.FILLED in marks)
        case origin if origin is Literal:
            return _choice(arguments)
        case scalar if scalar is str:
            return _text(marks)
        case scalar if scalar is bool:
            return ValueType(core.bool_schema(strict=True), {"type": "boolean"})
        case scalar if scalar is int:
            within = _mark(Within, marks)
            assert within is not None, "numbers of the manifest have bounds"
            bounds = {"maximum": within.most, "minimum": within.least, "type": "integer"}
            return ValueType(core.int_schema(ge=within.least, le=within.most, strict=True), bounds)
        case scalar if scalar is date:
            return ValueType(core.no_info_plain_validator_function(_day), _text((Form.DAY,)).json)
        case cls if issubclass(cls, Enum):
            choice = _choice(tuple(member.value for member in cls))
            return replace(choice, core=core.no_info_after_validator_function(cls, choice.core))
        case cls if not fields(cls):  # a word
            choice = _choice((cls.kind,))
            return replace(choice, core=_then(lambda _: cls(), choice.core))
        case cls:
            block = _block(cls)
            return replace(block, core=_then(_maker(cls), block.core))


def _then(make: Callable[[Any], Any], read: CoreSchema) -> CoreSchema:
    return core.no_info_after_validator_function(make, read)


def _choice(values: tuple[Any, ...]) -> ValueType:
    choices = {"const": values[0]} if len(values) == 1 else {"enum": list(values)}
    return ValueType(core.literal_schema(list(values)), {**choices, "type": "string"})


def _text(marks: tuple[Any, ...]) -> ValueType:
    if form := _mark(Form, marks):
        # `$` also matches before a line end in some languages; a name does not end with one.
        json = {"errorMessage": FORMS[form][1], "pattern": f"{form.value}(?!\\n)", "type": "string"}
        return ValueType(core.str_schema(pattern=form.value, strict=True), json)
    if Shape.FILLED in marks:
        return ValueType(core.str_schema(min_length=1, strict=True), {"minLength": 1, "type": "string"})
    return ValueType(core.str_schema(strict=True), {"type": "string"})


_DAY = re.compile(Form.DAY.removesuffix("$") + r"\Z")


def _day(text: Any) -> date:
    if not isinstance(text, str):
        raise PydanticCustomError("string_type", "not a text")
    if _DAY.match(text) is None:
        raise PydanticCustomError("string_pattern_mismatch", "not a day", {"pattern": Form.DAY.value})
    try:
        return date.fromisoformat(text)
    except ValueError:
        raise PydanticCustomError("rarms_no_day", "no such day") from None


def _list(hint: Any, marks: tuple[Any, ...]) -> ValueType:
    item = _reading(hint)
    least = 1 if {Shape.FILLED, Shape.ONE_OR_SEVERAL}.intersection(_shapes(marks)) else None
    several = ValueType(
        _then(tuple, core.list_schema(item.core, min_length=least, strict=True)),
        {"items": item.json, **({"minItems": least} if least else {}), "type": "array"},
    )
    if Shape.ONE_OR_SEVERAL not in marks:
        return several
    return _alternatives(
        {"one": replace(item, core=_then(lambda value: (value,), item.core)), "several": several},
        lambda value: "several" if isinstance(value, list) else "one",
    )


def _shapes(marks: tuple[Any, ...]) -> set[Shape]:
    return {mark for mark in marks if isinstance(mark, Shape)}


def _map(keys: Any, values: Any, *, filled: bool) -> ValueType:
    key, value = _reading(keys), _reading(values)
    read, own = value.core, _own_name(_bare(values)[0])
    if own:
        read = _block(_bare(values)[0]).core
    made: CoreSchema = core.dict_schema(key.core, read, min_length=1 if filled else None, strict=True)
    if own:
        make = _maker(_bare(values)[0])
        made = _then(lambda blocks: {name: make({**each, own: name}) for name, each in blocks.items()}, made)
    names = {word: key.json[word] for word in ("errorMessage", "pattern")}
    least = {"minProperties": 1} if filled else {}
    return ValueType(made, {"additionalProperties": value.json, **least, "propertyNames": names, "type": "object"})


def _own_name(cls: Any) -> str:
    hints = get_type_hints(cls, include_extras=True) if is_dataclass(cls) else {}
    return next((name for name, hint in hints.items() if Shape.OWN_NAME in _bare(hint)[1]), "")


def _union(members: tuple[Any, ...]) -> ValueType:
    """Read one of several types, chosen by `kind`, by a key that only one has, or by whether it is a map."""
    readings = [_reading(member) for member in members]
    if all(getattr(member, "kind", "") for member in members):
        return _alternatives(
            {member.kind: reading for member, reading in zip(members, readings, strict=True)},
            lambda value: str(value.get("kind")) if isinstance(value, dict) else "",
            error="rarms_kind",
        )
    if all(map(is_dataclass, members)) and not any(getattr(member, "kind", "") for member in members):
        names = [_blocks[member.__name__]["required"][0] for member in members]

        def only(value: Any) -> str:
            written = [name for name in names if name in value] if isinstance(value, dict) else names[:1]
            return written[0] if len(written) == 1 else ""

        return _alternatives(dict(zip(names, readings, strict=True)), only, error="rarms_exactly_one", names=names)
    return _alternatives(
        dict(zip(("plain", "map"), readings, strict=True)), lambda value: "map" if isinstance(value, dict) else "plain"
    )


def _alternatives(
    readings: Mapping[str, ValueType], choose: Callable[[Any], str], *, error: str = "", names: Sequence[str] = ()
) -> ValueType:
    read = core.tagged_union_schema(
        {f"{TAG}{name}": reading.core for name, reading in readings.items()},
        lambda value: f"{TAG}{choose(value)}",
        custom_error_type=error or None,
        custom_error_message="none of them" if error else None,
        custom_error_context={"names": " ".join(names)} if error else None,
    )
    return ValueType(read, {"oneOf": [reading.json for reading in readings.values()]})


@cache
def _block(cls: Any) -> ValueType:
    """Return the fields of a block as a dict, which `_maker` takes."""
    kind = getattr(cls, "kind", "")
    read: dict[str, Any] = {}
    properties: Json = {}
    needed: list[str] = []
    description = " ".join((cls.__doc__ or "").partition("\n\n")[0].split())
    if kind:
        read["kind"] = core.typed_dict_field(core.literal_schema([kind]))
        properties["kind"] = {"const": kind, "description": description, "type": "string"}
        needed.append("kind")
    hints = get_type_hints(cls, include_extras=True)
    for field in fields(cls):
        marks = _bare(hints[field.name])[1]
        if (key := _mark(Key, marks)) is None:
            continue
        name, reading = key.name or field.name, _reading(hints[field.name])
        is_needed = field.default is MISSING and field.default_factory is MISSING
        read[field.name] = core.typed_dict_field(reading.core, required=is_needed, validation_alias=name)
        properties[name] = {**_default(field.default, marks), "description": key.description, **reading.json}
        needed += [name] * is_needed
    _blocks[cls.__name__] = {
        "additionalProperties": False,
        **RULES.get(cls, {}),
        "description": description,
        "properties": properties,
        **({"required": needed} if needed else {}),
        "type": "object",
    }
    made = core.typed_dict_schema(read, extra_behavior="forbid", strict=True)
    return ValueType(made, {"$ref": f"#/$defs/{cls.__name__}"})


def _default(value: Any, marks: tuple[Any, ...]) -> Json:
    """Return a default as a user would write it; nothing where the description says what is taken."""
    if quantity := _mark(Quantity, marks):
        return {} if value in (None, MISSING) else {"default": write_quantity(value, quantity)}
    if isinstance(value, Enum):
        return {"default": value.value}
    is_text = isinstance(value, str) and (value or not {type(mark) for mark in marks} & {Form, Shape})
    return {"default": value} if is_text or isinstance(value, int) else {}


def _host(values: Json) -> Host:
    values.setdefault("platform", values["name"])
    return Host(**values)


def _partition(values: Json) -> PartitionRequest:
    values.setdefault("components", (values["name"],))
    return PartitionRequest(**values)


def _run(values: Json) -> Run:
    if isinstance(arrival := values.get("arrival"), Periodic):
        values.setdefault("deadline", arrival.period)
    return Run(**values)


def _component(values: Json) -> Component:
    made = Component(**values)
    if made.apt and made.runs_on is RunsOn.PARTITION and made.cpu.reserve is None:
        return replace(made, cpu=replace(made.cpu, reserve=Measured.MEASURED))
    return made


def _system(values: Json) -> System:
    return System(**{**values, "interference": {**LOADS_WITHOUT_ENTRY, **values.get("interference", {})}})


_MAKERS: Mapping[Any, Callable[[Json], Any]] = {
    Host: _host,
    PartitionRequest: _partition,
    Run: _run,
    Component: _component,
    System: _system,
}
"""Makes the values of blocks whose defaults depend on other fields."""


def _maker(cls: Callable[..., Any]) -> Callable[[Json], Any]:
    """Return the function that makes a block of its fields."""
    make: Callable[[Json], Any] = _MAKERS.get(cls, lambda values: cls(**values))
    if not getattr(cls, "kind", ""):
        return make

    def without_kind(values: Json) -> Any:
        del values["kind"]
        return make(values)

    return without_kind
