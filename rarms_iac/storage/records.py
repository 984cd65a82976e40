"""The records of journals and logs, as lines; `writing` adds them.

A record is one JSON object on one line. Its last two fields, `length` and `checksum`, are over the object's text
without them and without the line end, so that a carriage return added by git does no harm.

The first record gets its name once it is whole on the disk, so no crash tears it. A crash can tear a later last one:
it has no line end then, or holds NUL bytes where the disk had not yet got its text. It is dropped, and the next append
takes its place. Anything else is damage, which is an error to read and to append to.

Logs below `measurements/` are kept in git, and editors and merges change files there: blank lines are passed over, and
a last record that is whole counts without its line end. Marks of a merge conflict are damage of a kind of its own.
"""

import hashlib
import io
import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from rarms_iac.storage.codec import Json
from rarms_iac.storage.json_text import parse_json
from rarms_iac.storage.reading import LOG_LIMIT, TooLarge, open_regular

Record = Mapping[str, Json]

LENGTH, CHECKSUM = "length", "checksum"
_SEAL = re.compile(rb',"length":([0-9]{1,12}),"checksum":"([0-9a-f]{64})"\}\r?\n')
_SEAL_SPACE = 128  # bytes that a seal takes at most
_DAMAGE = "the record is damaged: its length or checksum does not fit its text"
_CONFLICT = "it contains the markers of a merge conflict"
_CONFLICT_MARKS = (b"<<<<<<< ", b"||||||| ", b"=======", b">>>>>>> ")


class Damaged(Exception):
    """A record is not as it was written, and no crash while it was added can have done that."""

    def __init__(self, path: Path, line: int, message: str, *, is_conflict: bool = False) -> None:
        super().__init__(f"{path}:{line}: {message}")
        self.path = path
        self.line = line
        self.message = message
        self.is_conflict = is_conflict  # git could not merge two branches here


def sealed_line(record: Record) -> bytes:
    """Return the record as its line, the end included.

    Args:
        record: fields of JSON values, no number of which is NaN or infinite.

    Returns:
        ASCII: the record's JSON with `length` and `checksum` over the text without them.

    Raises:
        ValueError: it is empty, or has a field of a name that the line itself needs.
    """
    if not record or LENGTH in record or CHECKSUM in record:
        raise ValueError(f"a record has at least one field, and none called {LENGTH} or {CHECKSUM}")
    return _sealed(json.dumps(record, separators=(",", ":"), allow_nan=False).encode("ascii"))


def _sealed(text: bytes) -> bytes:
    return b'%s,"length":%d,"checksum":"%s"}\n' % (text[:-1], len(text), _checksum(text))


@dataclass(frozen=True, slots=True, kw_only=True)
class LogLine:
    """A whole line of a log that is kept in git."""

    number: int  # from 1
    text: bytes  # the object without its seal
    digest: bytes  # of the text

    def record(self, path: Path) -> dict[str, Json]:
        """Return the record; `path` says where it comes from, for people.

        Raises:
            Damaged: it is sealed and no object.
            NotDecodable: it is sealed and no JSON.
        """
        return _object(path, self.number, self.text)

    @property
    def sealed(self) -> bytes:
        """The line as `sealed_line` makes it."""
        return _sealed(self.text)


def log_lines(lines: Iterable[bytes], path: Path) -> Iterator[LogLine]:
    """Go through the whole lines of a log that is kept in git; of equal ones the first.

    Yields:
        Lines in their order, up to a last one that a crash tore.

    Raises:
        Damaged: a record is not as it was written; those before it came already.
    """
    known: set[bytes] = set()
    for number, text in _sound_lines(lines, path, in_git=True):
        digest = hashlib.sha256(text).digest()
        if digest not in known:
            known.add(digest)
            yield LogLine(number=number, text=text, digest=digest)


def iterate_log(path: Path) -> Iterator[LogLine]:
    """Go through the lines of a log that is kept in git; of equal ones the first.

    A long log need not be in memory as a whole.

    Yields:
        Lines in their order, up to a last one that a crash tore; none without a file.

    Raises:
        TooLarge: the file has more than `LOG_LIMIT` bytes.
        Damaged: a record is not as it was written; those before it came already.
    """
    try:
        file = open_log(path)
    except FileNotFoundError:
        return
    with file:
        yield from log_lines(file, path)


