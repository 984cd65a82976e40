"""Change one value of a manifest's text in place: comments and the rest of the text stay as they are.

A path is the keys from the top: `("components", "vision", "cpu", "reserve")`. A text that was canonical stays so.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rarms_iac.manifest.document.schema import ValueShape, manifest_shape
from rarms_iac.manifest.edit.formatting import CannotFormat, format_text, format_tree, read_manifest
from rarms_iac.manifest.edit.write import write_entry, write_flow, write_key
from rarms_iac.manifest.text.tree import Collection, Entry, Node, Scalar, Tree, is_null

_COLON = re.compile(r"(?:\s|#[^\n]*\n)*:")
_COMMA = re.compile(r"(?:\s|#[^\n]*\n)*(,)")
_SECTION_DEPTH = 1  # entries of the document and of its sections have a blank line between them


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
        CannotFormat: the text is not a manifest.
        NoSuchPlace: something on the way has no keys.
    """
    return _edit(text, lambda tree: _set(tree, tuple(path), value))


def remove_value(text: str, path: Path, comments_to: Path = ()) -> str:
    """Return the text without the key at the path and its value.

    The comments that belong to it move above the path `comments_to`, or above as much of that path as exists; without
    such a path they are removed, too.

    Raises:
        CannotFormat: the text is not a manifest.
        NoSuchPlace: there is nothing at the path.
    """
    return _edit(text, lambda tree: _removed(tree, tuple(path), tuple(comments_to)))


def _edit(text: str, change: Callable[[Tree], str]) -> str:
    """Return the changed text, canonical if it was, with the line ends and the byte order mark that it had."""
    parsed = read_manifest(text)
    changed = change(parsed.tree())
    if format_tree(parsed) == parsed.source.text:
        changed = format_text(changed, "rarms.yaml")
    if "\r\n" in text:
        changed = changed.replace("\n", "\r\n")
    return "\ufeff" * text.startswith("\ufeff") + changed


def _set(tree: Tree, path: tuple[str, ...], value: Value) -> str:
    route = _walk(tree, path)
    if not route.missing:
        return _replaced(route, _node(value, len(path)))
    first, *inner = route.missing
    for key in reversed(inner):
        value = {key: value}
    depth = len(route.steps) + 1
    if isinstance(route.end, Collection) and route.end.is_mapping and route.end.entries:
        return _inserted(route, route.end, first, _node(value, depth))
    if not _is_blank(route.end):
        raise NoSuchPlace(path, f"{'.'.join(path[: len(route.steps)])} has no keys")
    if not route.steps:
        comments = tree.comments_in(0, len(tree.source.text))
        entry = Entry(Scalar(first), _node(value, depth))
        return "\n".join([*comments, *write_entry(entry, manifest_shape(), 0), ""])
    return _replaced(route, _node({first: value}, depth - 1))


def _removed(tree: Tree, path: tuple[str, ...], comments_to: tuple[str, ...]) -> str:
    route = _walk(tree, path)
    if route.missing or not path:
        raise NoSuchPlace(path, "this path does not exist")
    is_only = len(route.steps[-1].parent.entries) == 1  # its comments stay next to the `{}`
    comments = _comments_at(route) if comments_to and not is_only else []
    without = _without(route)
    return _commented(without, _walk(read_manifest(without).tree(), comments_to), comments) if comments else without


def _node(value: Value, depth: int) -> Node:
    """Return the value as it will be written: maps of plain values on one line, but not a section or a named thing."""
    match value:
        case None | bool():
            return Scalar({None: "null", True: "true", False: "false"}[value], "")
        case int() | float():
            return Scalar(repr(value), "")
        case str():
            return Scalar(value)
        case dict():
            entries = [Entry(Scalar(key), _node(each, depth + 1)) for key, each in value.items()]
            flow = depth > 2 and not any(isinstance(each, dict) for each in value.values())
            return Collection(True, flow, entries)
        case _:
            return Collection(False, True, [Entry(None, _node(each, depth + 1)) for each in value])


@dataclass(frozen=True, slots=True)
class _Step:
    """A key on the way: the map that has it, what is known of that map, and the key with its value."""

    parent: Collection
    shape: ValueShape
    entry: Entry

    @property
    def key(self) -> Scalar:
        """The key itself."""
        assert self.entry.key is not None, "steps lead through maps"
        return self.entry.key


