"""Formatting keeps what a manifest means and says, and is its own fixed point."""

import re
from typing import Any

from hypothesis import assume, event, given
from hypothesis import strategies as st

from rarms_iac.manifest.edit.formatting import CannotFormat, format_text
from rarms_iac.manifest.text.reading import ParsedText, read_text
from rarms_iac.model.diagnostics import Diagnostic, has_errors
from tests.badly_written import comments, manifests


def _read(text: str) -> ParsedText:
    return read_text(text.encode(), "rarms.yaml", "")


def _meaning(text: str) -> Any:
    tree = _read(text)
    assert not has_errors(tree.diagnostics)
    return _without_spaces_before_units(tree.value)


def _without_spaces_before_units(value: Any) -> Any:
    """The values, numbers told from texts; `88ms` and `88 ms` are the same quantity."""
    match value:
        case dict():
            return {key: _without_spaces_before_units(each) for key, each in value.items()}
        case list():
            return [_without_spaces_before_units(each) for each in value]
        case str():
            return re.sub(r"^([0-9]+(?:\.[0-9]+)?) ?([A-Za-z%/]+)$", r"\1 \2", value)
        case _:
            return (type(value).__name__, value)


def _user_order(value: Any, path: tuple[str, ...] = ()) -> Any:
    """The key order of maps that the user names."""
    if isinstance(value, dict):
        inner = {key: _user_order(each, (*path, key)) for key, each in value.items()}
        return list(inner.items()) if path in {("hosts",), ("components",)} else sorted(inner.items())
    return [_user_order(each, (*path, "")) for each in value] if isinstance(value, list) else value


@given(manifests())
def test_formatting_keeps_meaning_and_comments(text: str) -> None:
    assume(not has_errors(_read(text).diagnostics))
    meaning = _meaning(text)
    event("with comments" if "#" in text else "without comments")

    formatted = format_text(text, "rarms.yaml")

    assert _meaning(formatted) == meaning
    assert _user_order(_meaning(formatted)) == _user_order(meaning)
    assert comments(formatted) == comments(text)
    assert format_text(formatted, "rarms.yaml") == formatted
    assert formatted.endswith("\n")
    assert "\r" not in formatted
    assert not formatted.startswith("\ufeff")


@given(st.text(st.sampled_from("ab:-#?[]{},&*!|>'\"%@` \n\t~\r\ufeff\u2028é"), max_size=40))
def test_any_text_is_formatted_or_refused_with_place(text: str) -> None:
    refused: tuple[Diagnostic, ...] = ()
    formatted = ""
    try:
        formatted = format_text(text, "rarms.yaml")
    except CannotFormat as refusal:
        refused = refusal.diagnostics
    if refused:
        assert all(diagnostic.place is not None for diagnostic in refused)
        return
    assert format_text(formatted, "rarms.yaml") == formatted
    assert _meaning(formatted) == _meaning(text)
