"""Streams that never break a command: what they cannot show is an escape, and a reader who went away is no error."""

import contextlib
import io
import os
from pathlib import Path
from typing import TextIO


def no_stream() -> TextIO:
    """A stream for a process that was started without one (`>&-`): what is written there reaches nobody."""
    return Path(os.devnull).open("w", encoding="utf-8")


def make_safe(stream: TextIO) -> TextIO:
    """The stream, never raising over a character: what it cannot show is written as an escape, lines end in LF.

    A pipe or a file gets UTF-8, unless `PYTHONIOENCODING` or the locale asks for ASCII; a terminal what it speaks.
    """
    if isinstance(stream, io.TextIOWrapper):
        encoding = stream.encoding
        if not stream.isatty() and encoding.lower().startswith(("cp", "utf-16")):
            encoding = "utf-8"  # a Windows code page would lose text that a program reads
        with contextlib.suppress(io.UnsupportedOperation, ValueError):
            stream.reconfigure(encoding=encoding, errors="backslashreplace", newline="\n")
    return stream


def write_text(stream: TextIO, text: str) -> TextIO:
    """Write the text; the stream that takes what comes next.

    Raises:
        OSError: the system refuses, and not because the reader went away.
    """
    try:
        stream.write(text)
    except OSError as error:
        return discard_rest(stream, error)
    return stream


def flush_stream(stream: TextIO) -> TextIO:
    """Push out what was written; the stream that takes what comes next.

    Raises:
        OSError: as `write_text`.
    """
    try:
        stream.flush()
    except OSError as error:
        return discard_rest(stream, error)
    return stream


def discard_rest(stream: TextIO, error: OSError) -> TextIO:
    """Send the rest nowhere; after a broken pipe in silence, so that the command ends with its own exit code."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    with contextlib.suppress(OSError, ValueError):
        os.dup2(nowhere, stream.fileno())  # what Python flushes when it exits goes nowhere too
    os.close(nowhere)
    if not is_broken_pipe(error):
        raise error
    return stream


def is_broken_pipe(error: OSError) -> bool:
    """Whether the reader went away; Windows says EINVAL for it."""
    return isinstance(error, BrokenPipeError) or (os.name == "nt" and error.errno == 22)
