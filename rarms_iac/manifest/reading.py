"""A file that a user names -> a tree of plain values, with everything that is wrong in its text."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rarms_iac.manifest.characters import as_text
from rarms_iac.manifest.events import read_events
from rarms_iac.manifest.limits import SAME_KEY
from rarms_iac.manifest.nodes import read_nodes
from rarms_iac.manifest.opening import STANDARD_INPUT, Refused, read_bytes, shown
from rarms_iac.manifest.places import ManifestPlaces, dotted
from rarms_iac.manifest.source import Source, source
from rarms_iac.model.diagnostics import Diagnostic, Place, Related


@dataclass(frozen=True, slots=True, kw_only=True)
class Tree:
    """A text and its values; `value` is worth reading only where `readable`."""

    source: Source
    value: Any
    readable: bool  # nothing was refused: the values are what the text says
    diagnostics: tuple[Diagnostic, ...]


def read(path: str, *, overlay: bool = False) -> Tree:
    """Reads a regular file, or standard input for `-`; what is wrong stands in `diagnostics`."""
    folder = os.curdir if path == STANDARD_INPUT else str(Path(path).parent)
    try:
        data = read_bytes(path, overlay=overlay)
    except Refused as refused:
        return Tree(
            source=source(shown(path), folder, b""), value=None, readable=False, diagnostics=refused.diagnostics
        )
    return read_text(data, shown(path), folder)


def read_text(data: bytes, file: str, folder: str) -> Tree:
    """The same of bytes that are here already, under the name that messages use."""
    raw = source(file, folder, data)
    try:
        text = as_text(data, file)
        checked = source(file, folder, text.data)
        found = read_events(text.data, file)
    except Refused as refused:
        return Tree(source=raw, value=None, readable=False, diagnostics=refused.diagnostics)
    same = _same_keys(checked, found.twice)
    return Tree(
        source=checked,
        value=found.value,
        readable=not found.problems,
        diagnostics=(*text.notes, *found.problems, *same),
    )


def _same_keys(text: Source, twice: list[tuple[tuple[str | int, ...], Place]]) -> list[Diagnostic]:
    if not twice:
        return []
    places = ManifestPlaces(lambda: read_nodes(text))
    return [
        SAME_KEY.at(
            Place(file=later.file, line=later.line, column=later.column, path=dotted(path), length=later.length),
            f"{dotted(path)} stands here and on line {places.key(*path).line}.",
            "Remove one of the two.",
            related=(Related(place=places.key(*path), says="the first one"),),
        )
        for path, later in twice
    ]
