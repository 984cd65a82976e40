"""The files that belong to what is measured, below the manifest's folder, and their digests.

The manifest may be untrusted: nothing outside of its folder is opened, folders are walked once a pattern,
and names and bytes are bounded by counts, so that the same folder gives the same files on every machine. Digests of
large files lie in the user's own cache, outside of every checkout: what came with a checkout could say anything.
"""

import fnmatch
import hashlib
import os
import re
import shutil
import time
from collections.abc import Iterable, Iterator, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from rarms_iac.model.loads import CommandLoad, Interference
from rarms_iac.model.run import (
    AttachedContainer,
    AttachedService,
    Call,
    Command,
    Container,
    Process,
    Processes,
    Run,
    Service,
)
from rarms_iac.model.system import Component
from rarms_iac.storage.codec import Json, NotDecodable
from rarms_iac.storage.datalog.identity import LogSubject
from rarms_iac.storage.disk import make_folders
from rarms_iac.storage.json_text import canonical, parse_json, short
from rarms_iac.storage.reading import open_regular, read_file
from rarms_iac.storage.writing import remove_leftovers_of_ended, replace

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
    """The known digests of large files, by path; read when the first of them is asked for."""

    _entries: MutableMapping[str, Json] | None = None
    _added: dict[str, Json] = field(default_factory=dict)

    def digest_of(self, path: Path) -> str | None:
        """Find the digest that was taken of a file as it is now.

        Args:
            path: of the file, without links in it.

        Returns:
            The digest; None where it is not known, or where the file may have changed within the tick of its clock.

        Raises:
            OSError: no such file.
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


MOST_ENTRIES = 100_000
"""Entries of folders, and words of commands, that are looked at."""
MOST_MATCHES = 1_000_000
"""Comparisons of an entry with a part of a pattern."""
MOST_FILES = 10_000
"""Files that are read."""
MOST_BYTES = 256 * 2**20
"""Bytes that are read where files are only compared with what was measured; whole files are left out beyond."""
MOST_MEASURED_BYTES = 2 * 2**30
"""Bytes of one subject's files that count by their content; a file beyond counts by its size, here and in its log."""
MOST_PROGRAM_BYTES = 256 * 2**20
"""Bytes of one subject's programs outside of the folder that count by their content; one beyond counts by its size."""

_LOOKED_AT = 8000  # bytes: git recognises a text by them
_CHUNK = 2**20
_DIGITS = 16
_WILD = re.compile(r"[*?\[]")
_ANY_FOLDERS = "**"


