"""Files and folders of control groups: each write is one call that the kernel takes or refuses whole."""

import errno
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

LOOK_SECONDS = 0.005
"""The pause between two looks at whether something has happened."""


def make_folder(folder: Path) -> None:
    """Make a group; one that is there stays."""
    folder.mkdir(exist_ok=True)


def remove_folder(group: Path, until: float) -> None:
    """Remove a group without processes; one that is gone is fine.

    Args:
        group: its folder.
        until: the time (`time.monotonic`) until which a process that was just ended may hold it.

    Raises:
        TimeoutError: something keeps it.
    """
    while True:
        try:
            group.rmdir()
        except FileNotFoundError:
            return
        except OSError:
            wait(until, f"{group} cannot be removed")
        else:
            return


def wait(until: float, message: str) -> None:
    """Wait for `LOOK_SECONDS`; to be called in a loop.

    Args:
        until: the time (`time.monotonic`) after which there is no more waiting.
        message: of the error then.

    Raises:
        TimeoutError: the time is over, with this message.
    """
    if time.monotonic() > until:
        raise TimeoutError(message)
    time.sleep(LOOK_SECONDS)


def inner_first(group: Path) -> Iterator[Path]:
    """Yield the folders of a group and of those below it, the innermost first; none where the group is not there."""
    with suppress(FileNotFoundError):
        for entry in sorted(group.iterdir()):
            if entry.is_dir():
                yield from inner_first(entry)
        yield group


def entry_of(file: Path, name: str) -> int:
    """Return the number behind a name in a file of `name number` lines; 0 where the name is missing. Raises OSError."""
    return next((int(value) for word, value in (line.split() for line in read(file).splitlines()) if word == name), 0)


def numbers(text: str) -> tuple[int, ...]:
    """Return the processors that the kernel lists as `0-2,5`, ascending."""
    spans = [part.partition("-") for part in text.split(",") if part]
    return tuple(number for first, _, last in spans for number in range(int(first), int(last or first) + 1))


def read(file: Path) -> str:
    """Return the text of a file, without its line end. Raises OSError."""
    with _missing_when_removed(file):
        return file.read_text(encoding="ascii").strip()


def read_if_there(file: Path) -> str:
    """Return the text of a file, without its line end; empty where there is no file. Raises OSError."""
    return read(file) if file.exists() else ""


def write(file: Path, text: str) -> None:
    """Write a file in one call: the kernel takes or refuses the whole value. Raises OSError where it refuses."""
    with _missing_when_removed(file):
        handle = os.open(file, os.O_WRONLY)
        try:
            os.write(handle, text.encode("ascii"))
        finally:
            os.close(handle)


@contextmanager
def _missing_when_removed(file: Path) -> Iterator[None]:
    """Have the kernel's answer for a group that was removed after its file was opened be that for one that is gone."""
    try:
        yield
    except OSError as problem:
        if problem.errno != errno.ENODEV:
            raise
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(file)) from None
