"""Digests of large files that were read before, so that they are not read again at each look.

They lie in the user's own cache, outside of every checkout: what came with a checkout could say anything.
"""

import os
from collections.abc import MutableMapping
from dataclasses import dataclass, field
from pathlib import Path

from rarms_iac.storage.codec import Json, NotDecodable
from rarms_iac.storage.disk import make_folders
from rarms_iac.storage.json_text import canonical, parse_json
from rarms_iac.storage.reading import read_file
from rarms_iac.storage.replace import remove_leftovers_of_ended, replace

LARGE = 2**20
"""A file of fewer bytes is read quicker than it is looked up."""
YOUNG_NS = 2 * 10**9
"""A file may change within the same tick of its clock: an entry that is not so much younger than it says nothing."""
MOST_ENTRIES = 5000
_MAX_BYTES = 8 * 2**20


def cache_folder() -> Path:
    """Return the folder of what rarms may forget: in `XDG_CACHE_HOME`, `LOCALAPPDATA`, or `~/.cache`."""
    above = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    return (Path(above) if above else Path.home() / ".cache") / "rarms"


@dataclass(slots=True)
class DigestCache:
    """What is known of large files, by path; read when the first of them is asked for."""

    _entries: MutableMapping[str, Json] | None = None
    _added: dict[str, Json] = field(default_factory=dict)

    def digest_of(self, path: Path) -> str | None:
        """Find the digest that was taken of a file as it is now.

        Args:
            path: of the file, without links in it.

        Returns:
            The digest; None where it is not known, or where the file may have changed within the tick of its clock.

        Raises:
            OSError: there is no such file.
        """
        status = path.stat()
        if status.st_size < LARGE:
            return None
        match self._known().get(str(path)):
            case [list() as state, int() as taken, str() as digest] if state == _state_of(status):
                return digest if taken - max(status.st_mtime_ns, status.st_ctime_ns) > YOUNG_NS else None
            case _:
                return None

    def add(self, path: Path, status: os.stat_result, taken_ns: int, digest: str) -> None:
        """Remember the digest of a file that was just read, if it is large.

        Args:
            path: of the file, without links in it.
            status: of the file before it was read: one that was changed meanwhile has another one since.
            taken_ns: when reading it began (`time.time_ns`).
        """
        if status.st_size >= LARGE:
            self._added[str(path)] = [_state_of(status), taken_ns, digest]

    def save(self) -> None:
        """Write down what was added; where that cannot be written, it is read again the next time."""
        if not self._added:
            return
        entries = {**self._known(), **self._added}
        newest = dict(list(entries.items())[-MOST_ENTRIES:])
        self._entries, self._added = entries, {}
        try:
            file = _file()
            make_folders(file.parent)
            replace(file, canonical(newest).encode("ascii"))
            remove_leftovers_of_ended(file)
        except (OSError, RuntimeError):  # a read-only home, or none
            return

    def _known(self) -> MutableMapping[str, Json]:
        if self._entries is None:
            self._entries = _read()
        return self._entries


def _state_of(status: os.stat_result) -> list[Json]:
    return [status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns]


def _file() -> Path:
    return cache_folder() / "digests.json"


def _read() -> dict[str, Json]:
    try:
        data = parse_json(read_file(_file(), _MAX_BYTES).decode("ascii"))
    except (OSError, RuntimeError, UnicodeDecodeError, NotDecodable):
        return {}
    return data if isinstance(data, dict) else {}