@dataclass(slots=True)
class Files:
    """The files below a manifest's folder; each is read once, however many components name it."""

    folder: Path
    most_bytes: int | None = MOST_BYTES  # that are read in all; None: no limit
    code: Path | None = None  # the folder that the components' files lie in; None: the same
    cut: str = ""  # a bound that left out names of files, as the end of a sentence; empty: none did
    _known: MutableMapping[Path, str] = field(default_factory=dict)
    _cache: DigestCache = field(default_factory=DigestCache)
    _entries: int = 0
    _matches: int = 0
    _bytes: int = 0

    def of(self, subject: LogSubject) -> dict[str, str]:
        """Return the digest of every file that belongs to the subject, by path below the manifest's folder.

        Returns:
            Digests by path, sorted, or `size N` (bytes) of a file beyond `MOST_MEASURED_BYTES`. A file that is not
            here, or that another bound leaves out, is missing.

        Raises:
            OSError: one of them cannot be read.
        """
        return self.named_by(subject.components, (subject.load,))

    def named_by(self, components: Iterable[Component], loads: Iterable[Interference]) -> dict[str, str]:
        """Return the digest of every file that components and loads name, as `of` returns them.

        Returns:
            Digests by path below the folder of the components' files.

        Raises:
            OSError: one of them cannot be read.
        """
        root = self._root.resolve()
        files = {path.relative_to(root).as_posix(): path for path in sorted(set(self._all(components, loads)))}
        return self._digests(files, MOST_MEASURED_BYTES, "its files have more than 2 GiB")

    def interpreters(self, subject: LogSubject) -> dict[str, str]:
        """Return the digest of every program outside the folder that the subject's commands begin with, by their word.

        Returns:
            Digests by word, or `size N` (bytes) of one beyond `MOST_PROGRAM_BYTES`; a word that is not on the search
            path is missing.

        Raises:
            OSError: one of them cannot be read.
        """
        found = {word: shutil.which(word) for word in _first_words(subject)}
        paths = {word: Path(program).resolve() for word, program in found.items() if program is not None}
        programs = {word: path for word, path in paths.items() if not self._is_below(path)}
        return self._digests(programs, MOST_PROGRAM_BYTES, "the programs of the commands have more than 256 MiB")

    def _digests(self, paths: Mapping[str, Path], most_bytes: int, reason: str) -> dict[str, str]:
        """Return the digest of each file; its size instead, where all until then have more than so many bytes."""
        found: dict[str, str | None] = {}
        counted = 0
        for name, path in paths.items():
            size = path.stat().st_size  # whether it is in the cache or not: everywhere the same files count by content
            if counted + size > most_bytes:
                found[name] = f"size {size}"
                self.cut = f"only the size of {name} is compared, because {reason}"
            else:
                counted += size
                found[name] = self._digest(path)
        self._cache.save()
        return {name: value for name, value in found.items() if value is not None}

    @property
    def _root(self) -> Path:
        return self.code or self.folder

    def _all(self, components: Iterable[Component], loads: Iterable[Interference]) -> Iterator[Path]:
        for component in components:
            if component.run is not None:
                yield from self._of_run(component.run)
        for load in loads:
            if isinstance(load, CommandLoad):
                yield from self._of_words(self._root, load.command)

    def _of_run(self, run: Run) -> Iterator[Path]:
        for process in run.each_process.values():
            yield from self._of_process(process)
        for pattern in run.files:
            base = self._root / run.folder
            yield from self._that_are(*self._matching(Path(os.path.normpath(base.resolve() / pattern))))

    def _of_process(self, process: Process) -> Iterator[Path]:
        base = self._root / process.folder
        match process.start:
            case Command(words=words) | Service(exec=words):
                yield from self._of_words(base, words)
            case Container(command=words, options=options):
                yield from self._of_words(base, (*options, *words))
            case AttachedService() | AttachedContainer():
                return  # it runs already
            case Processes():
                return  # each of them is a process of its own
            case Call(module=module):
                parts = base.joinpath(*module.split("."))
                yield from self._that_are(parts.with_name(f"{parts.name}.py"), parts / "__init__.py")
        yield from self._that_are(*(self._root / file for file in (process.environment_file, *process.setup) if file))

    def _of_words(self, base: Path, words: Sequence[str]) -> Iterator[Path]:
        """Yield a word that names nothing is a word; one that no path can be is none."""
        for word in words:
            if not self._may_look():
                return
            if word and "\0" not in word:
                yield from self._that_are(base / word)

    def _that_are(self, *paths: Path) -> Iterator[Path]:
        for path in paths:
            try:
                real = Path(os.path.realpath(path))
                if real.is_file() and self._is_below(real):
                    yield real
            except (OSError, ValueError):  # too long to be a path, or it holds a NUL
                continue

    def _matching(self, pattern: Path) -> Iterator[Path]:
        """Yield the files that a pattern names; none where it leads out of the folder."""
        top = self._root.resolve()
        if not pattern.is_relative_to(top):
            return
        parts: list[str] = []
        for part in pattern.relative_to(top).parts:
            if part != _ANY_FOLDERS or parts[-1:] != [_ANY_FOLDERS]:
                parts.append(part)
        folders = [(top, _reached({0}, parts))]
        while folders:
            folder, at = folders.pop()
            for entry in self._entries_of(folder, at, parts):
                if not self._may_look():
                    return
                after = self._after(entry, at, parts)
                if len(parts) in after:
                    yield entry
                if any(number < len(parts) for number in after) and entry.is_dir():
                    folders.append((entry, after))

    def _entries_of(self, folder: Path, at: frozenset[int], parts: Sequence[str]) -> Sequence[Path]:
        """Return the entries that a part may name, in the order of their names.

        A plain name needs no look at the others.
        """
        names = {parts[number] for number in at if number < len(parts)}
        if not any(map(_WILD.search, names)):
            return [folder / name for name in sorted(names) if os.path.lexists(folder / name)]
        try:
            return [folder / name for name in sorted(os.listdir(folder))]  # noqa: PTH208 - the names alone
        except OSError:
            return []

    def _after(self, entry: Path, at: frozenset[int], parts: Sequence[str]) -> frozenset[int]:
        """Return the parts that come next once this entry was matched.

        `**` goes through no link and no hidden folder.
        """
        after: set[int] = set()
        self._matches += len(at)
        for number in at:
            if number == len(parts):
                continue
            part = parts[number]
            if part == _ANY_FOLDERS:
                if not entry.name.startswith(".") and not (entry.is_symlink() and entry.is_dir()):
                    after.add(number)
            elif _part_pattern(part).fullmatch(os.path.normcase(entry.name)) and (
                part.startswith(".") or not entry.name.startswith(".")
            ):
                after.add(number + 1)
        return _reached(after, parts)

    def _may_look(self) -> bool:
        self._entries += 1
        if self._entries > MOST_ENTRIES or self._matches > MOST_MATCHES:
            self.cut = f"only the first {MOST_ENTRIES:,} names were read"
        return not self.cut

    def _is_below(self, path: Path) -> bool:
        return path.is_relative_to(self._root.resolve())

    def _digest(self, path: Path) -> str | None:
        """Return the file's digest; None where a bound leaves it out."""
        if path in self._known:
            return self._known[path]
        if len(self._known) >= MOST_FILES:
            self.cut = f"only the first {MOST_FILES:,} files were read"
            return None
        known = self._cache.digest_of(path)
        if known is None:
            status, now = path.stat(), time.time_ns()
            if self.most_bytes is not None and self._bytes + status.st_size > self.most_bytes:
                return None
            self._bytes += status.st_size
            known = file_digest(path)
            self._cache.add(path, status, now, known)
        self._known[path] = known
        return known


