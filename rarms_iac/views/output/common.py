"""The version that every output carries, and what a command answers beside or instead of a result."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from rarms_iac.model.diagnostics import Diagnostic

Format = Literal["rarms-output/2"]
FORMAT_VERSION: Format = "rarms-output/2"


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


@dataclass(frozen=True, slots=True, kw_only=True)
class VersionOutput:
    """`rarms version`."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["version"] = "version"
    rarms: str
    python: str
    system: str
    libraries: Mapping[str, str]
