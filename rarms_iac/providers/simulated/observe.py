"""Fetches the raw bytes of a simulated host's file. Makes nothing."""

import sys
import time
from pathlib import Path

RETRIES, RETRY_SECONDS = 40, 0.025


def fetch(path: Path) -> bytes | None:
    """The file's bytes, None where there is no file: an empty machine.

    Raises:
        OSError: it cannot be read.
    """
    for _ in range(RETRIES):
        try:
            return path.read_bytes()
        except FileNotFoundError:
            return None
        except PermissionError:
            if sys.platform != "win32":
                raise
            time.sleep(RETRY_SECONDS)  # it is being replaced right now
    return path.read_bytes()
