"""The files of a simulated host: the bytes of its content, and the journal beside it as JSON Lines."""

from collections.abc import Mapping
from pathlib import Path
from typing import cast

from rarms_iac.model.journal import Journal, JournalRecord, RunClosed, RunStarted, StepRecorded
from rarms_iac.storage.append import Record, append, line_of, read_first, read_last, read_records
from rarms_iac.storage.codec import NotDecodable, decode_union, encode
from rarms_iac.storage.reading import STATE_LIMIT, read_file
from rarms_iac.storage.replace import replace


def read_journal(path: Path) -> Journal | None:
    """The last run, None where there was none.

    Raises:
        Damaged: an earlier record is damaged.
        NotDecodable: the records are whole, and do not tell a run.
    """
    records = [_decode(number, data) for number, data in enumerate(read_records(path))]
    return run_of(records) if records else None


def read_unfinished(path: Path) -> Journal | None:
    """The run that is under way, None where there is none: one that was closed is known by its last record alone.

    Raises:
        Damaged, NotDecodable: as `read_journal`, where the last record closes no run.
    """
    last = read_last(path)
    if last is not None and last.get("kind") == "run_closed":
        return None
    journal = read_journal(path)
    return journal if journal is not None and journal.unfinished else None


def run_of(records: list[JournalRecord]) -> Journal:
    """The run that these records tell, in their order.

    Raises:
        NotDecodable: they do not tell one.
    """
    started, *rest = records
    closed = rest.pop() if rest and isinstance(rest[-1], RunClosed) else None
    if not isinstance(started, RunStarted):
        raise NotDecodable("record 1", "it does not start a run")
    steps = [record for record in rest if isinstance(record, StepRecorded)]
    if len(steps) != len(rest):
        raise NotDecodable("", "a run is started or closed in the middle of another")
    for record in steps:
        if not 0 <= record.number < len(started.steps):
            raise NotDecodable("", f"the run has no step {record.number}")
    return Journal(started=started, steps=tuple(steps), closed=closed if isinstance(closed, RunClosed) else None)


def read_serials(path: Path) -> Mapping[str, int]:
    """How many applies and undos there were, by application: the first record's word, without reading the run.

    Raises:
        Damaged: that record is damaged.
        NotDecodable: it does not start a run.
    """
    first = read_first(path)
    if first is None:
        return {}
    serials: Mapping[str, int] = decode_union(Mapping[str, int], first.get("serials"))
    return dict(sorted(serials.items()))


def start_journal(path: Path, started: RunStarted) -> None:
    """Replace the journal by one that begins with this record."""
    replace(path, line_of(_encode(started)))


def append_record(path: Path, record: JournalRecord) -> None:
    """Add the record durably."""
    append(path, _encode(record))


def _encode(record: JournalRecord) -> Record:
    return cast("Record", encode(record))


def _decode(number: int, data: object) -> JournalRecord:
    try:
        record: JournalRecord = decode_union(JournalRecord, data)
    except NotDecodable as problem:
        raise NotDecodable(f"record {number + 1}", str(problem)) from None
    return record


def fetch(path: Path) -> bytes | None:
    """The file's bytes, None where there is no file: an empty machine.

    Raises:
        OSError: it cannot be read.
    """
    try:
        return read_file(path, STATE_LIMIT)
    except FileNotFoundError:
        return None