@dataclass(frozen=True, slots=True)
class _Route:
    """The reach of a path: the steps found, their end, and the keys that are missing."""

    tree: Tree
    steps: tuple[_Step, ...]
    end: Node
    shape: ValueShape  # of `end`
    missing: tuple[str, ...]

    @property
    def text(self) -> str:
        """The text that the tree was built of."""
        return self.tree.source.text


def _walk(tree: Tree, path: tuple[str, ...]) -> _Route:
    """Follow the keys of a path as far as they are there."""
    node = tree.root
    shape = manifest_shape()
    steps: list[_Step] = []
    for name in path:
        entry = _entry_of(node, name)
        if entry is None:
            break
        assert isinstance(node, Collection)
        steps.append(_Step(node, shape, entry))
        node, shape = entry.value, shape.of(name)
    return _Route(tree, tuple(steps), node, shape, path[len(steps) :])


def _is_blank(node: Node) -> bool:
    if isinstance(node, Collection):
        return node.is_mapping and not node.entries
    return is_null(node)


def _replaced(route: _Route, new: Node) -> str:
    """Return the text with another value at the end of the route; comments inside the old one move above."""
    text, step = route.text, route.steps[-1]
    colon = _after_colon(text, step.key)
    start, end = _span(text, step.entry.value, colon)
    moved = route.tree.comments_in(colon, end)
    if step.parent.flow:
        written = write_flow(new, route.shape)
    else:
        indent = _column(text, step.key.start)
        head = " " * indent + write_key(step.key.text, flow=False)
        named = Entry(Scalar(step.key.text), new)
        written = "\n".join(write_entry(named, step.shape, indent))[len(head) :].removeprefix(" ")
    gap = text[colon:start]
    if written.startswith("\n"):
        gap = ""
    elif "\n" in gap or not gap:
        gap = " "
    changed = text[:colon] + gap + written + text[end:]
    return _commented(changed, route, moved)


def _inserted(route: _Route, node: Collection, name: str, new: Node) -> str:
    """Return the text with a new key in the map at the end of the route, at its canonical place."""
    text = route.text
    before = _sibling_before(node, route.shape, name)
    if node.flow:
        written = f"{write_key(name, flow=True)} {write_flow(new, route.shape.of(name))}"
        if before is None:
            at = _key_of(node.entries[0]).start
            return f"{text[:at]}{written}, {text[at:]}"
        at = _flow_end(text, before)
        return f"{text[:at]}, {written}{text[at:]}"
    first = _key_of(node.entries[0])
    indent = _column(text, first.start)
    lines = write_entry(Entry(Scalar(name), new), route.shape, indent)
    if before is None:
        return _with_lines(text, _above(text, first), lines)
    at = _below(text, before, indent)
    is_section = len(route.steps) <= _SECTION_DEPTH and len(lines) > 1
    return _with_lines(text, at, ["", *lines] if is_section and not _ends_in_block_scalar(before) else lines)


def _without(route: _Route) -> str:
    """Return the text without the key at the end of the route, its value and the comments directly above it.

    Where it was the only one of its map, comments stay.
    """
    text, step = route.text, route.steps[-1]
    siblings = step.parent.entries
    if len(siblings) == 1:
        if len(route.steps) == 1:
            return "\n".join([*route.tree.comments_in(0, len(text)), "{}", ""])
        inner = _Route(route.tree, route.steps[:-1], step.parent, step.shape, ())
        return _replaced(inner, Collection(True, True))
    if step.parent.flow:
        return _removed_from_flow(text, siblings, siblings.index(step.entry))
    start = _above(text, step.key)
    end = _below(text, step.entry, _column(text, step.key.start))
    while (blank := re.compile(r"[ \t]*\n").match(text, end)) is not None:
        end = blank.end()
    return text[:start] + text[end:]


def _comments_at(route: _Route) -> list[str]:
    """Return the comments that go when the key at the end of the route does: above it, next to it and inside."""
    text, step = route.text, route.steps[-1]
    if step.parent.flow:
        return route.tree.comments_in(step.key.start, _flow_end(text, step.entry))
    end = _below(text, step.entry, _column(text, step.key.start))
    return route.tree.comments_in(_above(text, step.key), end)


