"""Records of a log from elsewhere, such as a robot: checked as if they were ours, then added to the log here."""

import io
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from rarms_iac.model.names import is_name
from rarms_iac.storage.datalog.decisions import entries_in, runs_in
from rarms_iac.storage.datalog.files import CONFIGURATION, TUNING, LogUnreadable, log_errors, log_in, log_path
from rarms_iac.storage.disk import MEASUREMENTS, make_folders
from rarms_iac.storage.reading import MEBIBYTE
from rarms_iac.storage.records import LogLine, iterate_log, log_lines
from rarms_iac.storage.writing import append_lines

MOST_BYTES = 64 * MEBIBYTE
"""What may come from elsewhere at once: one log, or all logs of a robot together."""


def is_log(name: str) -> bool:
    """Return whether a file is a log of `measurements/`.

    Args:
        name: The file's path below that folder, with `/`.
    """
    match PurePosixPath(name).parts:
        case (platform, file) if is_name(platform):
            return file == TUNING or (file.endswith(CONFIGURATION) and is_name(file.removesuffix(CONFIGURATION)))
        case (platform, components, file) if is_name(platform) and file.endswith(".jsonl"):
            return all(map(is_name, (*components.split("+"), file.removesuffix(".jsonl"))))
    return False


def new_records(folder: Path, name: str, came: bytes) -> bytes:
    """Return the lines of a log from elsewhere that the log of the same name here lacks; nothing is written.

    Every record is read with the reader of its kind of log, and both logs are read whole.

    Args:
        name: The log's path below `measurements/`, as of `is_log`.
        came: The log's bytes from elsewhere; a last line that is torn is left out.

    Returns:
        Sealed lines in the order in which they came; empty: there is nothing new.

    Raises:
        LogUnreadable: one of the two is damaged, or is not a log of this name; what came has more than `MOST_BYTES`.
        OSError: the log here cannot be read.
    """
    assert is_log(name), name
    elsewhere, here = Path(name), folder / MEASUREMENTS / name
    if len(came) > MOST_BYTES:
        raise LogUnreadable(elsewhere, 1, f"it has more than {MOST_BYTES:,} bytes")
    with log_errors():
        lines = tuple(log_lines(io.BytesIO(came), elsewhere))
        _check(lines, elsewhere)
        known = {line.digest for line in iterate_log(here)}
    return b"".join(line.sealed for line in lines if line.digest not in known)


def merge_records(folder: Path, name: str, came: bytes) -> bool:
    """Add the records of a log from elsewhere that the log of the same name here lacks. Only for who holds that log.

    Returns:
        Whether anything was added; it is on the disk then.

    Raises:
        LogUnreadable: as of `new_records`; nothing was added.
        OSError: the log cannot be read or written.
    """
    lines = new_records(folder, name, came)
    if lines:
        path = folder / MEASUREMENTS / name
        make_folders(path.parent)
        with log_errors():
            append_lines(path, lines, in_git=True)
    return bool(lines)


def _check(lines: Iterable[LogLine], path: Path) -> None:
    """Refuse a log that its reader does not read, or that is of something else than its name says."""
    is_decisions = len(path.parts) == 2
    if is_decisions and path.name == TUNING:
        runs_in(lines, path)
    elif is_decisions:
        component = path.name.removesuffix(CONFIGURATION)
        if others := {entry.component for entry in entries_in(lines, path)} - {component}:
            raise LogUnreadable(path, 1, f"it belongs to {min(others)}, not {component}")
    else:
        for header in log_in(lines, path).headers.values():
            own = log_path(Path(), header.platform, header.setup.members, header.setup.interference)
            if own != Path(MEASUREMENTS, path):
                raise LogUnreadable(path, 1, f"it belongs to {own.as_posix()}")
