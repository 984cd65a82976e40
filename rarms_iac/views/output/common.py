"""What every output has in common, its JSON text, and what a command answers beside or instead of a result.

`schemas/output.json` says what that text looks like.
"""

from dataclasses import MISSING, dataclass, fields
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")


@dataclass(frozen=True, slots=True, kw_only=True)
class Output:
    """A whole answer; each kind names itself in `kind`."""


def output_of(cls: type[T], source: object, **different: object) -> T:
    """The output with the attributes of the same name that a value has.

    Args:
        cls: a class of this room, whose fields say what is written; those with a default keep it.
        source: the value that is shown.
        different: fields that are called or computed otherwise.

    Raises:
        AttributeError: the value lacks a field, which tests show.
    """
    values = {
        field.name: getattr(source, field.name)
        for field in fields(cls)
        if field.default is MISSING and field.name not in different
    }
    return cls(**values, **different)
