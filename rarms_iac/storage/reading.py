"""The one reader: what rarms reads from a disk comes through `open_regular`.

`make lint` refuses any other way to open a file for reading, but for what rarms ships and for files of the kernel.
"""

import os
import sys
import time
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import BinaryIO

from rarms_iac.storage.disk import LEADS_OUT, NotRegular, kind_of, leads_out

STANDARD_INPUT = "-"
"""The path that stands for standard input."""

MEBIBYTE = 2**20
STATE_LIMIT = 64 * MEBIBYTE
LOG_LIMIT = 1024 * MEBIBYTE
"""The largest state of a simulated host; the largest data log or journal; in bytes."""

_RETRIES, _RETRY_SECONDS = 40, 0.025


class TooLarge(OSError):
    """The file has more bytes than files of its kind may have."""

    def __init__(self, path: Path | str, limit: int) -> None:
        super().__init__(0, f"it has more than {limit:,} bytes", str(path))
        self.limit = limit


def open_regular(path: Path | str) -> BinaryIO:
    """Open a regular file for reading, once and without blocking.

    A symbolic link is followed; what counts is what it leads to. The caller closes the file.

    NOTE: in a git repository no link is followed out of it. Its files may come from an untrusted pull
    request, and a finding shows lines of files.

    Returns:
        The file at its first byte.

    Raises:
        NotRegular: it is not a regular file: a pipe would block, a device may be endless. Or it is a file of the
            kernel, or a link that leads out.
        OSError: no such file, or the system does not let us read it.
        ValueError: no file can have this name (it holds a NUL).
    """
    if leads_out(path):
        raise NotRegular(path, LEADS_OUT)
    handle = _open(path)
    status = os.fstat(handle)
    kind = kind_of(status.st_mode)
    if not kind and status.st_dev in _kernels_devices():
        kind = "a file of the kernel"  # it calls it regular, and to read it may wait for ever or take what it shows
    if kind:
        os.close(handle)
        raise NotRegular(path, kind)
    return os.fdopen(handle, "rb")


_OF_THE_KERNEL = ("/proc", "/sys", "/sys/kernel/debug", "/sys/kernel/tracing", "/sys/fs/cgroup", "/dev/mqueue")


@cache
def _kernels_devices() -> frozenset[int]:
    """Return the devices of what the kernel makes up when it is read; a system without such has none."""
    found = set()
    for mount in filter(os.path.ismount, _OF_THE_KERNEL if sys.platform != "win32" else ()):
        with suppress(OSError):
            found.add(Path(mount).stat().st_dev)
    return frozenset(found)


def _open(path: Path | str) -> int:
    for _ in range(_RETRIES):
        try:
            return open_shared(path)
        except PermissionError:
            if sys.platform != "win32":
                raise
            if Path(path).is_dir():  # Windows opens no folder, and says it has no right to
                raise NotRegular(path, "a folder") from None
        except FileNotFoundError:
            if sys.platform != "win32" or not _is_being_replaced(Path(path)):
                raise
        time.sleep(_RETRY_SECONDS)  # Windows: another process is replacing the file right now
    return open_shared(path)


def _is_being_replaced(path: Path) -> bool:
    """Return whether a missing name comes back: Windows replaces a file by two renames, the second of `NAME.new`."""
    return path.exists() or path.with_name(f"{path.name}.new").exists()


if sys.platform == "win32":

    def open_shared(path: Path | str, *, to_write: bool = False) -> int:
        """Open an existing file that others may read, write, replace and remove meanwhile, without waiting.

        Python's own call lets nobody remove it.

        Returns:
            A file descriptor, which the caller closes.

        Raises:
            OSError: Windows refuses; `winerror` has the reason.
            ValueError: no file can have this name (it holds a NUL).
        """
        import msvcrt

        import pywintypes
        import win32con
        import win32file

        if "\0" in str(path):
            raise ValueError("embedded null character")  # as Python says it; Windows would read the name up to it
        share = win32con.FILE_SHARE_READ | win32con.FILE_SHARE_WRITE | win32con.FILE_SHARE_DELETE
        access, flags = (win32con.GENERIC_WRITE, os.O_WRONLY) if to_write else (win32con.GENERIC_READ, os.O_RDONLY)
        try:
            file = win32file.CreateFile(str(path), access, share, None, win32con.OPEN_EXISTING, 0, None)
        except pywintypes.error as problem:
            code, _, reason = problem.args
            raise OSError(0, reason, str(path), code) from None
        return msvcrt.open_osfhandle(file.Detach(), flags | os.O_BINARY)

else:

    def open_shared(path: Path | str, *, to_write: bool = False) -> int:
        """Open an existing file without waiting; a file that is open can be replaced and removed."""
        return os.open(path, (os.O_WRONLY if to_write else os.O_RDONLY) | os.O_NONBLOCK)


def read_file(path: Path | str, limit: int) -> bytes:
    """Read a whole regular file.

    Args:
        limit: bytes that the file may have.

    Returns:
        All of its bytes; no more memory than they take is used.

    Raises:
        NotRegular: it is not a regular file.
        TooLarge: it has more bytes than the limit.
        OSError: as `open_regular`.
        ValueError: as `open_regular`.
    """
    with open_regular(path) as file:
        return read_open(file, path, limit)


def read_open(file: BinaryIO, path: Path | str, limit: int) -> bytes:
    """Read a whole file that `open_regular` opened.

    Args:
        path: of the file, for the error.
        limit: bytes that the file may have.

    Raises:
        TooLarge: it has more bytes than the limit.
    """
    # NOTE: not `read(limit + 1)`, which takes as much memory as the limit, however small the file is.
    if os.fstat(file.fileno()).st_size > limit:
        raise TooLarge(path, limit)
    data = file.read()
    if len(data) > limit:
        raise TooLarge(path, limit)
    return data


def read_input(path: str, limit: int) -> bytes:
    """Read what a user named: a whole regular file, or standard input.

    Args:
        path: a link is followed; `STANDARD_INPUT` is standard input, which is read to its end.
        limit: bytes that it may have.

    Returns:
        All of its bytes.

    Raises:
        NotRegular: it is not a regular file.
        TooLarge: it has more bytes than the limit.
        OSError: as `open_regular`.
        ValueError: as `open_regular`.
    """
    if path != STANDARD_INPUT:
        return read_file(path, limit)
    data = sys.stdin.buffer.read(limit + 1)
    if len(data) > limit:
        raise TooLarge(path, limit)
    return data
