"""The rim between rarms and the file system: every effect that must survive a crash is one call of `FileEffects`.

`replace` and `append` do nothing to files but through the disk in use. A test installs another with `use`: one that
counts the effects and ends the process at the n-th shows what a crash leaves behind at every one of them
(`tests/crashing.py`). What is read, and the lock file, which says nothing once its process is dead, do not go this way.
"""

import os
import stat
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

RETRIES = 40
RETRY_SECONDS = 0.025
"""How long a rename waits on Windows for a reader to close the file: a second in all."""


class FileEffects:
    """The effects on files of this machine, each of which a crash may come before, in the middle of, or after."""

    def make_folder(self, folder: Path) -> None:
        """Make one folder in one that exists; it may be there."""
        folder.mkdir(mode=0o775, exist_ok=True)  # under any umask: what others may write, rarms would believe
        give_to_owner(folder, folder.parent.stat())

    def write(self, path: Path, data: bytes) -> None:
        """Make the file new, or empty it, and write this.

        Args:
            path: in a folder that exists; not a link.
            data: all that the file holds then.
        """
        with os.fdopen(open_to_write(path, os.O_CREAT | os.O_TRUNC), "wb") as file:
            file.write(data)
        give_to_owner(path, path.parent.stat())

    def append(self, path: Path, data: bytes) -> None:
        """Write at the end of a file that exists."""
        with os.fdopen(open_to_write(path, os.O_APPEND), "ab") as file:
            file.write(data)

    def cut(self, path: Path, size: int) -> None:
        """Drop everything of the file behind so many bytes.

        Args:
            size: bytes that stay.
        """
        with os.fdopen(open_to_write(path), "r+b") as file:
            file.truncate(size)

    def flush(self, path: Path) -> None:
        """Write the file's content to the disk itself before returning."""
        with os.fdopen(open_to_write(path), "r+b") as file:  # Windows flushes only what is open for writing
            os.fsync(file.fileno())

    def rename(self, source: Path, target: Path) -> None:
        """Give the file this name in its folder, in one moment, in place of what has it.

        Args:
            target: its name afterwards, in the same folder.
        """
        for _ in range(RETRIES):
            try:
                source.replace(target)
            except PermissionError:
                if sys.platform != "win32":
                    raise
                time.sleep(RETRY_SECONDS)  # another process has the target open: there a file in use cannot be replaced
            else:
                return
        source.replace(target)

    def flush_folder(self, folder: Path) -> None:
        """Write the names in the folder to the disk itself before returning.

        Args:
            folder: in which a name was made, changed or removed.
        """
        if sys.platform == "win32":
            return  # NTFS journals its names, and a folder cannot be opened
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)

    def remove(self, path: Path) -> None:
        """Remove the file; it may be gone."""
        path.unlink(missing_ok=True)


def give_to_owner(path: Path, like: os.stat_result) -> None:
    """Give what root made to the owner of its folder, or of what it replaces: a checkout stays its user's.

    Args:
        path: a file or folder that was just made.
        like: says the owner; where that is root, or where this process is not root's, nothing is done.
    """
    if sys.platform != "win32" and os.geteuid() == 0 and (like.st_uid, like.st_gid) != (0, 0):
        os.chown(path, like.st_uid, like.st_gid, follow_symlinks=False)


def leads_out(path: Path | str) -> bool:
    """Return whether links lead a path out of its repository; False outside of repositories.

    Args:
        path: of a file or folder that need not exist.
    """
    # NOTE: Path.resolve raises a RuntimeError where links go in a circle.
    named, real = Path(os.path.normpath(Path(path).absolute())), Path(os.path.realpath(path))
    if named == real:
        return False
    repository = next((folder for folder in named.parents if (folder / ".git").exists()), None)
    return repository is not None and not real.is_relative_to(repository.resolve())


class NotRegular(OSError):
    """The name is that of a folder, a device, a pipe or a socket, or of a link that is not followed."""

    def __init__(self, path: Path | str, kind: str) -> None:
        super().__init__(0, f"it is {kind}, not a regular file", str(path))
        self.kind = kind


