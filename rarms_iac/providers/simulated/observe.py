"""Fetches the raw bytes of a simulated host's file. Makes nothing."""

from pathlib import Path

from rarms_iac.storage.reading import STATE_LIMIT, read_file


def fetch(path: Path) -> bytes | None:
    """The file's bytes, None where there is no file: an empty machine.

    Raises:
        OSError: it cannot be read.
    """
    try:
        return read_file(path, STATE_LIMIT)
    except FileNotFoundError:
        return None
