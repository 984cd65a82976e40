"""The first of the two writers: a whole file at once, for state, plans and snapshots."""

import os
import threading
from contextlib import suppress
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
    for leftover in sorted(path.parent.glob(f".{path.name}.*.new")):
        disk.current().remove(leftover)
