"""The first of the two writers: a whole file at once, for state, plans and snapshots."""

import os
import stat
import sys
import threading
from contextlib import suppress
from glob import escape
from pathlib import Path

from rarms_iac.storage import disk


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
    """Remove what killed writers of this file left beside it. Only for who holds the lock that all its writers take.

    Args:
        path: of the file, which stays.
    """
    for leftover in _leftovers(path):
        disk.current().remove(leftover)


def remove_leftovers_of_ended(path: Path) -> None:
    """Remove what killed writers left beside a file that needs no lock: that of processes that are no longer there.

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
        """Whether a process runs (`os.kill` would end it). One of which Windows says nothing counts as alive."""
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
        """Whether a process runs."""
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return False
        except (PermissionError, OverflowError):
            return True
        return True
