"""Runs the command line in this process and gives back all a user would see."""

import io
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass

from rarms_iac.cli.main import main


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


def rarms(*words: str, stdin: str = "") -> Ran:
    """`rarms` with these words, standard input being this text."""
    out, err = _stream(), _stream()
    with redirect_stdout(out), redirect_stderr(err), _reading(stdin):
        code = main(list(words))
        out.flush()
        err.flush()
    return Ran(code=code, out=_text(out), err=_text(err))


@contextmanager
def _reading(text: str) -> Iterator[None]:
    before, sys.stdin = sys.stdin, io.TextIOWrapper(io.BytesIO(text.encode()), encoding="utf-8")
    try:
        yield
    finally:
        sys.stdin = before


def _stream() -> io.TextIOWrapper:
    return io.TextIOWrapper(io.BytesIO(), encoding="utf-8", newline="\n")


def _text(stream: io.TextIOWrapper) -> str:
    buffer = stream.buffer
    assert isinstance(buffer, io.BytesIO)
    return buffer.getvalue().decode()
