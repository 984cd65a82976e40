"""Where in a text a value, a key, or a new key goes, and the text with it there."""

import re
from dataclasses import dataclass

from rarms_iac.manifest.edit.order import ValueShape, manifest_shape
from rarms_iac.manifest.edit.write import write_entry, write_flow, write_key
from rarms_iac.manifest.text.tree import Collection, Entry, Node, Scalar, comments_in, is_null

_COLON = re.compile(r"(?:\s|#[^\n]*\n)*:")
_COMMA = re.compile(r"(?:\s|#[^\n]*\n)*(,)")
_SECTION_DEPTH = 1  # entries of the document and of its sections have a blank line between them


@dataclass(frozen=True, slots=True)
class RouteStep:
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
class Route:
    """How far a path leads: the steps found, where they end, and the keys that are not there."""

    steps: tuple[RouteStep, ...]
    end: Node
    shape: ValueShape  # of `end`
    missing: tuple[str, ...]


def walk(root: Collection, path: tuple[str, ...]) -> Route:
    """Follows the keys of a path as far as they are there."""
    node: Node = root
    shape = manifest_shape()
    steps: list[RouteStep] = []
    for name in path:
        entry = _entry_of(node, name)
        if entry is None:
            break
        assert isinstance(node, Collection)
        steps.append(RouteStep(node, shape, entry))
        node, shape = entry.value, shape.of(name)
    return Route(tuple(steps), node, shape, path[len(steps) :])


def is_blank(node: Node) -> bool:
    """Whether it is null or an empty map."""
    if isinstance(node, Collection):
        return node.is_mapping and not node.entries
    return is_null(node)


def replaced(text: str, route: Route, new: Node) -> str:
    """Return the text with another value at the end of the route; comments inside the old one move above."""
    step = route.steps[-1]
    colon = _after_colon(text, step.key)
    start, end = _span(text, step.entry.value, colon)
    moved = comments_in(text, colon, end)
    if step.parent.flow:
        written = write_flow(new, route.shape)
    else:
        indent = _column(text, step.key.start)
        head = " " * indent + write_key(step.key.value, flow=False)
        named = Entry(Scalar(step.key.value, "'", 0, 0), new, [])
        written = "\n".join(write_entry(named, step.shape, indent))[len(head) :].removeprefix(" ")
    gap = text[colon:start]
    if written.startswith("\n"):
        gap = ""
    elif "\n" in gap or not gap:
        gap = " "
    changed = text[:colon] + gap + written + text[end:]
    return commented(changed, route, moved)


def inserted(text: str, route: Route, name: str, new: Node) -> str:
    """Return the text with a new key in the map at the end of the route, at its canonical place."""
    node = route.end
    assert isinstance(node, Collection)
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
    lines = write_entry(Entry(Scalar(name, "'", 0, 0), new, []), route.shape, indent)
    if before is None:
        return _with_lines(text, _above(text, first), lines)
    at = _below(text, before, indent)
    is_section = len(route.steps) <= _SECTION_DEPTH and len(lines) > 1
    return _with_lines(text, at, ["", *lines] if is_section and not _ends_in_block_scalar(before) else lines)


def inserted_at_root(text: str, name: str, new: Node) -> str:
    """Return the text of an empty document (`{}`) with its first key."""
    comments = comments_in(text, 0, len(text))
    return "\n".join([*comments, *write_entry(Entry(Scalar(name, "'", 0, 0), new, []), manifest_shape(), 0), ""])


def removed(text: str, route: Route) -> str:
    """Return the text without the key at the end of the route, its value and the comments directly above it.

    Where it was the only one of its map, comments stay.
    """
    step = route.steps[-1]
    siblings = step.parent.entries
    if len(siblings) == 1:
        empty = Collection(True, True, 0, 0, 0)
        inner = Route(route.steps[:-1], step.parent, step.shape, ())
        return replaced(text, inner, empty) if inner.steps else "\n".join([*comments_in(text, 0, len(text)), "{}", ""])
    if step.parent.flow:
        return _removed_from_flow(text, siblings, siblings.index(step.entry))
    start = _above(text, step.key)
    end = _below(text, step.entry, _column(text, step.key.start))
    while (blank := re.compile(r"[ \t]*\n").match(text, end)) is not None:
        end = blank.end()
    return text[:start] + text[end:]


def comments_at(text: str, route: Route) -> list[str]:
    """Return the comments that go when the key at the end of the route does: above it, beside it and inside."""
    step = route.steps[-1]
    if step.parent.flow:
        return comments_in(text, step.key.start, _flow_end(text, step.entry))
    return comments_in(text, _above(text, step.key), _below(text, step.entry, _column(text, step.key.start)))


def commented(text: str, route: Route, comments: list[str]) -> str:
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
    return next((entry for entry in node.entries if entry.key and entry.key.value == name), None)


def _key_of(entry: Entry) -> Scalar:
    assert entry.key is not None, "an entry of a map has a key"
    return entry.key


def _column(text: str, at: int) -> int:
    return at - (text.rfind("\n", 0, at) + 1)


def _after_colon(text: str, key: Scalar) -> int:
    found = _COLON.match(text, key.end)
    return found.end() if found else key.end


def _span(text: str, node: Node, colon: int) -> tuple[int, int]:
    """Where a value stands; an empty one stands right behind its colon."""
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
    place = {key: number for number, key in enumerate(shape.keys)}
    last = len(place)
    wanted = place.get(name, last)
    before = [entry for entry in node.entries if place.get(_key_of(entry).value, last) <= wanted]
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