def _commented(text: str, route: _Route, comments: list[str]) -> str:
    """Return the text with these comments above the last key of the route that has a line of its own, or at the end."""
    own_line = [step.key for step in route.steps if not step.parent.flow]
    return _with_comments_above(text, own_line[-1], comments) if own_line else _with_lines(text, len(text), comments)


def _removed_from_flow(text: str, siblings: list[Entry], number: int) -> str:
    start, end = _key_of(siblings[number]).start, _flow_end(text, siblings[number])
    comma = _COMMA.match(text, _flow_end(text, siblings[number - 1]) if number else end)
    assert comma is not None, "a comma stands between two entries"
    at = comma.start(1)
    if number:
        return text[:at] + text[at + 1 : start].rstrip(" ") + text[end:]
    return text[:start] + text[end:at] + text[at + 1 :].lstrip(" ")


def _entry_of(node: Node, name: str) -> Entry | None:
    if isinstance(node, Scalar) or not node.is_mapping:
        return None
    return next((entry for entry in node.entries if entry.key and entry.key.text == name), None)


def _key_of(entry: Entry) -> Scalar:
    assert entry.key is not None, "an entry of a map has a key"
    return entry.key


def _column(text: str, at: int) -> int:
    return at - (text.rfind("\n", 0, at) + 1)


def _after_colon(text: str, key: Scalar) -> int:
    found = _COLON.match(text, key.end)
    return found.end() if found else key.end


def _span(text: str, node: Node, colon: int) -> tuple[int, int]:
    """Return the begin and end of a value; an empty one lies right behind its colon."""
    if isinstance(node, Scalar) and node.start == node.end:
        return colon, colon
    if isinstance(node, Scalar) and node.style in {"|", ">"}:
        return node.start, node.start + len(text[node.start : node.end].rstrip())
    return node.start, node.end


def _flow_end(text: str, entry: Entry) -> int:
    colon = _after_colon(text, _key_of(entry))
    return max(colon, _span(text, entry.value, colon)[1])


def _sibling_before(node: Collection, shape: ValueShape, name: str) -> Entry | None:
    """Return the last entry that canonically stands before the new key."""
    before = [entry for entry in node.entries if shape.rank(_key_of(entry).text) <= shape.rank(name)]
    return before[-1] if before else None


def _last_leaf(entry: Entry) -> Scalar | Collection | None:
    value = entry.value
    if isinstance(value, Collection) and not value.flow and value.entries:
        return _last_leaf(value.entries[-1])
    return value if isinstance(value, Collection) or value.start != value.end else entry.key


def _ends_in_block_scalar(entry: Entry) -> bool:
    leaf = _last_leaf(entry)
    return isinstance(leaf, Scalar) and leaf.style in {"|", ">"}


def _above(text: str, key: Scalar) -> int:
    """Return the start of the key's line, or of the comments that stand directly above it in the same column."""
    column = _column(text, key.start)
    start = key.start - column
    while start > 0:
        line_start = text.rfind("\n", 0, start - 1) + 1
        if not text.startswith(" " * column + "#", line_start):
            break
        start = line_start
    return start


def _below(text: str, entry: Entry, column: int) -> int:
    """Return the start of the line after an entry and the comments that belong inside it."""
    leaf = _last_leaf(entry)
    end = _key_of(entry).end
    if leaf is not None:
        end = max(leaf.end, end)
    if not (_ends_in_block_scalar(entry) and text[end - 1 : end] == "\n"):
        end = _line_end(text, end)
    while (inner := re.compile(rf"(?:[ \t]*\n)*[ ]{{{column + 1},}}#[^\n]*(?:\n|\Z)").match(text, end)) is not None:
        end = inner.end()
    return end


def _line_end(text: str, at: int) -> int:
    found = text.find("\n", at)
    return len(text) if found < 0 else found + 1


def _with_lines(text: str, at: int, lines: list[str]) -> str:
    before = text[:at]
    if before and not before.endswith("\n"):
        before += "\n"
    return before + "\n".join([*lines, ""]) + text[at:]


def _with_comments_above(text: str, key: Scalar, comments: list[str]) -> str:
    """Return the text with comments on lines of their own above a key; what changed must lie behind the key."""
    if not comments:
        return text
    column = _column(text, key.start)
    return _with_lines(text, key.start - column, [" " * column + comment for comment in comments])
