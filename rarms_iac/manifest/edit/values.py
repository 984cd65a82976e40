"""Changes one value of a manifest's text in place: comments and the rest of the text stay as they are.

A path is the keys from the top: `("components", "vision", "cpu", "reserve")`. A text that was canonical stays so.
"""

from collections.abc import Callable, Sequence

from rarms_iac.manifest.edit.formatting import CannotFormat, format_text
from rarms_iac.manifest.edit.splice import (
    Route,
    commented,
    comments_at,
    inserted,
    inserted_at_root,
    is_blank,
    removed,
    replaced,
    walk,
)
from rarms_iac.manifest.text.tree import Collection, Entry, Node, Scalar, build_tree, unified

Value = str | int | float | bool | None | Sequence["Value"] | dict[str, "Value"]
Path = Sequence[str]

__all__ = ["CannotFormat", "NoSuchPlace", "Value", "remove_value", "set_value"]


class NoSuchPlace(LookupError):
    """The manifest has nothing at this path, or something that has no keys on the way to it."""

    def __init__(self, path: Path, why: str) -> None:
        super().__init__(f"{'.'.join(path)}: {why}")
        self.path = tuple(path)


def set_value(text: str, path: Path, value: Value) -> str:
    """Return the text with this value at the path; keys that are missing on the way are added at their canonical place.

    Comments inside a value that is replaced move above it.

    Raises:
        CannotFormat: the text is no manifest.
        NoSuchPlace: something on the way has no keys.
    """
    return _edit(text, lambda plain: _set(plain, tuple(path), value))


def remove_value(text: str, path: Path, comments_to: Path = ()) -> str:
    """Return the text without the key at the path and its value.

    The comments that belong to it move above the path `comments_to`, or above as much of that path as exists; without
    such a path they are removed, too.

    Raises:
        CannotFormat: the text is no manifest.
        NoSuchPlace: there is nothing at the path.
    """
    return _edit(text, lambda plain: _removed(plain, tuple(path), tuple(comments_to)))


def _edit(text: str, change: Callable[[str], str]) -> str:
    """Return the changed text, canonical if it was, with the line ends and the byte order mark that it had."""
    plain = unified(text)
    was_canonical = format_text(text, "rarms.yaml") == plain
    changed = change(plain)
    if was_canonical:
        changed = format_text(changed, "rarms.yaml")
    if "\r\n" in text:
        changed = changed.replace("\n", "\r\n")
    return "\ufeff" * text.startswith("\ufeff") + changed


def _set(text: str, path: tuple[str, ...], value: Value) -> str:
    route = walk(build_tree(text), path)
    if not route.missing:
        return replaced(text, route, _node(value, len(path)))
    first, *inner = route.missing
    for key in reversed(inner):
        value = {key: value}
    depth = len(route.steps) + 1
    if isinstance(route.end, Collection) and route.end.is_mapping and route.end.entries:
        return inserted(text, route, first, _node(value, depth))
    if not is_blank(route.end):
        raise NoSuchPlace(path, f"{'.'.join(path[: len(route.steps)])} has no keys")
    if not route.steps:
        return inserted_at_root(text, first, _node(value, depth))
    return replaced(text, route, _node({first: value}, depth - 1))


def _removed(text: str, path: tuple[str, ...], comments_to: tuple[str, ...]) -> str:
    route = _whole(text, path)
    is_only = len(route.steps[-1].parent.entries) == 1  # its comments stay beside the `{}`
    comments = comments_at(text, route) if comments_to and not is_only else []
    without = removed(text, route)
    return commented(without, walk(build_tree(without), comments_to), comments) if comments else without


def _whole(text: str, path: tuple[str, ...]) -> Route:
    route = walk(build_tree(text), path)
    if route.missing or not path:
        raise NoSuchPlace(path, "there is nothing at this path")
    return route


def _node(value: Value, depth: int) -> Node:
    """Return the value as it will be written: maps of plain values on one line, but not a section or a named thing."""
    match value:
        case None | bool():
            return Scalar({None: "null", True: "true", False: "false"}[value], "", 0, 0)
        case int() | float():
            return Scalar(repr(value), "", 0, 0)
        case str():
            return Scalar(value, "'", 0, 0)
        case dict():
            entries = [Entry(Scalar(key, "'", 0, 0), _node(each, depth + 1), []) for key, each in value.items()]
            flow = depth > 2 and not any(isinstance(each, dict) for each in value.values())
            return Collection(True, flow, 0, 0, 0, entries)
        case _:
            return Collection(False, True, 0, 0, 0, [Entry(None, _node(each, depth + 1), []) for each in value])
