"""A file that a user names -> plain values, with everything that is wrong in its text."""

import os
from dataclasses import replace
from pathlib import Path

from rarms_iac.manifest.text.characters import Source, UnreadableText, check_text, unified
from rarms_iac.manifest.text.events import ParsedText, read_events
from rarms_iac.model.commands import INIT, prose
from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.storage.disk import NotRegular
from rarms_iac.storage.reading import STANDARD_INPUT, TooLarge, read_input
from rarms_iac.texts.findings import NOT_READ
from rarms_iac.texts.messages import reason_of

MAX_BYTES = 8 * 2**20
"""The largest manifest or overlay."""


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
        return ParsedText(
            source=Source(file=file, folder=folder),
            readable=False,
            diagnostics=(_not_readable(file, problem, overlay=overlay),),
            is_missing=isinstance(problem, FileNotFoundError),
        )
    return read_text(data, file, folder, overlay=overlay)


def read_text(data: bytes, file: str, folder: str, *, overlay: bool = False) -> ParsedText:
    """Read bytes that are here already, under the name that messages use."""
    source = Source(file=file, folder=folder, stored=data, text=unified(data).decode("utf-8", "replace"))
    try:
        if not source.text.strip(" \t\n"):
            return ParsedText(
                source=source, readable=False, diagnostics=(_without_value(file, "no content", overlay=overlay),)
            )
        check_text(source)
        parsed = read_events(source)
    except UnreadableText as refused:
        return ParsedText(source=source, readable=False, diagnostics=refused.diagnostics)
    if parsed.readable and parsed.value is None:
        return replace(parsed, readable=False, diagnostics=(_without_value(file, "only comments", overlay=overlay),))
    return parsed


def _without_value(file: str, content: str, *, overlay: bool) -> Diagnostic:
    advice = prose("Write a manifest. Or move the file away and run ", INIT, ".")
    if overlay:
        advice = prose("Write the keys that differ from the manifest, or `{}` if none differs.")
    return NOT_READ.at(
        Place(file=file, line=1, column=1), "The file has {content}.", advice, file=file, content=content
    )


def shown_path(path: str) -> str:
    """Return a file's name for messages, with slashes on every system: equal output, equal bytes."""
    return "<stdin>" if path == STANDARD_INPUT else Path(path).as_posix()


def _not_readable(file: str, problem: OSError | ValueError, *, overlay: bool) -> Diagnostic:
    place = Place(file=file, line=1, column=1)
    match problem:
        case NotRegular(kind=kind):
            return NOT_READ.at(
                place, "{file} is {kind}.", "Name a file, or - for standard input.", file=file, kind=kind
            )
        case TooLarge():
            advice = "Check that the file is the manifest, or move the differences between machines into overlays."
            return NOT_READ.at(
                place,
                "{file} is larger than 8 MiB, the limit for a manifest.",
                advice,
                file=file,
                most_bytes=8 * 2**20,
            )
        case FileNotFoundError():
            missing = prose(
                "Check the path: `-f PATH` names a manifest or its folder. To create a manifest, run ", INIT, "."
            )
            if overlay:
                missing = prose("Check the path. An overlay is a file with the keys that differ from the manifest.")
            return NOT_READ.at(place, "The file {file:quoted} does not exist.", missing, file=file)
        case PermissionError():
            return NOT_READ.at(
                place, "rarms has no permission to read {file:quoted}.", "Check the file's permissions.", file=file
            )
        case OSError():
            reason = reason_of(problem)
            return NOT_READ.at(place, "The system reports: {reason}.", "Check the path.", file=file, reason=reason)
        case _:
            return NOT_READ.at(place, "No file can have this name.", "Check the path.", file=file)
