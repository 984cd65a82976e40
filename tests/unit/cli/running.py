"""Runs the command line in this process and gives back all a user would see."""

import io
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass

from rarms_iac.cli.main import main
from rarms_iac.storage import disk
from tests.crashing import UnflushedDisk


@dataclass(frozen=True, slots=True, kw_only=True)
class Ran:
    """A command's exit code, data and talk."""

    code: int
    out: str
    err: str

    @property
    def lines(self) -> list[str]:
        """The data, line by line."""
        return self.out.splitlines()


class _Typed(io.TextIOWrapper):
    """A terminal, as far as anybody asks."""

    def isatty(self) -> bool:
        return True


def rarms(*words: str, stdin: str = "", at_a_terminal: bool = False, shown_at_a_terminal: bool = False) -> Ran:
    """`rarms` with these words, standard input being this text, which a user types at a terminal, or a file.

    Standard output is a file, unless it is shown at a terminal.
    """
    out, err = _stream(at_a_terminal=shown_at_a_terminal), _stream(at_a_terminal=at_a_terminal)
    used = UnflushedDisk() if type(disk.current()) is disk.FileEffects else disk.current()
    with disk.use(used), redirect_stdout(out), redirect_stderr(err), _reading(stdin, at_a_terminal=at_a_terminal):
        code = main(list(words))
        out.flush()
        err.flush()
    return Ran(code=code, out=_text(out), err=_text(err))


@contextmanager
def _reading(text: str, *, at_a_terminal: bool) -> Iterator[None]:
    made = _Typed if at_a_terminal else io.TextIOWrapper
    before, sys.stdin = sys.stdin, made(io.BytesIO(text.encode()), encoding="utf-8")
    try:
        yield
    finally:
        sys.stdin = before


def _stream(*, at_a_terminal: bool = False) -> io.TextIOWrapper:
    made = _Typed if at_a_terminal else io.TextIOWrapper
    return made(io.BytesIO(), encoding="utf-8", newline="\n")


def _text(stream: io.TextIOWrapper) -> str:
    buffer = stream.buffer
    assert isinstance(buffer, io.BytesIO)
    return buffer.getvalue().decode()
