"""Files that a user asks for: whole or not at all, and told about where they cannot be written."""

import stat
from pathlib import Path

from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.problems import Halted, not_written
from rarms_iac.storage.replace import replace


def write_file(path: str, data: bytes) -> None:
    """Have exactly these bytes in the file; its rights stay, and a link goes on pointing to it.

    Raises:
        Halted: the system does not let us; what was there before still is.
    """
    try:
        target = Path(path).resolve()
        before = target.stat() if target.exists() else None
        if before is not None and not stat.S_ISREG(before.st_mode):
            target.write_bytes(data)  # NOTE: a device or pipe must never be replaced by a file; a folder says no
            return
        replace(target, data)
        if before is not None:
            target.chmod(stat.S_IMODE(before.st_mode))
    except (OSError, ValueError) as error:
        problem = error if isinstance(error, OSError) else OSError(0, "no file can have this name")
        raise Halted(ExitCode.FAILED, [not_written(path, problem)]) from error
