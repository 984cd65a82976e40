"""The first of the two writers: a whole file at once, for state, plans and snapshots."""

import os
import sys
import threading
from contextlib import suppress
from glob import escape
from pathlib import Path

from rarms_iac.storage import disk


def replace(path: Path, data: bytes) -> None:
    """Make the file exactly these bytes, durably: a reader, now or after a crash, sees the old or the new ones whole.

    The file's folder must exist.

    Args:
        path: of the file.
        data: all that it holds then.

    Raises:
        NotOurFile: the name is that of a link, a folder, a pipe or a device.
        OSError: it cannot be written; the old content is still there.
    """
    disk.check_target(path)
    effects = disk.current()
    temporary = path.with_name(f".{path.name}.{os.getpid()}-{threading.get_ident()}.new")
    try:
        effects.write(temporary, data)
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

    On Windows nothing is removed, since there nobody can ask for a process by its number without ending it.

    Args:
        path: of the file, which stays.
    """
    if sys.platform == "win32":
        return
    for leftover in _leftovers(path):
        process = leftover.name.removeprefix(f".{path.name}.").partition("-")[0]
        if process.isdecimal() and not _is_alive(int(process)):
            disk.current().remove(leftover)


def _leftovers(path: Path) -> list[Path]:
    return sorted(path.parent.glob(f".{escape(path.name)}.*.new"))


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True
