"""Overlays: maps merge, everything else replaces, `null` removes (DESIGN section 1).

Trees with positions are merged, so that every value remembers the file that said it. Paths are rewritten to be
relative to the manifest's folder, since the file that says them may lie elsewhere.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from rarms_iac.manifest.nodes import Branch, Entry, Items, Leaf, Node, plain, read_nodes
from rarms_iac.manifest.places import ManifestPlaces
from rarms_iac.manifest.reading import Tree
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity

NOT_A_MAP = Finding(code="RARMS013", severity=Severity.ERROR, summary="An overlay that is not a map")

_WHOLE = (
    ("components", "*", "apt", "*"),
    ("components", "*", "run", "samples"),
    ("components", "*", "run", "until"),
)
"""Maps that one overlay replaces as a whole: their keys only make sense together."""

_PATHS = (
    ("components", "*", "run", "folder"),
    ("components", "*", "run", "files", "*"),
)
_COMMANDS = (
    ("components", "*", "run", "command", "*"),
    ("interference", "*", "command", "*"),
)

Path_ = tuple[str | int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Combined:
    """The values after all overlays, and where each stands."""

    value: Any
    places: Places
    diagnostics: tuple[Diagnostic, ...]


def combine(trees: Sequence[Tree]) -> Combined:
    """A manifest and its overlays as one; later overlays win."""
    manifest, *overlays = trees
    if not overlays:
        return Combined(
            value=manifest.value, places=ManifestPlaces(lambda: read_nodes(manifest.source)), diagnostics=()
        )
    merged = read_nodes(manifest.source)
    wrong = []
    for overlay in overlays:
        node = read_nodes(overlay.source)
        if isinstance(node, Branch) and isinstance(merged, Branch):
            merged = _merged(merged, _relative(node, overlay.source.folder, manifest.source.folder, ()), ())
        elif not isinstance(node, Branch):
            advice = "Write the keys that differ, as in the manifest."
            wrong.append(NOT_A_MAP.at(node.place, "An overlay is a map, as the manifest itself.", advice))
    whole = merged
    return Combined(value=plain(whole), places=ManifestPlaces(lambda: whole), diagnostics=tuple(wrong))


def _merged(below: Branch, above: Branch, path: Path_) -> Branch:
    entries = dict(below.entries)
    for key, entry in above.entries.items():
        at = (*path, key)
        old = entries.get(key)
        if _is_null(entry.node):
            entries.pop(key, None)
        elif old and isinstance(old.node, Branch) and isinstance(entry.node, Branch) and not _fits(at, _WHOLE):
            entries[key] = Entry(old.key, _merged(old.node, entry.node, at))
        elif isinstance(entry.node, Branch) and not _fits(at, _WHOLE):
            entries[key] = Entry(entry.key, _merged(replace(entry.node, entries={}), entry.node, at))
        else:
            entries[key] = entry
    return replace(below, entries=entries)


def _is_null(node: Node) -> bool:
    return isinstance(node, Leaf) and node.value is None


def _fits(path: Path_, patterns: tuple[tuple[str, ...], ...]) -> bool:
    return any(
        len(pattern) == len(path) and all(want in ("*", step) for want, step in zip(pattern, path, strict=True))
        for pattern in patterns
    )


def _relative(node: Node, said_in: str, to: str, path: Path_) -> Any:
    """The same tree with its paths relative to another folder."""
    match node:
        case Branch(entries=entries):
            return replace(
                node,
                entries={
                    key: replace(entry, node=_relative(entry.node, said_in, to, (*path, key)))
                    for key, entry in entries.items()
                },
            )
        case Items(items=items):
            return replace(
                node, items=tuple(_relative(item, said_in, to, (*path, at)) for at, item in enumerate(items))
            )
        case Leaf(value=str(text)) if _fits(path, _PATHS) or (_fits(path, _COMMANDS) and _names_a_file(text, said_in)):
            return replace(node, value=moved_path(text, said_in, to))
        case _:
            return node


def _names_a_file(word: str, folder: str) -> bool:
    """Whether a word of a command means a file beside the one that says it, and not an option or a program."""
    if word.startswith(("./", "../")):
        return True
    try:
        return bool(word) and not word.startswith("-") and (Path(folder) / word).exists()
    except (OSError, ValueError):  # too long, or with a character that no file's name has
        return False


def moved_path(text: str, said_in: str, to: str) -> str:
    """A path relative to one folder, as seen from another; an absolute one stays."""
    if PurePosixPath(text).is_absolute() or PureWindowsPath(text).is_absolute():
        return text
    try:
        folder = os.path.relpath(said_in or os.curdir, to or os.curdir)
    except ValueError:  # on Windows: another drive
        folder = str(Path(said_in).resolve())
    if folder == os.curdir:
        return text
    return PurePosixPath(Path(folder).as_posix(), text).as_posix()
