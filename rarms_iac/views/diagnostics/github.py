"""Findings as workflow commands, which GitHub shows beside the changed lines."""

from collections.abc import Sequence
from pathlib import PurePath

from rarms_iac.model.diagnostics import Diagnostic, Severity
from rarms_iac.views.diagnostics.layout import visible

COMMANDS = {Severity.ERROR: "error", Severity.WARNING: "warning", Severity.NOTE: "notice"}


def as_github(diagnostics: Sequence[Diagnostic]) -> str:
    """One command a line; nothing where there is nothing to tell."""
    return "".join(
        f"::{COMMANDS[diagnostic.severity]} {_properties(diagnostic)}::{_message(diagnostic)}\n"
        for diagnostic in diagnostics
    )


def _properties(diagnostic: Diagnostic) -> str:
    properties: dict[str, str | int] = {}
    if diagnostic.place is not None:
        properties = {
            "file": PurePath(diagnostic.place.file).as_posix(),
            "line": diagnostic.place.line,
            "endLine": diagnostic.place.line,
            "col": diagnostic.place.column,
            "endColumn": diagnostic.place.column
            + max(diagnostic.place.length, 1)
            - 1,  # the last column itself: it defaults to col
        }
    properties["title"] = f"{diagnostic.code} {diagnostic.summary}"
    return ",".join(f"{name}={_property(str(value))}" for name, value in properties.items())


def _message(diagnostic: Diagnostic) -> str:
    return _data("\n".join(part for part in (diagnostic.detail, diagnostic.advice) if part))


def _data(text: str) -> str:
    """The text as a command's message: per cent and line ends escaped, so that no text can begin a command."""
    return visible(text, keep="\r\n").replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    """The text as a property's value: colon and comma would end it."""
    return _data(text).replace(":", "%3A").replace(",", "%2C")
