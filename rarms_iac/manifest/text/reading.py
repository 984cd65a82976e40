"""A file that a user names -> plain values, with everything that is wrong in its text."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, overload

from rarms_iac.manifest.text.characters import UnreadableText, check_text
from rarms_iac.manifest.text.events import DuplicateKey, read_events
from rarms_iac.manifest.text.positions import ManifestPlaces, dotted
from rarms_iac.manifest.text.tree import Node, build_positions
from rarms_iac.model.commands import INIT, prose
from rarms_iac.model.diagnostics import Diagnostic, Place, Related
from rarms_iac.model.shared_findings import NOT_READ, NOT_YAML
from rarms_iac.model.wording import reason_of
from rarms_iac.storage.disk import NotRegular
from rarms_iac.storage.reading import STANDARD_INPUT, TooLarge, read_input

MAX_BYTES = 8 * 2**20
"""The largest manifest or overlay."""


class Lines(Sequence[str]):
    """The lines of a text without their ends; one that is shown is found by counting, however many there are."""

    def __init__(self, data: bytes) -> None:
        self._given = data
        self._data: bytes | None = None  # the same with LF alone, made when a line is asked for

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> list[str]: ...
    def __getitem__(self, index: int | slice) -> str | list[str]:
        """Return the line at this index, counted from 0; IndexError past the end."""
        if isinstance(index, slice):
            return [self[at] for at in range(*index.indices(len(self)))]
        number = index + len(self) if index < 0 else index
        if not 0 <= number < len(self):
            raise IndexError(index)
        data, start = self._with_lf(), self._start_of(number)
        end = data.find(b"\n", start)
        return data[start : None if end < 0 else end].decode("utf-8", errors="replace")

    def __len__(self) -> int:
        """How many lines there are."""
        return self._with_lf().count(b"\n") + 1

    def _start_of(self, number: int) -> int:
        """Where a line begins: behind the end of the one before it."""
        data, least, most = self._with_lf(), 0, len(self._with_lf())
        counted = 0  # line ends before `least`
        while least < most:
            middle = (least + most) // 2
            ends = counted + data.count(b"\n", least, middle)
            if ends < number:
                counted, least = ends + (data[middle : middle + 1] == b"\n"), middle + 1
            else:
                most = middle
        return least

    def _with_lf(self) -> bytes:
        if self._data is None:
            self._data = self._given.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        return self._data


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """A file as it was read: UTF-8 without a byte order mark."""

    file: str  # as messages name it: with slashes, `<stdin>` for standard input
    folder: str  # what its paths are relative to
    data: bytes
    lines: Lines = field(compare=False)

    def positions(self) -> Node:
        """Return the tree of a text that was read without problems; it is built at each call."""
        return build_positions(self.data.decode(), self.file)


@dataclass(frozen=True, slots=True, kw_only=True)
class ParsedText:
    """A text and its values; `value` is worth reading only where `readable`."""

    source: Source
    value: Any
    readable: bool  # nothing was refused: the values are what the text says
    diagnostics: tuple[Diagnostic, ...]
    is_missing: bool = False  # there is no such file


def read_yaml(path: str, *, overlay: bool = False) -> ParsedText:
    """Read a manifest or overlay; what is wrong stands in `diagnostics`.

    Args:
        path: a regular file of at most `MAX_BYTES`, or `-` for standard input.
        overlay: whether it is an overlay, for which the advice is another where it is missing.
    """
    file = shown_path(path)
    folder = os.curdir if path == STANDARD_INPUT else str(Path(path).parent)
    try:
        data = read_input(path, MAX_BYTES)
    except (OSError, ValueError) as problem:  # ValueError: a NUL in the name
        diagnostic = _not_readable(file, problem, overlay=overlay)
        return ParsedText(
            source=_source(file, folder, b""),
            value=None,
            readable=False,
            diagnostics=(diagnostic,),
            is_missing=isinstance(problem, FileNotFoundError),
        )
    return read_text(data, file, folder)


def read_text(data: bytes, file: str, folder: str) -> ParsedText:
    """Read bytes that are here already, under the name that messages use."""
    try:
        text, notes = check_text(data, file)
        values = read_events(text, file)
    except UnreadableText as refused:
        source = _source(file, folder, data)
        return ParsedText(source=source, value=None, readable=False, diagnostics=refused.diagnostics)
    same = _same_keys(text, file, values.duplicates)
    return ParsedText(
        source=_source(file, folder, text),
        value=values.value,
        readable=not values.problems,
        diagnostics=(*notes, *values.problems, *same),
    )


def shown_path(path: str) -> str:
    """How messages name a file: with slashes on every system, so that output is the same bytes everywhere."""
    return "<stdin>" if path == STANDARD_INPUT else Path(path).as_posix()


def _source(file: str, folder: str, data: bytes) -> Source:
    return Source(file=file, folder=folder, data=data, lines=Lines(data))


def _not_readable(file: str, problem: OSError | ValueError, *, overlay: bool) -> Diagnostic:
    place = Place(file=file, line=1, column=1)
    match problem:
        case NotRegular(kind=kind):
            return NOT_READ.at(
                place, "{file} is {kind}.", "Name a file, or - for standard input.", file=file, kind=kind
            )
        case TooLarge():
            advice = "Check that it is the manifest, or move what differs between machines into overlays."
            return NOT_READ.at(
                place,
                "{file} has more than 8 MiB, the largest size of a manifest.",
                advice,
                file=file,
                most_bytes=8 * 2**20,
            )
        case FileNotFoundError():
            missing = prose("Check the path: `-f PATH` names a manifest or its folder, and ", INIT, " creates one.")
            if overlay:
                missing = prose("Check the path. An overlay is a file with the keys that differ from the manifest.")
            return NOT_READ.at(place, "There is no file {file:quoted}.", missing, file=file)
        case PermissionError():
            return NOT_READ.at(
                place, "rarms has no permission to read {file:quoted}.", "Check the file's permissions.", file=file
            )
        case OSError():
            reason = reason_of(problem)
            return NOT_READ.at(place, "The system reports: {reason}.", "Check the path.", file=file, reason=reason)
        case _:
            return NOT_READ.at(place, "No file can have this name.", "Check the path.", file=file)


def _same_keys(text: bytes, file: str, duplicates: Sequence[DuplicateKey]) -> list[Diagnostic]:
    if not duplicates:
        return []
    places = ManifestPlaces(lambda: build_positions(text.decode(), file))
    return [
        NOT_YAML.at(
            Place(file=later.file, line=later.line, column=later.column, path=dotted(path), length=later.length),
            "{path} is here and on line {first_line}.",
            "Remove one of the two.",
            related=(Related(place=places.key(*path), message="the first one"),),
            path=dotted(path),
            first_line=places.key(*path).line,
        )
        for path, later in duplicates
    ]
