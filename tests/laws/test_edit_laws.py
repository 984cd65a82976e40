"""An edit does what it says to the values, and nothing to the comments."""

import re
from typing import Any

from hypothesis import assume, event, given
from hypothesis import strategies as st

from rarms_iac.manifest.edit.formatting import CannotFormat, format_text
from rarms_iac.manifest.edit.values import remove_value, set_value
from rarms_iac.manifest.text.events import ParsedText
from rarms_iac.manifest.text.reading import read_text
from rarms_iac.model.diagnostics import Diagnostic, has_errors
from tests.badly_written import comments, manifests

_PLAIN = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-999, 999),
    st.sampled_from(
        ["no", "88 ms", "a: b", "", "x", "7", "it's", "- x", "two\nlines", "# no comment", "{x", "long " * 40]
    ),
)
_VALUES = st.recursive(
    _PLAIN,
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["a", "7", "x y", "no"]), inner, max_size=3)
    ),
    max_leaves=5,
)


def _values(text: str) -> Any:
    tree = read_text(text.encode(), "rarms.yaml", "")
    assume(not has_errors(tree.diagnostics) and isinstance(tree.value, dict))
    assume("«" not in str(tree.value))  # there it is text of a block, and no comment
    return tree.value


def _paths(value: Any) -> list[tuple[str, ...]]:
    if not isinstance(value, dict):
        return []
    return [(key, *rest) for key, inner in value.items() for rest in [(), *_paths(inner)]]


def _with(value: Any, path: tuple[str, ...], new: Any) -> Any:
    if not path:
        return new
    return {**value, path[0]: _with(value.get(path[0]) or {}, path[1:], new)}


def _without(value: dict[str, Any], path: tuple[str, ...]) -> dict[str, Any]:
    if len(path) == 1:
        return {key: inner for key, inner in value.items() if key != path[0]}
    return {**value, path[0]: _without(value[path[0]], path[1:])}


@given(text=manifests(), data=st.data(), new=_VALUES, canonical=st.booleans())
def test_setting_a_value_keeps_comments(text: str, data: st.DataObject, new: Any, canonical: bool) -> None:
    before = _values(text)
    if canonical:
        text = format_text(text, "rarms.yaml")
        before = _values(text)
    path = data.draw(st.sampled_from(_paths(before)))

    after = set_value(text, path, new)

    assert _values(after) == _with(before, path, new)
    assert comments(after) == comments(text)
    assert not canonical or format_text(after, "rarms.yaml") == after


@given(text=manifests(), data=st.data(), new=_VALUES)
def test_adding_a_key_keeps_comments(text: str, data: st.DataObject, new: Any) -> None:
    before = _values(text)
    maps = [path for path in [(), *_paths(before)] if isinstance(_at(before, path), dict)]
    path = (*data.draw(st.sampled_from(maps)), *data.draw(st.sampled_from([("new",), ("new", "newer"), ("limit",)])))
    assume(path not in _paths(before))

    after = set_value(text, path, new)

    assert _values(after) == _with(before, path, new)
    assert comments(after) == comments(text)


@given(text=manifests(), data=st.data())
def test_removing_a_key_removes_it_alone(text: str, data: st.DataObject) -> None:
    before = _values(text)
    path, heir = data.draw(st.sampled_from(_paths(before))), data.draw(st.sampled_from(_paths(before)))

    assert _values(remove_value(text, path)) == _without(before, path)
    kept = remove_value(text, path, heir)
    assert _values(kept) == _without(before, path)
    assert comments(kept) == comments(text)


def _at(value: Any, path: tuple[str, ...]) -> Any:
    for key in path:
        value = value[key]
    return value


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
