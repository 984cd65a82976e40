"""Which parts of a result are its output: the JSON that `--json` prints, and its schema.

A field is part of it unless its type is `Internal`; a computed value is part of it if it is a property made by
`output`. `storage.codec.encode_output` writes it, `schemas/output.json` is made of the same types.
"""

from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import cache
from typing import Annotated, Any, Generic, Self, TypeVar, get_args, get_origin, get_type_hints, overload

T = TypeVar("T")

INTERNAL = "not of the output"
Internal = Annotated[T, INTERNAL]
"""The type of a field that is left out of the output: `Internal[int]`."""

OpenBound = Annotated[float, "null where it is infinite"]
"""A side of a band; where the samples do not bound it, it is infinite, and null in the output."""


class OutputText:
    """Base of a class whose values are written as a string in the output: `str(value)`."""

    __slots__ = ()


class ComputedOutput(Generic[T]):
    """A computed value of a result that is part of its output; see `output`."""

    def __init__(self, compute: Callable[[Any], T]) -> None:
        self.compute = compute
        self.__doc__ = compute.__doc__

    @overload
    def __get__(self, result: None, owner: type) -> Self: ...
    @overload
    def __get__(self, result: object, owner: type) -> T: ...
    def __get__(self, result: object, owner: type) -> Self | T:
        return self if result is None else self.compute(result)


def output(compute: Callable[[Any], T]) -> ComputedOutput[T]:
    """Make a property whose value is part of the output.

    Args:
        compute: the function of the property, with its return type.

    Returns:
        The property.
    """
    return ComputedOutput(compute)


@cache
def output_hints(record: type) -> Mapping[str, Any]:
    """Return the parts of a dataclass that are its output, in order: its fields, then its marked properties.

    Returns:
        The type of each part by name.
    """
    hints = get_type_hints(record, include_extras=True)
    computed = {
        name: get_type_hints(member.compute, include_extras=True)["return"]
        for cls in reversed(record.__mro__)
        for name, member in vars(cls).items()
        if isinstance(member, ComputedOutput)
    }
    stored = {field.name: hints[field.name] for field in fields(record) if not _is_internal(hints[field.name])}
    return {**stored, **computed}


def _is_internal(hint: Any) -> bool:
    return get_origin(hint) is Annotated and INTERNAL in get_args(hint)