def open_log(path: Path) -> BinaryIO:
    """Open a log of at most `LOG_LIMIT` bytes; the caller closes it."""
    file = open_regular(path)
    if os.fstat(file.fileno()).st_size > LOG_LIMIT:
        file.close()
        raise TooLarge(path, LOG_LIMIT)
    return file


def records_in(data: bytes, path: Path) -> tuple[dict[str, Json], ...]:
    """Return all whole records of these bytes; `path` says where they come from, for people.

    Args:
        data: the bytes of a log.

    Returns:
        The records, oldest first; at least one.

    Raises:
        Damaged: one is not as it was written.
    """
    return tuple(_records(io.BytesIO(data), path))


def first_in(data: bytes, path: Path) -> dict[str, Json]:
    """Return the first record of these bytes alone.

    Args:
        data: the bytes of a log.

    Returns:
        The record without `length` and `checksum`.

    Raises:
        Damaged: it is not as it was written.
    """
    return next(_records(io.BytesIO(data), path))


def last_in(data: bytes, path: Path) -> dict[str, Json] | None:
    """Return the last record of these bytes alone, without a look at those before it; None where it is torn or damaged.

    Args:
        data: the bytes of a log.

    Returns:
        The record without `length` and `checksum`.

    Raises:
        Damaged: it is sealed and no object.
        NotDecodable: it is sealed and no JSON.
    """
    text = _text_of(data[data.rfind(b"\n", 0, max(0, len(data) - 1)) + 1 :])
    return None if text is None else _object(path, 1, text)


def _checksum(text: bytes) -> bytes:
    return hashlib.sha256(text).hexdigest().encode("ascii")


def _records(lines: Iterable[bytes], path: Path) -> Iterator[dict[str, Json]]:
    """Yield the records of these lines, each with its end, up to a last one that is torn."""
    for number, text in _sound_lines(lines, path):
        yield _object(path, number, text)


def _sound_lines(lines: Iterable[bytes], path: Path, *, in_git: bool = False) -> Iterator[tuple[int, bytes]]:
    """Yield the number and the object's text of each line, up to a last one that is torn."""
    number = torn_at = found = 0
    for number, line in enumerate(lines, start=1):
        if in_git and not line.strip():
            continue
        if in_git and line.startswith(_CONFLICT_MARKS):
            raise Damaged(path, number, _CONFLICT, is_conflict=True)
        text = None if torn_at else _text_of(line, needs_end=not in_git)
        is_torn = text is None and not torn_at and found > 0 and _can_be_torn(line)
        del line  # a long one need not be in memory twice
        if is_torn:
            torn_at = number
        elif text is None:
            raise Damaged(path, torn_at or number, _DAMAGE)
        else:
            found += 1
            yield number, text
    if not found:
        raise Damaged(path, 1, "the file is empty: its first record is missing")


def _can_be_torn(line: bytes) -> bool:
    """Return whether a crash can have left the line so, if it is the last one."""
    return not line.endswith(b"\n") or b"\0" in line


def _text_of(line: bytes, *, needs_end: bool = True) -> bytes | None:
    """Return the object's text without its seal, None where the line is not whole."""
    if not needs_end and not line.endswith(b"\n"):
        line += b"\n"
    tail_at = max(0, len(line) - _SEAL_SPACE)
    found = _SEAL.search(line, tail_at)
    if found is None or found.end() != len(line):
        return None
    text = line[: found.start()] + b"}"
    whole = int(found[1]) == len(text) and found[2] == _checksum(text)
    return text if whole else None


def _object(path: Path, number: int, text: bytes) -> dict[str, Json]:
    try:
        decoded = text.decode("ascii")
    except UnicodeDecodeError:
        raise Damaged(path, number, "the record is not ASCII") from None
    data = parse_json(decoded)
    if not isinstance(data, dict):
        raise Damaged(path, number, "the record is not an object")
    return data


def size_of_sound_lines(lines: Iterable[bytes], path: Path, *, in_git: bool = False) -> int:
    """Return the bytes of the lines up to a last one that is torn.

    Raises:
        Damaged: a record is not as it was written.
    """
    sound = read = 0

    def count() -> Iterator[bytes]:
        nonlocal read
        for line in lines:
            read += len(line)
            yield line

    for _ in _sound_lines(count(), path, in_git=in_git):
        sound = read
    return sound