def _reached(at: set[int], parts: Sequence[str]) -> frozenset[int]:
    """Return these places in a pattern, and those behind a `**`, which may stand for no folder."""
    found = set(at)
    for number in sorted(at):
        if number < len(parts) and parts[number] == _ANY_FOLDERS:
            found.add(number + 1)
    return frozenset(found)


@cache
def _part_pattern(part: str) -> "re.Pattern[str]":
    return re.compile(fnmatch.translate(os.path.normcase(part)))


def file_digest(path: Path) -> str:
    """Return a digest of the content, the same after all that git does to a text's line ends.

    Args:
        path: of a regular file; it is read in pieces.

    Returns:
        16 hex digits.

    Raises:
        OSError: it cannot be read.
    """
    total = hashlib.sha256()
    with open_regular(path) as file:
        chunk = file.read(_CHUNK)
        is_text = b"\0" not in chunk[:_LOOKED_AT]
        held = b""
        while chunk:
            data = held + chunk
            held = b"\r" if is_text and data.endswith(b"\r") else b""
            data = data[: len(data) - len(held)]
            total.update(data.replace(b"\r\n", b"\n") if is_text else data)
            chunk = file.read(_CHUNK)
        total.update(held)
    return short(total.hexdigest(), _DIGITS)


def _first_words(subject: LogSubject) -> Iterator[str]:
    for component in subject.components:
        for process in () if component.run is None else component.run.each_process.values():
            yield from (process.command or (process.service.exec if process.service else ()))[:1]
    if isinstance(subject.load, CommandLoad):
        yield from subject.load.command[:1]
