"""Files that a user names: read up to a limit, and written whole or not at all."""

import stat
from pathlib import Path

from rarms_iac.app.use_case_errors import Outcome, UseCaseError, conflict_finding, read_finding, write_finding
from rarms_iac.manifest.load import manifest_path
from rarms_iac.model.commands import RecommendedCommand, prose
from rarms_iac.storage.disk import make_folders
from rarms_iac.storage.reading import STANDARD_INPUT, read_input
from rarms_iac.storage.writing import remove_leftovers_of_ended, replace
from rarms_iac.texts.messages import reason_of


def read_input_file(path: str, limit: int, origin: RecommendedCommand) -> bytes:
    """Read what a user named, with `storage.reading`.

    Args:
        path: as the user gave it; `-` is standard input.
        limit: bytes that it may have.
        origin: the command that makes such a file, for the advice where this one cannot be read.

    Returns:
        All of its bytes.

    Raises:
        UseCaseError: it is not there (missing), cannot be read, or is too large (failed).
    """
    try:
        return read_input(path, limit)
    except (OSError, ValueError) as error:
        message = reason_of(error)
        advice = prose("Check the path and its permissions; ", origin, " writes such a file.")
        outcome = Outcome.MISSING if isinstance(error, FileNotFoundError) else Outcome.FAILED
        raise UseCaseError(outcome, [read_finding(path, message, advice)]) from error


def write_file(path: str, data: bytes) -> None:
    """Replace what a file holds, whole or not at all; its owner and rights stay.

    Nothing is written through a link; what leads to a device or a pipe (`/dev/stdout`) is written to.

    Args:
        path: as the user gave it; its folder exists.

    Raises:
        UseCaseError: the name is that of a link, or the system does not let us; what was there before still is.
    """
    try:
        target = Path(path)
        before = target.stat() if target.exists() else None
        if before is not None and not stat.S_ISREG(before.st_mode):
            target.write_bytes(data)  # NOTE: a device or pipe must never be replaced by a file; a folder says no
            return
        replace(target, data, like=before)
        remove_leftovers_of_ended(target)
    except (OSError, ValueError) as error:
        problem = error if isinstance(error, OSError) else OSError(0, "this is not a valid file name")
        raise UseCaseError(Outcome.FAILED, [write_finding(path, problem)]) from error


def write_new_file(path: str, data: bytes) -> None:
    """Write a file that is not there yet.

    Args:
        path: as the user gave it; its folder exists.

    Raises:
        UseCaseError: something has that name, a link included, or the system does not let us (failed).
    """
    target = Path(path)
    if target.exists() or target.is_symlink():
        raise UseCaseError(Outcome.FAILED, [conflict_finding(path)])
    write_file(path, data)


def make_folder(path: str) -> None:
    """Make a folder and those above it; it may exist.

    Raises:
        UseCaseError: the system does not let us, or a file has its name.
    """
    try:
        make_folders(Path(path))
    except (OSError, ValueError) as error:
        problem = error if isinstance(error, OSError) else OSError(0, "this is not a valid folder name")
        raise UseCaseError(Outcome.FAILED, [write_finding(path, problem)]) from error


def folder_of(manifest: str) -> Path:
    """Return the folder of a manifest, as seen from here: simulated hosts and data logs lie below it.

    Args:
        manifest: its path, as given or as a plan names it; `-` is a manifest from standard input, of this folder.

    Returns:
        A path; `.` for the folder of this process.
    """
    return Path() if manifest == STANDARD_INPUT else Path(manifest_path(manifest)).parent
