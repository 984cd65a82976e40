"""The types of the model -> the types that pydantic reads with a `TypeAdapter`.

A dataclass becomes a `TypedDict` of those of its fields that have a `Key`; `marks` says which values fit. Of a union
the keys of a map choose the member. Begin with `manifest_reader`.
"""

from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields, is_dataclass, replace
from datetime import date
from enum import Enum
from functools import cache, partial, reduce
from operator import or_
from types import GenericAlias, NoneType, UnionType
from typing import Annotated, Any, Literal, NewType, NotRequired, Required, Union, get_args, get_origin, get_type_hints

from pydantic import AfterValidator, ConfigDict, Discriminator, Field, Strict, Tag, TypeAdapter, with_config
from typing_extensions import TypedDict

from rarms_iac.manifest.document.marks import THRESHOLDS, find_mark, limits_of, quantity_type, write_quantity
from rarms_iac.manifest.document.rules import RULES
from rarms_iac.model.host import Host
from rarms_iac.model.keys import Form, Key, Quantity, Shape
from rarms_iac.model.loads import LOADS_WITHOUT_ENTRY
from rarms_iac.model.run import Periodic, Run
from rarms_iac.model.system import Component, CpuRequest, Measured, PartitionRequest, RunsOn, System

Json = dict[str, Any]

TAG = "\0"
"""Begins the name of an alternative, which pydantic puts into the path of an error. No text of a manifest has it."""


@cache
def manifest_reader() -> TypeAdapter[System]:
    """Return the reader of plain values; its errors have their paths."""
    return TypeAdapter(_readable(System))


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


def _readable(hint: Any) -> Any:
    """Return the type that pydantic reads for a type of the model."""
    bare, marks = _bare(hint)
    if quantity := find_mark(Quantity, marks):
        return quantity_type(quantity, Measured.MEASURED if isinstance(bare, tuple) and Measured in bare else None)
    if Shape.THRESHOLDS in marks:
        return THRESHOLDS
    if isinstance(bare, tuple):
        return _union(bare)
    read, *makers = _read_as(bare)
    more = (*limits_of(marks), *makers)
    found = Annotated[(read, *more)] if more else read
    return _one_or_several(_readable(get_args(bare)[0]), found) if Shape.ONE_OR_SEVERAL in marks else found


def _read_as(bare: Any) -> tuple[Any, ...]:
    """Return the type whose values pydantic reads, and what makes the model's value of such a value."""
    arguments = get_args(bare)
    match get_origin(bare) or bare:
        case cls if cls is tuple:
            return GenericAlias(list, (_readable(arguments[0]),)), AfterValidator(tuple)
        case cls if cls is Mapping:
            return _map(*arguments)
        case cls if cls in (Literal, int, str):
            return (bare,)
        case cls if cls is bool:
            return bool, Strict()
        case cls if cls is date:
            return str, AfterValidator(date.fromisoformat)
        case cls if issubclass(cls, Enum):
            # NOTE: not `cls` itself, which Python 3.13 shows as a call of any number of values: pydantic refuses that.
            members = {member.value: member for member in cls}
            return Literal[tuple(members)], AfterValidator(members.__getitem__)
        case cls if not fields(cls):  # a word
            return Literal[cls.kind], AfterValidator(lambda _: cls())
        case cls:
            return _block(cls), AfterValidator(partial(_made, cls))


def _map(keys: Any, values: Any) -> tuple[Any, ...]:
    cls = _bare(values)[0]
    hints = get_type_hints(cls, include_extras=True) if is_dataclass(cls) else {}
    own = next((name for name, hint in hints.items() if Shape.OWN_NAME in _bare(hint)[1]), "")
    if not own:
        return (GenericAlias(dict, (_readable(keys), _readable(values))),)

    def named(blocks: Json) -> Json:
        return {name: _made(cls, {**each, own: name}) for name, each in blocks.items()}

    return GenericAlias(dict, (_readable(keys), _block(cls))), AfterValidator(named)


