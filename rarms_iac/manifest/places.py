"""Where a value or its key stands, after overlays: looked up only when something is to be told."""

import json
import re
from collections.abc import Callable
from functools import cached_property

from rarms_iac.manifest.nodes import Branch, Entry, Items, Node
from rarms_iac.model.diagnostics import Place

_SIMPLE_KEY = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_ -]{0,80}")


def dotted(path: tuple[str | int, ...]) -> str:
    """A path as people write it: `hosts.onboard.memory`, `components.vision.apart[0]`."""
    text = ""
    for step in path:
        if isinstance(step, int):
            text += f"[{step}]"
        else:
            shown = step if _SIMPLE_KEY.fullmatch(step) else json.dumps(step[:80])
            text += f".{shown}" if text else shown
    return text


class ManifestPlaces:
    """`model.diagnostics.Places` over the tree of a manifest and its overlays."""

    def __init__(self, read: Callable[[], Node]) -> None:
        self._read = read

    @cached_property
    def _root(self) -> Node:
        return self._read()

    def value(self, *path: str | int) -> Place:
        """The place of the value at this path; the key of its nearest parent where it does not exist."""
        node, key, steps = self._walk(path)
        place = node.place if steps == len(path) or key is None else key
        return _at(place, path)

    def key(self, *path: str | int) -> Place:
        """The place of the key at this path, or of the item of a list; of its nearest parent's likewise."""
        node, key, _ = self._walk(path)
        return _at(node.place if key is None else key, path)

    def _walk(self, path: tuple[str | int, ...]) -> tuple[Node, Place | None, int]:
        node: Node = self._root
        key: Place | None = None
        for steps, step in enumerate(path):
            child = _child(node, step)
            if child is None:
                return node, key, steps
            node, key = child
        return node, key, len(path)


def _child(node: Node, step: str | int) -> tuple[Node, Place] | None:
    match node, step:
        case Branch(entries=entries), str() if step in entries:
            entry: Entry = entries[step]
            return entry.node, entry.key
        case Items(items=items), int() if 0 <= step < len(items):
            return items[step], items[step].place
        case _:
            return None


def _at(place: Place, path: tuple[str | int, ...]) -> Place:
    return Place(file=place.file, line=place.line, column=place.column, path=dotted(path), length=place.length)


class NoPlaces:
    """Answers for a manifest that could not be read at all: its first line."""

    def __init__(self, file: str) -> None:
        self._file = file

    def value(self, *path: str | int) -> Place:
        """The first line."""
        return Place(file=self._file, line=1, column=1, path=dotted(path))

    def key(self, *path: str | int) -> Place:
        """The first line."""
        return self.value(*path)
