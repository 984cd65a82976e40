"""Where a value or its key stands, after overlays: looked up only when there is something to report."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache

from rarms_iac.manifest.text.tree import Collection, Entry, Node, Scalar, entries_by_key, place_of_node
from rarms_iac.model.diagnostics import Place

_SIMPLE_KEY = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_ -]{0,80}")


def dotted(path: tuple[str | int, ...]) -> str:
    """Return a path as people write it: `hosts.onboard.memory`, `components.vision.apart[0]`."""
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
        self._root = cache(read)
        self._entries: dict[int, dict[str, Entry]] = {}  # of each mapping that was asked for, by its identity

    def value(self, *path: str | int) -> Place:
        """Return the place of the value at this path; the key of its nearest parent where it does not exist."""
        node, key, steps = self._walk(path)
        return _at(node if steps == len(path) or key is None else key, path)

    def key(self, *path: str | int) -> Place:
        """Return the place of the key at this path, or of the item of a list; of its nearest parent's likewise."""
        node, key, _ = self._walk(path)
        return _at(node if key is None else key, path)

    def text(self, *path: str | int) -> str:
        """Return the text of the scalar without quotes at this path: `3.10`, of which the value is 3.1."""
        node, _, steps = self._walk(path)
        return node.value if steps == len(path) and isinstance(node, Scalar) and not node.style else ""

    def _walk(self, path: tuple[str | int, ...]) -> tuple[Node, Node | None, int]:
        """How far the path leads: the last node, its key (of a list: the item), and the steps that are there."""
        node = self._root()
        key: Node | None = None
        for steps, step in enumerate(path):
            entry = self._entry(node, step)
            if entry is None:
                return node, key, steps
            node, key = entry.value, entry.key or entry.value
        return node, key, len(path)

    def _entry(self, node: Node, step: str | int) -> Entry | None:
        match node, step:
            case Collection(is_mapping=True), str():
                if id(node) not in self._entries:
                    self._entries[id(node)] = entries_by_key(node)
                return self._entries[id(node)].get(step)
            case Collection(is_mapping=False, entries=entries), int() if 0 <= step < len(entries):
                return entries[step]
            case _:
                return None


def _at(node: Node, path: tuple[str | int, ...]) -> Place:
    return replace(place_of_node(node), path=dotted(path))


class FirstLine:
    """Answers for a manifest that could not be read at all: its first line."""

    def __init__(self, file: str) -> None:
        self._file = file

    def value(self, *path: str | int) -> Place:
        """Return the first line."""
        return Place(file=self._file, line=1, column=1, path=dotted(path))

    def key(self, *path: str | int) -> Place:
        """Return the first line."""
        return self.value(*path)

    def text(self, *path: str | int) -> str:
        """Nothing was read."""
        del path
        return ""
