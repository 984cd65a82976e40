"""Overlays: maps merge, everything else replaces, `null` removes.

Trees with positions are merged, so that every value remembers its file. Paths are rewritten to be
relative to the manifest's folder, because the overlay may be in another folder.
"""

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, TypeGuard

from rarms_iac.manifest.text.events import ParsedText
from rarms_iac.manifest.text.tree import (
    Collection,
    Entry,
    ManifestPlaces,
    Node,
    entries_by_key,
    is_null,
    place_of_node,
    plain,
)
from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.texts.findings import WRONG_VALUE, Finding
from rarms_iac.texts.messages import Suggestions

UNKNOWN_NAME = Finding.warning("RARMS400", "A name in an overlay is not in the manifest")

_NAMED = {"components": "component", "hosts": "host", "partitions": "partition"}
"""Sections whose names an overlay repeats, and what they name."""
NEW = "new"
"""The key of a component, host or partition that only the overlay has."""

REPLACED_WHOLE = (
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

YamlPath = tuple[str | int, ...]


def combine(texts: Sequence[ParsedText]) -> tuple[Any, Places, list[Diagnostic]]:
    """Return the values after all overlays, of which the later win, their places, and what is wrong with overlays."""
    manifest, *overlays = texts
    if not overlays:
        return manifest.value, ManifestPlaces(lambda: manifest.tree().root), []
    merged = manifest.tree().root
    wrong: list[Diagnostic] = []
    suggestions = Suggestions()
    for overlay in overlays:
        node = overlay.tree().root
        if not _is_mapping(node):
            advice = "Write the keys that differ from the manifest, with the same structure."
            wrong.append(
                WRONG_VALUE.at(
                    place_of_node(node), "An overlay is a map, like the manifest.", advice, file=overlay.source.file
                )
            )
        elif _is_mapping(merged):
            wrong += _unknown_names(merged, node, suggestions)
            merged = _merged(merged, _relative(node, overlay.source.folder, manifest.source.folder, ()), ())
    whole = merged
    return plain(whole), ManifestPlaces(lambda: whole), wrong


def _is_mapping(node: Node) -> TypeGuard[Collection]:
    return isinstance(node, Collection) and node.is_mapping


def _unknown_names(below: Collection, overlay: Collection, suggestions: Suggestions) -> Iterator[Diagnostic]:
    """Find the names that an overlay adds or removes, and that nothing below it has.

    A component has a partition of its name, also if `partitions` does not list it.
    """
    for section, kind in _NAMED.items():
        known = _entries_of(below, section)
        if section == "partitions":
            known |= _entries_of(below, "components") | _entries_of(overlay, "components")
        for name, entry in _entries_of(overlay, section).items():
            if name not in known and not _says_new(entry):
                yield _unknown_name(entry, kind, tuple(known), suggestions)


def _entries_of(document: Collection, section: str) -> dict[str, Entry]:
    entry = entries_by_key(document).get(section)
    return entries_by_key(entry.value) if entry is not None and _is_mapping(entry.value) else {}


def _says_new(entry: Entry) -> bool:
    said = entries_by_key(entry.value).get(NEW) if _is_mapping(entry.value) else None
    return said is not None and plain(said.value) is True


def _unknown_name(entry: Entry, kind: str, known: Sequence[str], suggestions: Suggestions) -> Diagnostic:
    assert entry.key is not None, "entries of a mapping have keys"
    name, removes = entry.key.text, is_null(entry.value)
    similar, suggestion = suggestions.find(name, known)
    does = "removes" if removes else "adds"
    advice = f"Correct the name. If the {kind} is new, add `new: true`."
    if removes:
        advice = "Correct the name, or delete the line."
    facts: dict[str, Any] = {kind: name, "similar": similar, "removes": removes, "_suggestion": suggestion}
    return UNKNOWN_NAME.at(
        place_of_node(entry.key),
        f"The overlay {does} the {kind} {{{kind}:quoted}}, which is not in the manifest.{{_suggestion}}",
        advice,
        address=f"{kind}/{name}",
        **facts,
    )


def _merged(below: Collection, above: Collection, path: YamlPath) -> Collection:
    entries = entries_by_key(below)
    for key, entry in entries_by_key(above).items():
        at = (*path, key)
        old = entries.get(key)
        if is_null(entry.value):
            entries.pop(key, None)
        elif not _is_mapping(entry.value) or fits(at, REPLACED_WHOLE):
            entries[key] = entry
        elif old and _is_mapping(old.value):
            entries[key] = replace(old, value=_merged(old.value, entry.value, at))
        else:
            entries[key] = replace(entry, value=_merged(replace(entry.value, entries=[]), entry.value, at))
    return replace(below, entries=list(entries.values()))


def fits(path: YamlPath, patterns: tuple[tuple[str, ...], ...]) -> bool:
    """Return whether a path matches one of the patterns; `*` stands for any step."""
    return any(
        len(pattern) == len(path) and all(want in ("*", step) for want, step in zip(pattern, path, strict=True))
        for pattern in patterns
    )


def _relative(node: Any, written_in: str, to: str, path: YamlPath) -> Any:
    """Return a tree with its paths relative to another folder."""
    if isinstance(node, Collection):
        entries = [
            replace(entry, value=_relative(entry.value, written_in, to, (*path, entry.key.text if entry.key else at)))
            for at, entry in enumerate(node.entries)
        ]
        return replace(node, entries=entries)
    is_path = fits(path, _PATHS) or (fits(path, _COMMANDS) and _names_a_file(node.text, written_in))
    if is_path and isinstance(node.value, str):
        moved = moved_path(node.value, written_in, to)
        return replace(node, text=moved, value=moved, style="'")
    return node


def _names_a_file(word: str, folder: str) -> bool:
    """Return whether a word of a command names a file in this folder, and no option or program."""
    if word.startswith(("./", "../")):
        return True
    try:
        return bool(word) and not word.startswith("-") and (Path(folder) / word).exists()
    except (OSError, ValueError):  # too long, or with a character that no file's name has
        return False


def moved_path(text: str, written_in: str, to: str) -> str:
    """Return a path relative to one folder, as seen from another; an absolute one stays."""
    if PurePosixPath(text).is_absolute() or PureWindowsPath(text).is_absolute():
        return text
    try:
        folder = os.path.relpath(written_in or os.curdir, to or os.curdir)
    except ValueError:  # on Windows: another drive
        folder = str(Path(written_in).resolve())
    if folder == os.curdir:
        return text
    return PurePosixPath(Path(folder).as_posix(), text).as_posix()
