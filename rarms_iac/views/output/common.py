"""What every output has in common, its JSON text, and what a command answers beside or instead of a result.

`schemas/output.json` says what that text looks like.
"""

import json
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from typing import TYPE_CHECKING, Literal, TypeVar

from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.storage.codec import Json, encode

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")

Format = Literal["rarms-output/2"]
FORMAT_VERSION: Format = "rarms-output/2"


@dataclass(frozen=True, slots=True, kw_only=True)
class Output:
    """A whole answer; each kind names itself in `kind`."""

    format_version: Format = FORMAT_VERSION


def as_json(output: Output) -> str:
    """The whole answer in ASCII, keys in our order, ending with a line end."""
    return json.dumps(_encodable(encode(output)), indent=2) + "\n"


def as_json_line(output: Output) -> str:
    """The same on one line, where several follow each other."""
    return json.dumps(_encodable(encode(output))) + "\n"


def _encodable(value: Json) -> Json:
    """The value without lone surrogates: strict parsers refuse their escapes."""
    match value:
        case str():
            return value.encode("utf-8", "replace").decode("utf-8")
        case list():
            return [_encodable(item) for item in value]
        case dict():
            return {key: _encodable(item) for key, item in value.items()}
        case _:
            return value


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


@dataclass(frozen=True, slots=True, kw_only=True)
class FindingsOutput(Output):
    """`rarms validate`, and any command that ends before it has an answer of its own."""

    kind: Literal["findings"] = "findings"
    findings: tuple[Diagnostic, ...]
    accepted: tuple[Diagnostic, ...]
    counts: Mapping[str, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class FormattedFileOutput:
    """A file that `rarms fmt` looked at."""

    file: str
    changed: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class FmtOutput(Output):
    """`rarms fmt`."""

    kind: Literal["fmt"] = "fmt"
    files: tuple[FormattedFileOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class WrittenOutput(Output):
    """`rarms init`, `snapshot`: files that were written."""

    kind: Literal["written"] = "written"
    files: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplanationOutput(Output):
    """`rarms explain`: a page in Markdown."""

    kind: Literal["explanation"] = "explanation"
    subject: str
    page: str
