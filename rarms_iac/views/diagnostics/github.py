"""Findings as workflow commands, which GitHub shows beside the changed lines."""

from collections.abc import Sequence
from pathlib import PurePath

from rarms_iac.model.diagnostics import Diagnostic, Severity
from rarms_iac.views.diagnostics.layout import visible

COMMANDS = {Severity.ERROR: "error", Severity.WARNING: "warning", Severity.NOTE: "notice"}


def as_github(diagnostics: Sequence[Diagnostic]) -> str:
    """One command a line; nothing where there is nothing to tell."""
    return "".join(f"::{COMMANDS[one.severity]} {_properties(one)}::{_message(one)}\n" for one in diagnostics)


def _properties(one: Diagnostic) -> str:
    properties: dict[str, str | int] = {}
    if one.place is not None:
        properties = {
            "file": PurePath(one.place.file).as_posix(),
            "line": one.place.line,
            "endLine": one.place.line,
            "col": one.place.column,
            "endColumn": one.place.column + max(one.place.length, 1) - 1,  # the last column itself: it defaults to col
        }
    properties["title"] = f"{one.code} {one.summary}"
    return ",".join(f"{name}={_property(str(value))}" for name, value in properties.items())


def _message(one: Diagnostic) -> str:
    return _data("\n".join(part for part in (one.detail, one.advice) if part))


def _data(text: str) -> str:
    """The text as a command's message: per cent and line ends escaped, so that no text can begin a command."""
    return visible(text, keep="\r\n").replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    """The text as a property's value: colon and comma would end it."""
    return _data(text).replace(":", "%3A").replace(",", "%2C")
