"""Standard output and standard error: data goes to one, talk to the other, and neither ever breaks a command."""

import contextlib
import errno
import io
import os
import shutil
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, TextIO

from rarms_iac.model.commands import Prose, Wording
from rarms_iac.views.console import plain_text, spell_out_hidden, visible

if TYPE_CHECKING:
    from rich.console import RenderableType

    from rarms_iac.views.table import LiveLine


NARROWEST = 40
WIDEST = 120
"""Longer lines are harder to read, however wide the terminal is."""
DEFAULT_WIDTH = 80


@dataclass(slots=True)
class Terminal:
    """The output of a command. A reader who has seen enough (`rarms plan | head`) is not an error."""

    out: TextIO
    err: TextIO
    colour: bool = False  # on standard output
    talk_colour: bool = False  # on standard error
    lively: bool = False  # standard error is a terminal: lines may be written over
    answers: bool = False  # a user can be asked
    width: int = DEFAULT_WIDTH
    piped: bool = False  # standard output is not a terminal: a script goes there as it is
    wrapped: bool = True  # standard output has a width; without one its lines stay whole, however long
    talk_wrapped: bool = True  # the same of standard error
    debug: bool = False
    answered: bool = False  # data was written
    out_closed: bool = False  # the process was started without a standard output
    manifest_options: str = ""  # ` -f cell`, as they were given: recommended commands repeat them
    _live_line: "LiveLine | None" = None

    @property
    def ascii_only(self) -> bool:
        """Whether lines and dots beyond ASCII would be escapes on standard output."""
        try:
            "\u2812\u2500\u25cf\u2591".encode(self.out.encoding or "utf-8")
        except (LookupError, UnicodeEncodeError):
            return True
        return False

    # Text leaves through `data`, `show`, `talk` or `status`, which let none act on a terminal, or through `exactly`.

    def data(self, text: str, *, is_coloured: bool = False) -> None:
        """Write what was asked for, in a form of its own; characters that a reader would not see are spelled out.

        Args:
            text: JSON, SARIF and the like, which have such characters escaped; or text of our own.
            is_coloured: it is harmless text with escape sequences for colours.

        Raises:
            OSError: standard output is closed, or the system refuses.
        """
        self.require_output()
        self.answered = True
        self._write(text, is_coloured=is_coloured)

    def require_output(self) -> None:
        """Refuse where data would be lost: a program that asked for it must not take silence and a 0 for an answer.

        Raises:
            OSError: the process was started without a standard output (`>&-`).
        """
        if self.out_closed:
            self.answered = True  # nothing further can be
            raise OSError(errno.EBADF, "Standard output is closed, so the result cannot be written")

    def _write(self, text: str, *, is_coloured: bool) -> None:
        self.out = write_text(self.out, text if is_coloured else spell_out_hidden(text))

    def data_now(self, text: str) -> None:
        """Write a part of what was asked for, to be read before the rest is there."""
        self.data(text)
        self.out = flush_stream(self.out)

    def exactly(self, text: str) -> None:
        """Write a script: ASCII text with its own line ends, also where the system would change them."""
        self.require_output()
        self.out = flush_stream(self.out)
        if isinstance(self.out, io.TextIOWrapper):
            try:
                self.out.buffer.write(text.encode("ascii"))
            except OSError as error:
                self.out = discard_rest(self.out, error)
        else:
            self.data(text)

    def show(self, content: "RenderableType") -> None:
        """Write what a person asked for, laid out for standard output."""
        self.answered = True
        self._write(self._render(content, wrapped=self.wrapped, colour=self.colour), is_coloured=self.colour)

    def talk(self, content: "RenderableType | Wording") -> None:
        """Write what is said above it, with a line end; text in its lines, anything else laid out by rich."""
        self.out = flush_stream(self.out)
        if isinstance(content, str | Prose):
            text = visible(plain_text(content, self.manifest_options)) + "\n"
        else:
            text = self._render(content, wrapped=self.talk_wrapped, colour=self.talk_colour)
        self.err = write_text(self.err, text)

    def _render(self, content: "RenderableType", *, wrapped: bool, colour: bool) -> str:
        from rarms_iac.views.console import UNLIMITED, render

        return render(content, self.width if wrapped else UNLIMITED, colour=colour, manifest=self.manifest_options)

    def tell(self, text: Wording) -> None:
        """Write sentences next to it, wrapped between words, and show them now; what begins with blanks is an item.

        NOTE: without rich, whose import a command with `--json` would wait for.
        """
        text = plain_text(text, self.manifest_options)
        if self.talk_wrapped:
            indent = len(text) - len(text.lstrip(" "))
            further = " " * (indent + 2) if indent else ""
            text = fill(text, self.width, subsequent_indent=further, break_long_words=False, break_on_hyphens=False)
        self.talk(text)
        self.err = flush_stream(self.err)

    def live_line(self) -> "LiveLine | None":
        """Return the command's one table that is updated in place; None where standard error is not a terminal."""
        if self.lively and self._live_line is None:
            from rarms_iac.views.console import live_console
            from rarms_iac.views.table import LiveLine

            self._live_line = LiveLine(live_console(self.err, self.width, colour=self.talk_colour))
        return self._live_line

    def status(self, text: str) -> None:
        """Write a piece of progress as it is, and show it now."""
        self.err = flush_stream(write_text(self.err, visible(text)))

    def flush(self) -> None:
        """Push everything out; the last chance to hear that a disk is full."""
        self.out = flush_stream(self.out)
        self.err = flush_stream(self.err)

    def without_colour(self) -> None:
        """Write plain text, as `--no-color` asks."""
        self.colour = self.talk_colour = False


def this_terminal(environment: Mapping[str, str] = os.environ) -> Terminal:
    """Return the process' own streams, made safe for any text."""
    out, err = make_safe(sys.stdout or no_stream()), make_safe(sys.stderr or no_stream())
    may_colour = not environment.get("NO_COLOR") and environment.get("TERM") != "dumb"
    return Terminal(
        out=out,
        err=err,
        colour=may_colour and out.isatty(),
        talk_colour=may_colour and err.isatty(),
        lively=err.isatty() and environment.get("TERM") != "dumb",
        answers=sys.stdin is not None and sys.stdin.isatty() and err.isatty(),
        width=width_of(out, environment),
        piped=not out.isatty(),
        wrapped=_has_width(out, environment),
        talk_wrapped=_has_width(err, environment),
        out_closed=sys.stdout is None and os.name != "nt",  # a Windows program without a console has none
    )


def width_of(out: TextIO, environment: Mapping[str, str]) -> int:
    """Return the columns of a terminal or of `COLUMNS`, within limits; 80 elsewhere."""
    if not _has_width(out, environment):
        return DEFAULT_WIDTH
    return max(NARROWEST, min(shutil.get_terminal_size((DEFAULT_WIDTH, 24)).columns, WIDEST))


def _has_width(stream: TextIO, environment: Mapping[str, str]) -> bool:
    return stream.isatty() or environment.get("COLUMNS", "").isdecimal()


def no_stream() -> TextIO:
    """Return a stream for a process that was started without one (`>&-`): what people would read there is lost."""
    return Path(os.devnull).open("w", encoding="utf-8")


def make_safe(stream: TextIO) -> TextIO:
    """Return the stream, never raising over a character: what it cannot show is written as an escape, lines end in LF.

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
    """Return whether the reader went away; Windows says EINVAL for it."""
    return isinstance(error, BrokenPipeError) or (os.name == "nt" and error.errno == 22)
