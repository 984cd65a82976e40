"""Cases of findings, problems that a user can cause or correct, as values; `texts/findings.py` makes them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal, Protocol, TypeAlias

from rarms_iac.model.commands import Prose, RecommendedCommand
from rarms_iac.model.output import output

Fact: TypeAlias = str | bool | int | float | tuple[str, ...]
Facts: TypeAlias = Mapping[str, Fact]
"""The names and numbers behind a message, each under a name of its own."""


class Severity(StrEnum):
    """Only an error stops a command."""

    ERROR = "error"
    WARNING = "warning"
    NOTE = "note"


@dataclass(frozen=True, slots=True, kw_only=True, order=True)
class Place:
    """A spot in a file a user wrote: `file:line:column`, both counted from 1 in characters."""

    file: str
    line: int
    column: int
    path: str = ""  # where in the document, dotted: hosts.onboard.memory
    length: int = 1  # characters to underline on that line

    def __str__(self) -> str:
        """Return the form that editors and terminals open."""
        return f"{self.file}:{self.line}:{self.column}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Related:
    """A second place of the same problem, with a label."""

    place: Place
    message: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnostic:
    """One case of a finding, ready to be rendered."""

    code: str
    severity: Severity
    summary: str
    detail: str
    advice: Prose
    place: Place | None = None
    address: str = ""  # what it is about, as `policy.accept` names it: partition/vision
    related: tuple[Related, ...] = ()
    values: Facts = field(default_factory=dict, hash=False)

    @output
    def commands(self) -> tuple[RecommendedCommand, ...]:
        """The commands that it recommends."""
        return self.advice.commands


def in_order(diagnostics: "list[Diagnostic] | tuple[Diagnostic, ...]") -> tuple[Diagnostic, ...]:
    """Sort findings by place, then code, then text; those without a place come first.

    RARMS400 comes before others of its place: a misspelt name in an overlay explains why keys are missing there.
    """

    def key(diagnostic: Diagnostic) -> tuple[str, int, int, bool, str, str, str]:
        file, line, column = (
            (diagnostic.place.file, diagnostic.place.line, diagnostic.place.column) if diagnostic.place else ("", 0, 0)
        )
        is_later = diagnostic.code != "RARMS400"
        return file, line, column, is_later, diagnostic.code, diagnostic.address, diagnostic.detail

    return tuple(sorted(diagnostics, key=key))


def has_errors(diagnostics: "list[Diagnostic] | tuple[Diagnostic, ...]") -> bool:
    """Return whether one of them is an error."""
    return any(diagnostic.severity is Severity.ERROR for diagnostic in diagnostics)


def count_severities(diagnostics: Sequence[Diagnostic]) -> dict[str, int]:
    """Count findings by severity: `{"errors": 1, "warnings": 0, "notes": 2}`."""
    return {
        f"{severity.value}s": sum(diagnostic.severity is severity for diagnostic in diagnostics)
        for severity in Severity
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class Findings:
    """The findings of a command, and those that the policy accepts."""

    kind: Literal["findings"] = "findings"
    findings: tuple[Diagnostic, ...]
    accepted: tuple[Diagnostic, ...] = ()

    @output
    def counts(self) -> Mapping[str, int]:
        """How many findings there are of each severity."""
        return count_severities(self.findings)


class Places(Protocol):
    """The places of values and keys in the manifest files; asked only for a finding."""

    def value(self, *path: str | int) -> Place:
        """Return the place of the value at this path; of the nearest parent that exists where it does not.

        Args:
            path: keys and positions from the document's root.

        Returns:
            File, line and column, counted from 1.
        """

    def key(self, *path: str | int) -> Place:
        """Return the place of the key at this path, likewise.

        Returns:
            File, line and column, counted from 1.
        """

    def text(self, *path: str | int) -> str:
        """Return the text of the scalar at this path as it is written; empty if it stands in quotes or is not there."""


Sources = Mapping[str, str | Sequence[str]]
"""The text of each file, or its lines, by the name that places use."""
