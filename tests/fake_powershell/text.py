"""PowerShell's text: the format operator, regular expressions of .NET, and JSON as 5.1 and 7 write it."""

import json
import re
from collections.abc import Mapping
from functools import cache
from typing import Any

from tests.fake_powershell.values import (
    EMPTY,
    Char,
    Enumerated,
    Guid,
    Long,
    Record,
    ScriptError,
    Table,
    Unsupported,
    Value,
    text,
)

_HOLE = re.compile(r"\{\{|\}\}|\{(?P<at>[0-9]+)(?:,(?P<width>-?[0-9]+))?(?::(?P<form>[^}]*))?\}|[{}]")


def formatted(form: str, values: list[Value]) -> str:
    """`form -f values`."""

    def fill(hole: re.Match[str]) -> str:
        if hole[0] in ("{{", "}}"):
            return hole[0][0]
        if hole["at"] is None:
            raise Unsupported(f"the format {form!r} has a single brace")
        value = values[int(hole["at"])]
        shown = _shaped(value, hole["form"])
        width = int(hole["width"] or 0)
        return shown.ljust(-width) if width < 0 else shown.rjust(width)

    return _HOLE.sub(fill, form)


def _shaped(value: Value, form: str | None) -> str:
    if not form:
        return text(value)
    if re.fullmatch("x[0-9]+", form) and isinstance(value, int):
        return format(value, f"0{form[1:]}x")
    raise Unsupported(f"the format {form!r}")


@cache
def regex(pattern: str, *, case: bool) -> re.Pattern[str]:
    """A pattern of .NET; only what means the same in Python is used."""
    as_python = re.sub(r"\(\?<(?=[A-Za-z])", "(?P<", pattern).replace(r"\z", r"\Z")
    return re.compile(as_python, 0 if case else re.IGNORECASE)


def like(value: str, pattern: str, *, case: bool) -> bool:
    """A wildcard pattern with `*` only."""
    if re.search(r"[\[\]?`]", pattern):
        raise Unsupported(f"the wildcard pattern {pattern!r}")
    return bool(regex("^(?s:" + ".*".join(map(re.escape, pattern.split("*"))) + r")\z", case=case).match(value))


def to_json(value: Value, *, windows_powershell: bool) -> str:
    """`ConvertTo-Json -Compress`: 5.1 escapes a few characters that 7 leaves alone."""
    shown = json.dumps(_plain(value), ensure_ascii=False, separators=(",", ":"))
    if windows_powershell:
        for character in "<>&'":
            shown = shown.replace(character, f"\\u{ord(character):04x}")
    return shown


def _plain(value: Value) -> Any:
    match value:
        case bool() | None:
            return value
        case Char() | Guid():
            return str(value)
        case int() | float() | str():
            return value
        case Enumerated():
            raise Unsupported("an enumeration in JSON becomes a number")
        case list() | bytes():
            return [_plain(item) for item in value]
        case Table():
            return {text(key): _plain(item) for key, item in value.items()}
        case Record():
            return {key: _plain(item) for key, item in value.properties.items()}
        case _:
            if value is EMPTY:
                raise Unsupported("nothing in JSON is {} in 5.1 and null in 7")
            raise Unsupported(f"{value!r} in JSON")


RESERVED = ("psobject", "psbase", "psadapted", "psextended", "pstypenames")
"""Members that every object of PowerShell has: it makes none with a property of that name."""


def from_json(source: str) -> Value:
    """`ConvertFrom-Json`: objects are records, numbers 64 bits wide (as 7 has them)."""
    return _object(json.loads(source))


def _object(value: Any) -> Value:
    match value:
        case bool() | None | str():
            return value
        case int():
            return Long(value)
        case list():
            return [_object(item) for item in value]
        case Mapping():
            if reserved := [key for key in value if key.lower() in RESERVED]:
                raise ScriptError(f'The member name "{reserved[0]}" is reserved.', error_id="ReservedMemberName")
            return Record(**{key: _object(item) for key, item in value.items()})
        case _:
            raise Unsupported(f"{value!r} in JSON")


def joined(values: list[Value], between: Value) -> str:
    return text(between).join(text(value) for value in values)
