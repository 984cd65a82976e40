"""Lock and journal of a host that rarms changes step by step: two files, the journal as JSON Lines."""

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import cast

from rarms_iac.model.journal import Journal, JournalRecord, RunClosed, RunStarted, StepRecorded
from rarms_iac.providers.interface import HostDamaged, HostFailed, HostLocked
from rarms_iac.storage.append import Damaged, Record, append, line_of, read_first, read_last, read_records
from rarms_iac.storage.codec import NotDecodable, decode_union, encode
from rarms_iac.storage.disk import make_room
from rarms_iac.storage.lock import Locked, hold
from rarms_iac.storage.reading import STATE_LIMIT, read_file
from rarms_iac.storage.replace import remove_leftovers, replace


class JournaledHost:
    """The part of a `StepwiseHost` that lies in files: its lock, its journal, and what is said where they fail."""

    def __init__(self, name: str, journal: Path, lock: Path) -> None:
        self._name = name
        self._journal_path = journal
        self._lock_path = lock

    @property
    def name(self) -> str:
        """See the interface."""
        return self._name

    @contextmanager
    def lock(self, owner: str, timeout_ms: int = 0) -> Iterator[None]:
        """See the interface; also removes what killed writers left behind."""
        with ExitStack() as held:
            with self._report_failure(self._lock_path):
                make_room(self._lock_path)
                held.enter_context(hold(self._lock_path, owner, timeout_ms))
                remove_leftovers(self._journal_path)
                self._recover()
            yield

    def _recover(self) -> None:
        """Bring in order what a killed run left, now that the host is held."""

    def journal(self) -> Journal | None:
        """See the interface."""
        with self._report_damage(self._journal_path):
            return read_journal(self._journal_path)

    def unfinished(self) -> Journal | None:
        """See the interface."""
        with self._report_damage(self._journal_path):
            return read_unfinished(self._journal_path)

    def start_run(self, started: RunStarted) -> None:
        """See the interface."""
        with self._report_failure(self._journal_path):
            make_room(self._journal_path)
            start_journal(self._journal_path, started)

    def record(self, record: JournalRecord) -> None:
        """See the interface."""
        with self._report_failure(self._journal_path):
            append_record(self._journal_path, record)

    def _serials(self) -> Mapping[str, int]:
        with self._report_damage(self._journal_path):
            return read_serials(self._journal_path)

    @contextmanager
    def _report_damage(self, path: Path) -> Iterator[None]:
        advice = f"Restore {path} from a copy, or move it away to go on without it."
        try:
            yield
        except Damaged as problem:
            raise HostDamaged(
                self.name, f"{path.name} is damaged in line {problem.line}: {problem.message}", advice
            ) from None
        except NotDecodable as problem:
            raise HostDamaged(self.name, f"{path.name} is damaged: {problem}", advice) from None
        except OSError as problem:
            raise HostDamaged(self.name, f"{path.name} cannot be read: {problem.strerror or problem}", advice) from None

    @contextmanager
    def _report_failure(self, path: Path) -> Iterator[None]:
        try:
            yield
        except Locked as locked:
            raise HostLocked(self.name, locked.owner) from None
        except OSError as problem:
            raise HostFailed(
                self.name, f"{path} cannot be written: {problem.strerror or problem}", "Make room, or mend its rights."
            ) from None


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
    replace(path, record_line(started))


def record_line(record: JournalRecord) -> bytes:
    """Return the record as its line of the journal."""
    return line_of(_encode(record))


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
    """The file's bytes, None where there is no file.

    Raises:
        OSError: it cannot be read.
    """
    try:
        return read_file(path, STATE_LIMIT)
    except FileNotFoundError:
        return None