A_LINK, LEADS_OUT = "a symbolic link", "a link that leads out of the repository"


def kind_of(mode: int) -> str:
    """Name what is not a regular file.

    Returns:
        What it is, with its article; empty: a regular file.
    """
    if stat.S_ISREG(mode):
        return ""
    return A_LINK if stat.S_ISLNK(mode) else "a folder" if stat.S_ISDIR(mode) else "a device, a pipe or a socket"


def advice_on(error: OSError, otherwise: str) -> str:
    """Say what to do about a file that could not be read or written.

    Args:
        otherwise: the advice where neither rights nor what the name stands for are the reason.

    Returns:
        Whole sentences.
    """
    match error:
        case NotRegular(kind=kind) if kind in {A_LINK, LEADS_OUT}:
            return "Replace the link with a copy or a mount of its target."
        case NotRegular():
            return "Replace it with a regular file."
        case PermissionError():
            return "Run rarms as the owner of the file, or correct the permissions."
        case _:
            return otherwise


def open_to_write(path: Path, flags: int = 0) -> int:
    """Open a regular file for reading and writing, without blocking and without following a link.

    A link among the folders above is followed, but not out of the repository from a folder that rarms makes there.

    Args:
        flags: more flags of `os.open`; `O_CREAT` makes the file where there is none.

    Returns:
        A file descriptor, which the caller closes.

    Raises:
        NotRegular: the name is that of a link, a folder, a pipe or a device.
        OSError: the system refuses.
    """
    check_target(path)
    safe = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    handle = os.open(path, os.O_RDWR | safe | flags, 0o664)
    if kind := kind_of(os.fstat(handle).st_mode):  # it came between the check and the opening
        os.close(handle)
        raise NotRegular(path, kind)
    return handle


def check_target(path: Path) -> None:
    """Refuse a name that is there and is not a regular file's, or that lies out of the repository.

    Raises:
        NotRegular: the name is that of a link, a folder, a pipe or a device, or `check_folder` refuses its folder.
    """
    check_folder(path.parent)
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return
    if kind := kind_of(mode):
        raise NotRegular(path, kind)


PRIVATE = ".rarms"
MEASUREMENTS = "measurements"


def check_folder(folder: Path) -> None:
    """Refuse what lies in a `.rarms` or `measurements` that a link takes out of the repository.

    A pull request that brings such a link must not choose where rarms writes.

    Raises:
        NotRegular: the folder, or one above it, is such a link.
    """
    if {PRIVATE, MEASUREMENTS} & set(folder.absolute().parts) and leads_out(folder):
        raise NotRegular(folder, LEADS_OUT)


_in_use: list[FileEffects] = [FileEffects()]


def current() -> FileEffects:
    """Return the disk in use: the real one unless a test installed another."""
    return _in_use[-1]


@contextmanager
def use(disk: FileEffects) -> Iterator[None]:
    """Have this disk used while the context lasts. For tests only.

    Args:
        disk: whose effects are asked for from now on.

    Yields:
        Once, while the disk is in use.
    """
    _in_use.append(disk)
    try:
        yield
    finally:
        _in_use.remove(disk)


def make_folders(folder: Path) -> None:
    """Make the folder and those above it, each durable in its parent before the next.

    Args:
        folder: nothing is done where it exists.

    Raises:
        NotRegular: as `check_folder`.
    """
    check_folder(folder)
    missing = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    for path in reversed(missing):
        current().make_folder(path)
        current().flush_folder(path.parent)


def make_folder_for(path: Path) -> None:
    """Make the folder that the file is to lie in; if that is below a `.rarms`, have git ignore all of it.

    Args:
        path: of a file that need not exist.
    """
    make_folders(path.parent)
    private = next((folder for folder in path.parents if folder.name == PRIVATE), None)
    if private is None:
        return
    ignore = private / ".gitignore"
    if not (ignore.exists() and ignore.stat().st_size):
        effects = current()
        # NOTE: not replaced but written: half of it says the same, and a kill leaves no other file behind.
        effects.write(ignore, b"*\n")
        effects.flush(ignore)
        effects.flush_folder(private)
