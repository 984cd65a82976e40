"""The second of the two writers: one record more, for journals and data logs.

A record is one JSON object on one line. Its last two fields, `length` and `checksum`, are over the object's text
without them and without the line end, so that a carriage return added by git does no harm. The last record may be torn
by a crash: it is dropped, and the next append takes its place. A damaged earlier one is an error.
"""

import hashlib
import io
import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

from rarms_iac.storage import disk
from rarms_iac.storage.codec import Json
from rarms_iac.storage.json_text import parse_json
from rarms_iac.storage.reading import LOG_LIMIT, TooLarge, open_regular

Record = Mapping[str, Json]

LENGTH, CHECKSUM = "length", "checksum"
_SEAL = re.compile(rb',"length":([0-9]{1,12}),"checksum":"([0-9a-f]{64})"\}\r?\n')
_SEAL_SPACE = 128  # bytes that a seal takes at most
_CHUNK = 4096


class Damaged(Exception):
    """A record before the last one is not as it was written."""

    def __init__(self, path: Path, line: int, message: str) -> None:
        super().__init__(f"{path}:{line}: {message}")
        self.path = path
        self.line = line
        self.message = message


def line_of(record: Record) -> bytes:
    """The record as its line, the end included.

    Args:
        record: fields of JSON values, no number of which is NaN or infinite.

    Returns:
        ASCII: the record's JSON with `length` and `checksum` over the text without them.

    Raises:
        ValueError: it is empty, or has a field of a name that the line itself needs.
    """
    if not record or LENGTH in record or CHECKSUM in record:
        raise ValueError(f"a record has at least one field, and none called {LENGTH} or {CHECKSUM}")
    text = json.dumps(record, separators=(",", ":"), allow_nan=False).encode("ascii")
    return b'%s,"length":%d,"checksum":"%s"}\n' % (text[:-1], len(text), _checksum(text))


def append(path: Path, record: Record) -> None:
    """Add the record; it is on the disk when this returns. The folder must exist, the file need not.

    Args:
        path: the log; not a link.
        record: as of `line_of`.

    Raises:
        OSError: it cannot be written.
    """
    effects = disk.current()
    line = line_of(record)
    size = path.stat().st_size if path.exists() else 0
    if size == 0:  # also one that a crash left empty: its name may not be on the disk
        effects.write(path, b"")
        effects.flush_folder(path.parent)
    elif size != (sound := _sound_size(path, size)):
        effects.cut(path, sound)
    effects.append(path, line)
    effects.flush(path)


def iterate_records(path: Path) -> Iterator[dict[str, Json]]:
    """Go through all whole records, without `length` and `checksum`: a long log need not be in memory as a whole.

    Args:
        path: the log.

    Yields:
        The records, oldest first; none where there is no file.

    Raises:
        TooLarge: the file has more than `LOG_LIMIT` bytes.
        Damaged: a record before the last is not as it was written; those before it came already.
    """
    try:
        file = _open_log(path)
    except FileNotFoundError:
        return
    with file:
        yield from _records(file, path)


def _open_log(path: Path) -> BinaryIO:
    file = open_regular(path)
    if os.fstat(file.fileno()).st_size > LOG_LIMIT:
        file.close()
        raise TooLarge(path, LOG_LIMIT)
    return file


def records_in(data: bytes, path: Path) -> tuple[dict[str, Json], ...]:
    """All whole records of these bytes; `path` says where they come from, for people.

    Args:
        data: the bytes of a log.
        path: for messages.

    Returns:
        The records, oldest first.

    Raises:
        Damaged: one before the last is not as it was written.
    """
    return tuple(_records(io.BytesIO(data), path))


def first_in(data: bytes, path: Path) -> dict[str, Json] | None:
    """The first record of these bytes alone, None where there is none or only a torn one.

    Args:
        data: the bytes of a log.
        path: for messages.

    Returns:
        The record without `length` and `checksum`.

    Raises:
        Damaged: it is damaged, and others follow.
    """
    return next(_records(io.BytesIO(data), path), None)


def last_in(data: bytes, path: Path) -> dict[str, Json] | None:
    """The last record of these bytes alone, without a look at those before it; None where there is none or it is torn.

    Args:
        data: the bytes of a log.
        path: for messages.

    Returns:
        The record without `length` and `checksum`.
    """
    text = _text_of(data[last_line_at(data) :])
    return None if text is None else _object(path, 1, text)


def last_line_at(data: bytes) -> int:
    """Where the last line of a log begins.

    Args:
        data: the bytes of the log.

    Returns:
        The number of bytes before it.
    """
    return data.rfind(b"\n", 0, len(data) - 1) + 1 if data else 0


def _checksum(text: bytes) -> bytes:
    return hashlib.sha256(text).hexdigest().encode("ascii")


def _records(lines: Iterable[bytes], path: Path) -> Iterator[dict[str, Json]]:
    """The records of these lines, each with its end, up to a last one that is torn."""
    torn_at = 0
    for number, line in enumerate(lines, start=1):
        if torn_at:
            raise Damaged(path, torn_at, "the record is damaged: its length or checksum does not fit its text")
        text = _text_of(line)
        del line  # a long one need not be in memory twice
        if text is None:
            torn_at = number
        else:
            yield _object(path, number, text)


def _text_of(line: bytes) -> bytes | None:
    """The object's text without its seal, None where the line is not whole."""
    tail_at = max(0, len(line) - _SEAL_SPACE)
    found = _SEAL.search(line, tail_at)
    if found is None or found.end() != len(line):
        return None
    text = line[: found.start()] + b"}"
    whole = int(found[1]) == len(text) and found[2] == _checksum(text)
    return text if whole else None


def _object(path: Path, number: int, text: bytes) -> dict[str, Json]:
    data = parse_json(text.decode("ascii"))
    if not isinstance(data, dict):
        raise Damaged(path, number, "the record is no object")
    return data


def _sound_size(path: Path, size: int) -> int:
    """How many bytes the file has up to the end of its last whole record."""
    begin, last = _last_line(path, size)
    return begin if _text_of(last) is None else size


def _last_line(path: Path, size: int) -> tuple[int, bytes]:
    """Where the last line begins, and its bytes with the line end, if it has one; read from the end."""
    if not size:
        return 0, b""
    with _open_log(path) as file:
        start, tail = size, b""
        while start and b"\n" not in tail[:-1]:
            length = min(start, max(_CHUNK, len(tail)))
            start -= length
            file.seek(start, os.SEEK_SET)
            tail = file.read(length) + tail
    begin = tail[:-1].rfind(b"\n") + 1
    return start + begin, tail[begin:]
