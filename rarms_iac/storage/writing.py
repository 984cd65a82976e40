"""The lock and the two writers: a whole file at once, and records that are added to a journal or log.

`replace` is for state, plans and snapshots, `append` for journals, `append_lines` for logs. `hold` is the lock: a file
that dies with its process and names its owner while it is held. It is the system's own lock on an open file: `flock`,
or on Windows a locked byte far behind the text, since what is locked there cannot be read. It excludes threads as well
as processes. The lock's file stays when the lock is given back: removing it would let two hold "it" at once.
"""

import getpass
import os
import platform
import stat
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from glob import escape
from pathlib import Path

from rarms_iac.storage import disk
from rarms_iac.storage.disk import give_to_owner, open_to_write
from rarms_iac.storage.reading import open_regular
from rarms_iac.storage.records import Record, open_log, sealed_line, size_of_sound_lines

POLL_SECONDS = 0.02
OWNER_BYTES = 4096
_LOCKED_BYTE = 1 << 30  # behind any text


class Locked(Exception):
    """Another process holds the lock."""

    def __init__(self, path: Path, owner: str) -> None:
        super().__init__(f"{path} is locked by {owner}")
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
        OSError: what has the name is not a regular file, or the system refuses.
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
    """Return the holder of the lock, or the one that was killed with it; empty if unknown.

    Returns:
        The words that `hold` was given; whether the lock is held now is not looked at.
    """
    try:
        with open_regular(path) as file:
            return file.read(OWNER_BYTES).decode("utf-8", "replace").strip()
    except OSError:
        return ""


def read_holder(path: Path) -> str:
    """Return the present holder of the lock, without waiting; try it if a killed process may have left its name.

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
    """Wait a moment for the holder's name, which is written right after the lock is taken."""
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
    """Have `owner` answer with the run on another computer that asked this one."""
    _acting_for.set(by)


def replace(path: Path, data: bytes, like: os.stat_result | None = None) -> None:
    """Make the file exactly these bytes, durably: a reader, now or after a crash, sees the old or the new ones whole.

    The file's folder must exist. What root makes belongs to the owner of the folder, so that a checkout stays its
    user's.

    Args:
        like: whose owner and rights the file is to have; None: those of a new file.

    Raises:
        NotRegular: the name is that of a link, a folder, a pipe or a device.
        OSError: it cannot be written; the old content is still there.
    """
    disk.check_target(path)
    effects = disk.current()
    temporary = path.with_name(f".{path.name}.{os.getpid()}-{threading.get_ident()}.new")
    try:
        effects.write(temporary, data)
        if like is not None:
            disk.give_to_owner(temporary, like)
            temporary.chmod(stat.S_IMODE(like.st_mode))
        effects.flush(temporary)
        effects.rename(temporary, path)
    except OSError:
        with suppress(OSError):
            effects.remove(temporary)
        raise
    effects.flush_folder(path.parent)


def remove_leftovers(path: Path) -> None:
    """Remove what killed writers of this file left next to it. Only for who holds the lock that all its writers take.

    Args:
        path: of the file, which stays.
    """
    for leftover in _leftovers(path):
        disk.current().remove(leftover)


def remove_leftovers_of_ended(path: Path) -> None:
    """Remove what killed writers left next to a file that needs no lock: that of processes that are no longer there.

    Args:
        path: of the file, which stays.
    """
    for leftover in _leftovers(path):
        process = leftover.name.removeprefix(f".{path.name}.").partition("-")[0]
        if process.isdecimal() and not is_alive(int(process)):
            disk.current().remove(leftover)


def _leftovers(path: Path) -> list[Path]:
    return sorted(path.parent.glob(f".{escape(path.name)}.*.new"))


if sys.platform == "win32":

    def is_alive(process: int) -> bool:
        """Return whether a process runs (`os.kill` would end it). If Windows refuses the answer, it counts as alive."""
        import pywintypes
        import win32api
        import win32con
        import win32process
        import winerror

        try:
            handle = win32api.OpenProcess(win32con.PROCESS_QUERY_LIMITED_INFORMATION, False, process)
        except (pywintypes.error, OverflowError) as problem:
            return getattr(problem, "winerror", 0) != winerror.ERROR_INVALID_PARAMETER
        return bool(win32process.GetExitCodeProcess(handle) == win32con.STILL_ACTIVE)

else:

    def is_alive(process: int) -> bool:
        """Return whether a process runs."""
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return False
        except (PermissionError, OverflowError):
            return True
        return True


def append(path: Path, record: Record) -> None:
    """Add the record to a journal; it is on the disk when this returns. The folder must exist, the file need not.

    The records that are there are looked at before the first one that a process adds.

    Args:
        path: the journal; not a link.

    Raises:
        Damaged: a record that is there is not as it was written; nothing was added.
        OSError: it cannot be written.
    """
    append_lines(path, sealed_line(record))


def append_lines(path: Path, lines: bytes, *, in_git: bool = False) -> None:
    """Add sealed lines; after a crash a first part of them may be there, and the next call adds behind it.

    Args:
        path: the journal or log; not a link. Its folder must exist.
        lines: one or more, as `sealed_line` makes them.
        in_git: whether the file is a log that is kept in git.

    Raises:
        Damaged: a record that is there is not as it was written; nothing was added.
        OSError: they cannot be written.
    """
    if not os.path.lexists(path):
        replace(path, lines)
        return
    effects = disk.current()
    disk.check_target(path)
    if (sound := _sound_size(path, in_git=in_git)) != path.stat().st_size:
        effects.cut(path, sound)
    effects.append(path, lines if not in_git or _ends_a_line(path) else b"\n" + lines)
    effects.flush(path)
    _known_sound[path.absolute()] = _version_of(path)


def _ends_a_line(path: Path) -> bool:
    with open_regular(path) as file:
        file.seek(-1, os.SEEK_END)
        return file.read() == b"\n"


_Version = tuple[int, int, int, int]
_known_sound: dict[Path, _Version] = {}
"""Logs that this process has looked at, or added to, as they were then."""


def _version_of(path: Path) -> _Version:
    status = path.stat()
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns


def _sound_size(path: Path, *, in_git: bool) -> int:
    if _known_sound.get(path.absolute()) == _version_of(path):
        return path.stat().st_size
    with open_log(path) as file:
        return size_of_sound_lines(file, path, in_git=in_git)
