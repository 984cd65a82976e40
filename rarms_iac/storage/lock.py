"""A lock file that dies with its process and names its owner while it is held.

The system's own lock on an open file: `flock`, or on Windows a locked byte far behind the text, since what is locked
there cannot be read. It excludes threads as well as processes. The file stays when the lock is given back: removing it
would let two hold "it" at once.
"""

import getpass
import os
import platform
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from rarms_iac.storage.disk import give_to_owner, open_to_write
from rarms_iac.storage.reading import open_regular

POLL_SECONDS = 0.02
OWNER_BYTES = 4096
_LOCKED_BYTE = 1 << 30  # behind any text


class Locked(Exception):
    """Another process holds the lock."""

    def __init__(self, path: Path, owner: str) -> None:
        super().__init__(f"{path} is held by {owner}")
        self.path = path
        self.owner = owner


@contextmanager
def hold(path: Path, owner: str, timeout_ms: int = 0) -> Iterator[None]:
    """Hold the lock while the context lasts. The folder must exist.

    Args:
        path: of the lock's file, which stays when the lock is gone.
        owner: who holds it, for messages to others.
        timeout_ms: how long to wait for it; 0: not at all.

    Yields:
        Once, with the lock held.

    Raises:
        Locked: another process holds it, after waiting so long.
        OSError: what has the name is no regular file, or the system refuses.
    """
    is_new = not path.exists()
    descriptor = open_to_write(path, os.O_CREAT)
    if is_new:
        give_to_owner(path, path.parent.stat())
    try:
        _wait(descriptor, path, timeout_ms)
        try:
            _write(descriptor, owner)
            yield
        finally:
            _write(descriptor, "")
            _unlock(descriptor)
    finally:
        os.close(descriptor)


def read_owner(path: Path) -> str:
    """Who holds the lock, or held it when it was killed; empty where it is not known.

    Args:
        path: of the lock's file.

    Returns:
        The words that `hold` was given; whether the lock is held now is not looked at.
    """
    try:
        with open_regular(path) as file:
            return file.read(OWNER_BYTES).decode("utf-8", "replace").strip()
    except OSError:
        return ""


def read_holder(path: Path) -> str:
    """Who holds the lock now. The lock is not waited for; it is tried where a killed process may have left its name.

    Args:
        path: of the lock's file, which need not be there.

    Returns:
        The words that `hold` was given; empty: no process holds it, or this user may not read it.
    """
    owner = read_owner(path)
    if not owner:
        return ""
    try:
        with open_regular(path) as file:
            if not _try_lock(file.fileno(), shared=True):
                return owner
            _unlock(file.fileno())
    except OSError:
        pass
    return ""


def _wait(descriptor: int, path: Path, timeout_ms: int) -> None:
    until = time.monotonic() + timeout_ms / 1000
    while not _try_lock(descriptor):
        if time.monotonic() >= until:
            raise Locked(path, _owner_of_a_held_lock(path))
        time.sleep(POLL_SECONDS)


def _owner_of_a_held_lock(path: Path) -> str:
    """Who holds a lock; the name is written right after the lock is taken: give it a moment."""
    for _ in range(5):
        if owner := read_owner(path):
            return owner
        time.sleep(POLL_SECONDS)
    return "another process"


def _write(descriptor: int, owner: str) -> None:
    text = owner.encode("utf-8", "replace")[: OWNER_BYTES - 1]
    os.ftruncate(descriptor, 0)
    os.lseek(descriptor, 0, os.SEEK_SET)
    if text:
        os.write(descriptor, text + b"\n")


if sys.platform == "win32":
    import msvcrt

    def _try_lock(descriptor: int, *, shared: bool = False) -> bool:  # noqa: ARG001 - Windows has none that is shared
        os.lseek(descriptor, _LOCKED_BYTE, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True

    def _unlock(descriptor: int) -> None:
        os.lseek(descriptor, _LOCKED_BYTE, os.SEEK_SET)
        msvcrt.locking(descriptor, msvcrt.LK_UNLCK, 1)

else:
    import fcntl

    def _try_lock(descriptor: int, *, shared: bool = False) -> bool:
        try:
            fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def _unlock(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_UN)


_acting_for: ContextVar[str] = ContextVar("_acting_for", default="")


def owner() -> str:
    """Name this run for people who find a host held.

    Returns:
        `user@computer, process 123`, of the computer that asked for it; stand-ins where the system does not know the
        user or the computer.
    """
    if by := _acting_for.get():
        return by
    try:
        user = getpass.getuser()
    except (OSError, KeyError, ImportError):
        user = "an unknown user"
    return f"{user}@{platform.node() or 'this computer'}, process {os.getpid()}"


def act_for(by: str) -> None:
    """Have `owner` answer with the run on another computer that asked this one.

    Args:
        by: what `owner` returned there.
    """
    _acting_for.set(by)