def _union(members: tuple[Any, ...]) -> Any:
    """Read one of several types, chosen by `kind`, by a key that only one has, or by whether it is a map."""
    types = [_readable(member) for member in members]
    kinds = [getattr(member, "kind", "") for member in members]
    if all(kinds):
        by_kind = dict(zip(kinds, types, strict=True))
        return _alternatives(by_kind, lambda value: str(isinstance(value, dict) and value.get("kind")), "rarms_kind")
    if any(kinds) or not all(map(is_dataclass, members)):
        plain, block = types
        return _alternatives({"": plain, "map": block}, lambda value: "map" if isinstance(value, dict) else "")
    names = [next(iter(_keys(member))) for member in members]

    def only_key(value: Any) -> str:
        written = [name for name in names if name in value] if isinstance(value, dict) else names[:1]
        return written[0] if len(written) == 1 else ""

    return _alternatives(dict(zip(names, types, strict=True)), only_key, "rarms_exactly_one")


def _one_or_several(item: Any, items: Any) -> Any:
    types = {"one": Annotated[item, AfterValidator(lambda value: (value,))], "several": items}
    return _alternatives(types, lambda value: "several" if isinstance(value, list) else "one")


def _alternatives(types: Mapping[str, Any], choose: Callable[[Any], str], error: str = "") -> Any:
    """Return the union of types, each with the name that is chosen for its values."""
    chosen = Discriminator(
        lambda value: f"{TAG}{choose(value)}",
        custom_error_type=error or None,
        custom_error_message="none of them" if error else None,
        custom_error_context={"names": " ".join(types)} if error else None,
    )
    members = (Annotated[each, Tag(f"{TAG}{name}")] for name, each in types.items())
    return Annotated[reduce(or_, members), chosen]


def _keys(cls: Any) -> dict[str, tuple[Any, Any, Key]]:
    """Return field, type and mark of the fields that users write, by their keys."""
    hints = get_type_hints(cls, include_extras=True)
    return {
        key.name or field.name: (field, hints[field.name], key)
        for field in fields(cls)
        if (key := find_mark(Key, _bare(hints[field.name])[1]))
    }


_new_block: Any = TypedDict  # type checkers know only those that are written down


@cache
def _block(cls: Any) -> Any:
    """Return the type of a block's fields as a dict, of which `_made` makes the block."""
    description = " ".join((cls.__doc__ or "").partition("\n\n")[0].split())
    read: Json = {}
    if kind := getattr(cls, "kind", ""):
        read["kind"] = Annotated[Literal[kind], Field(description=description)]
    for name, (field, hint, key) in _keys(cls).items():
        default = _default(field.default, _bare(hint)[1])
        told = Field(alias=name, description=key.description, json_schema_extra=default)
        is_needed = field.default is MISSING and field.default_factory is MISSING
        read[field.name] = (Required if is_needed else NotRequired)[Annotated[_readable(hint), told]]
    config = ConfigDict(extra="forbid", json_schema_extra={"description": description, **RULES.get(cls, {})})
    return with_config(config)(_new_block(cls.__name__, read))


def _default(value: Any, marks: tuple[Any, ...]) -> Json:
    """Return a default as a user would write it; nothing where the description says what is taken."""
    if quantity := find_mark(Quantity, marks):
        return {} if value in (None, MISSING) else {"default": write_quantity(value, quantity)}
    if isinstance(value, Enum):
        return {"default": value.value}
    is_text = isinstance(value, str) and (value or not {type(mark) for mark in marks} & {Form, Shape})
    return {"default": value} if is_text or isinstance(value, int) else {}


def _made(cls: Any, values: Json) -> Any:
    """Return a block of its fields, with the defaults that depend on other fields."""
    made = cls(**{name: value for name, value in values.items() if name != "kind"})
    if isinstance(made, Component) and made.run is not None and made.run.attach is not None:
        made = replace(made, dedicated=True)  # it is measured where it runs, and nothing else runs there
    match made:
        case Host(platform=""):
            return replace(made, platform=made.name)
        case PartitionRequest(components=()):
            return replace(made, components=(made.name,))
        case Run(arrival=Periodic(period=period), deadline=None):
            return replace(made, deadline=period)
        case Component(runs_on=RunsOn.PARTITION, cpu=CpuRequest(reserve=None)) if made.apt:
            return replace(made, cpu=replace(made.cpu, reserve=Measured.MEASURED))
        case System():
            return replace(made, interference={**LOADS_WITHOUT_ENTRY, **made.interference})
        case _:
            return made
