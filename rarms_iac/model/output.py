"""Which parts of a result are its output: the JSON that `--json` prints, and its schema.

A field is part of it unless its type is `Internal`; a computed value is part of it if its property is marked with
`output`. `storage.codec.encode_output` writes it, `schemas/output.json` is made of the same types.
"""

from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import cache
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

T = TypeVar("T")

INTERNAL = "not of the output"
Internal = Annotated[T, INTERNAL]
"""The type of a field that is left out of the output: `Internal[int]`."""

OpenBound = Annotated[float, "null where it is infinite"]
"""A side of a band; where the samples do not bound it, it is infinite, and null in the output."""


class OutputText:
    """Base of a class whose values are written as a string in the output: `str(value)`."""

    __slots__ = ()


def output(compute: Callable[[Any], T]) -> Callable[[Any], T]:
    """Make a computed value part of the output; stands between `@property` and the function.

    Args:
        compute: the function of a property, with its return type.

    Returns:
        The same function, marked.
    """
    compute.is_output = True  # type: ignore[attr-defined]  # functions have attributes
    return compute


@cache
def output_hints(record: type) -> Mapping[str, Any]:
    """Return which parts of a dataclass are its output, in order: its fields, then its marked properties.

    Args:
        record: a dataclass.

    Returns:
        The type of each part by name.
    """
    hints = get_type_hints(record, include_extras=True)
    computed = {
        name: get_type_hints(member.fget, include_extras=True)["return"]
        for cls in reversed(record.__mro__)
        for name, member in vars(cls).items()
        if isinstance(member, property) and hasattr(member.fget, "is_output")
    }
    stored = {field.name: hints[field.name] for field in fields(record) if not _is_internal(hints[field.name])}
    return {**stored, **computed}


def _is_internal(hint: Any) -> bool:
    return get_origin(hint) is Annotated and INTERNAL in get_args(hint)
