"""The version that every output carries, and what a command answers beside or instead of a result."""

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from typing import TYPE_CHECKING, Literal, TypeVar

from rarms_iac.model.diagnostics import Diagnostic

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")

Format = Literal["rarms-output/2"]
FORMAT_VERSION: Format = "rarms-output/2"


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
class FindingsOutput:
    """`rarms validate`, and any command that ends before it has an answer of its own."""

    format_version: Format = FORMAT_VERSION
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
class FmtOutput:
    """`rarms fmt`."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["fmt"] = "fmt"
    files: tuple[FormattedFileOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class WrittenOutput:
    """`rarms init`, `snapshot`: files that were written."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["written"] = "written"
    files: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplanationOutput:
    """`rarms explain`: a page in Markdown."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["explanation"] = "explanation"
    subject: str
    page: str
