"""Opening what a user names: a regular file or standard input, and nothing that could block or be endless."""

import os
import stat
import sys
from pathlib import Path

from rarms_iac.model.diagnostics import Diagnostic, Finding, Place, Severity

MAX_BYTES = 8 * 2**20
"""The largest manifest or overlay (DESIGN section 1, Reading)."""

STANDARD_INPUT = "-"

NOT_READABLE = Finding(code="RARMS001", severity=Severity.ERROR, summary="The file cannot be read")
NOT_REGULAR = Finding(code="RARMS002", severity=Severity.ERROR, summary="Not a regular file")
TOO_LARGE = Finding(code="RARMS003", severity=Severity.ERROR, summary="The file is too large")


class Refused(Exception):
    """Reading stops here, with everything that is to be told."""

    def __init__(self, *diagnostics: Diagnostic) -> None:
        super().__init__(*diagnostics)
        self.diagnostics = diagnostics


def shown(path: str) -> str:
    """How messages name a file: with slashes on every system, so that output is the same bytes everywhere."""
    return "<stdin>" if path == STANDARD_INPUT else Path(path).as_posix()


def read_bytes(path: str, *, overlay: bool = False) -> bytes:
    """The bytes of a regular file, or of standard input for `-`; at most `MAX_BYTES`.

    Of an overlay, other advice is given where there is none.

    Raises:
        Refused: it is missing, not regular, too large, or the system says no.
    """
    if path == STANDARD_INPUT:
        return _within_size(sys.stdin.buffer.read(MAX_BYTES + 1), path)
    try:
        _check_kind(Path(path).stat(), path)
        return _read_regular(path)
    except (OSError, ValueError) as problem:  # ValueError: a NUL in the name
        raise Refused(_not_readable(path, problem, overlay=overlay)) from None


def _read_regular(path: str) -> bytes:
    # Looked at again once it is open: a FIFO may have taken its place, and must not block us.
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    with os.fdopen(handle, "rb") as file:
        _check_kind(os.fstat(file.fileno()), path)
        return _within_size(file.read(MAX_BYTES + 1), path)


def _check_kind(status: os.stat_result, path: str) -> None:
    if not stat.S_ISREG(status.st_mode):
        kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a device, a pipe or a socket"
        raise Refused(
            NOT_REGULAR.at(
                Place(file=shown(path), line=1, column=1),
                f"{shown(path)} is {kind}.",
                "Name a file, or - for standard input.",
            )
        )
    if status.st_size > MAX_BYTES:
        raise Refused(_too_large(path, f"{status.st_size:,} bytes"))


def _within_size(data: bytes, path: str) -> bytes:
    if len(data) > MAX_BYTES:
        raise Refused(_too_large(path, "more"))
    return data


def _too_large(path: str, size: str) -> Diagnostic:
    return TOO_LARGE.at(
        Place(file=shown(path), line=1, column=1),
        f"A manifest has at most 8 MiB; this file has {size}.",
        "Check that it is the manifest, or split what differs between machines into overlays.",
    )


def _not_readable(path: str, problem: OSError | ValueError, *, overlay: bool = False) -> Diagnostic:
    place = Place(file=shown(path), line=1, column=1)
    match problem:
        case FileNotFoundError():
            advice = (
                "Check the path; an overlay is a file of what differs from the manifest."
                if overlay
                else "Check the path, or make a manifest with `rarms init`."
            )
            return NOT_READABLE.at(place, f"There is no file {shown(path)!r}.", advice)
        case PermissionError():
            return NOT_READABLE.at(place, f"The system does not let rarms read {shown(path)!r}.", "Check its rights.")
        case OSError():
            reason = problem.strerror or type(problem).__name__
            return NOT_READABLE.at(place, f"The system says: {reason}.", "Check the path.")
        case _:
            return NOT_READABLE.at(place, "No file can have this name.", "Check the path.")
