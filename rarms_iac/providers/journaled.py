"""Lock and journal of a host that rarms changes step by step: two files, the journal as JSON Lines."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TypeVar, cast

from rarms_iac.diff.readings import resolve
from rarms_iac.model.commands import PLAN, prose
from rarms_iac.model.journal import Journal, JournalRecord, RunClosed, RunStarted, StepRecorded
from rarms_iac.model.operations import CreatePartition, RestorePartition
from rarms_iac.model.plan import Scope, wrong_name
from rarms_iac.model.state import Partition, State
from rarms_iac.providers.interface import HostDamaged, HostFailed, HostLocked, HostRefused
from rarms_iac.storage.codec import NotDecodable, decode, decode_union, encode
from rarms_iac.storage.disk import advice_on, make_folder_for
from rarms_iac.storage.reading import STATE_LIMIT, read_file
from rarms_iac.storage.records import Damaged, Record, first_in, last_in, records_in, sealed_line
from rarms_iac.storage.writing import Locked, append, hold, read_holder, replace
from rarms_iac.texts.messages import quoted, reason_of

T = TypeVar("T")
PLAN_AGAIN = prose("Check the host again: ", PLAN, ".")


class LocalFiles:
    """The files that rarms keeps on a host. What raises OSError passes on its answer."""

    def content(self, path: Path) -> bytes | None:
        """Return the bytes of a file; None: there is none."""
        try:
            return read_file(path, STATE_LIMIT)
        except FileNotFoundError:
            return None

    def replace(self, path: Path, data: bytes) -> None:
        """Make a file exactly these bytes, durably, in a folder that is made."""
        make_folder_for(path)
        replace(path, data)

    def append(self, path: Path, record: Record) -> None:
        """Add a record to a log, durably, in a folder that is made."""
        make_folder_for(path)
        append(path, record)

    @contextmanager
    def hold(self, lock: Path, owner: str, timeout_ms: int) -> Iterator[None]:
        """Hold the host while the context lasts, at most until this process ends. Raises Locked."""
        make_folder_for(lock)
        with hold(lock, owner, timeout_ms):
            yield

    def holder(self, lock: Path) -> str:
        """Return the owner of the run that holds the host now; empty: none that can be seen from here."""
        return read_holder(lock)


class JournaledHost:
    """The part of a `StepwiseHost` that lies in files: its lock, its journal, and what is said where they fail."""

    def __init__(self, name: str, journal: Path, lock: Path, files: LocalFiles) -> None:
        self._name = name
        self._journal_path = journal
        self._lock_path = lock
        self._files = files

    @property
    def name(self) -> str:
        return self._name

    @contextmanager
    def lock(self, owner: str, timeout_ms: int = 0) -> Iterator[None]:
        """Hold the host, and remove what killed writers left."""
        self._refuse_files_of_others()
        with ExitStack() as held:
            with report_failure(self.name, self._lock_path):
                held.enter_context(self._files.hold(self._lock_path, owner, timeout_ms))
                self._recover()
            yield

    def look_once(self) -> None:
        """Do nothing: a look at files is cheap."""

    def holder(self) -> str:
        return self._files.holder(self._lock_path)

    def _refuse_files_of_others(self) -> None:
        """Raise `HostDamaged` where another user may have written the files."""

    def _recover(self) -> None:
        """Bring in order what a killed run left, now that the host is held."""

    def journal(self) -> Journal | None:
        self._refuse_files_of_others()
        with report_damage(self.name, self._journal_path):
            return journal_in(self._files.content(self._journal_path), self._journal_path)

    def unfinished(self) -> Journal | None:
        self._refuse_files_of_others()
        with report_damage(self.name, self._journal_path):
            return unfinished_in(self._files.content(self._journal_path), self._journal_path)

    def start_run(self, started: RunStarted) -> None:
        with report_failure(self.name, self._journal_path):
            self._files.replace(self._journal_path, sealed_line(_encode(started)))

    def record(self, record: JournalRecord) -> None:
        with report_damage(self.name, self._journal_path), report_failure(self.name, self._journal_path):
            self._files.append(self._journal_path, _encode(record))

    def managed(self, state: State, partition: str, scope: Scope, machine: str = "") -> Partition:
        """Return the one partition that a name stands for.

        Raises:
            HostRefused: none or several do: the host differs from what the plan saw.
        """
        found = resolve(state.partitions, partition, scope, machine)
        if len(found) != 1:
            count = f"{len(found)} machines are" if found else "no machine is"
            raise HostRefused(self.name, f"{count} managed as the partition {partition}", PLAN_AGAIN)
        return found[0]

    def refuse_repeated(self, state: State, operation: CreatePartition | RestorePartition, scope: Scope) -> None:
        """Refuse to make a partition that is there, or one of the id of another machine."""
        machine = operation.machine if isinstance(operation, RestorePartition) else None
        is_taken = any(partition.id == machine for partition in state.partitions)
        if is_taken or resolve(state.partitions, operation.partition, scope):
            raise HostRefused(self.name, f"a partition {operation.partition} already exists", PLAN_AGAIN)

    def _serials(self) -> Mapping[str, int]:
        with report_damage(self.name, self._journal_path):
            return _serials_in(self._files.content(self._journal_path), self._journal_path)


@contextmanager
def report_damage(host: str, path: Path) -> Iterator[None]:
    """Raise `HostDamaged` where a host's file (`path`) is damaged, `HostFailed` where it cannot be read."""
    advice = f"Restore {path} from a copy, or move it away to continue without it."
    try:
        yield
    except Damaged as problem:
        raise HostDamaged(host, f"{path.name} is damaged in line {problem.line}: {problem.message}", advice) from None
    except NotDecodable as problem:
        raise HostDamaged(host, f"{path.name} is damaged: {problem}", advice) from None
    except OSError as problem:
        message = f"{path.name} cannot be read: {reason_of(problem)}"
        raise HostFailed(host, message, advice_on(problem, advice)) from None


@contextmanager
def report_failure(host: str, path: Path) -> Iterator[None]:
    """Raise `HostLocked` where another run holds the host, `HostFailed` where its file cannot be written."""
    try:
        yield
    except Locked as locked:
        raise HostLocked(host, locked.owner) from None
    except OSError as problem:
        message = f"{path} cannot be written: {reason_of(problem)}"
        raise HostFailed(host, message, advice_on(problem, "Check its disk, which may be full or damaged.")) from None


def journal_in(data: bytes | None, path: Path) -> Journal | None:
    """Return the last run in the bytes of a journal, None where there was none; `path` is for messages.

    Raises:
        Damaged: a record is not as it was written.
        NotDecodable: the records are whole, and do not tell a run.
    """
    if data is None:
        return None
    started, steps, closed = split_run(records_in(data, path))
    run = Journal(started=_decode(RunStarted, 1, started), steps=steps, closed=closed)
    _check(run)
    return run


def unfinished_in(data: bytes | None, path: Path) -> Journal | None:
    """Return the run that is under way, or None.

    Of one that was closed only the last record is known.

    Raises:
        Damaged, NotDecodable: as `journal_in`, where the last record closes no run.
    """
    last = None if data is None else last_in(data, path)
    if last is not None and last.get("kind") == "run_closed":
        return None
    journal = journal_in(data, path)
    return journal if journal is not None and journal.unfinished else None


def split_run(records: Sequence[Record]) -> tuple[Record, tuple[StepRecorded, ...], RunClosed | None]:
    """Return the record that starts a run, and those of its steps and its end.

    Raises:
        NotDecodable: a later record is another one.
    """
    started, *rest = records
    is_closed = bool(rest) and rest[-1].get("kind") == "run_closed"
    steps = rest[:-1] if is_closed else rest
    found = tuple(_decode(StepRecorded, number, record) for number, record in enumerate(steps, 2))
    return started, found, _decode(RunClosed, len(records), rest[-1]) if is_closed else None


def _check(run: Journal) -> None:
    started = run.started
    parts = (started.host_plan, dataclasses.replace(started.host_plan, steps=started.steps))
    if name := next(filter(None, map(wrong_name, parts)), None):
        raise NotDecodable("record 1", f"{quoted(name)} is not a valid name in a manifest")
    for record in run.steps:
        if not 0 <= record.number < len(started.steps):
            raise NotDecodable("", f"the run has no step {record.number}")


def _serials_in(data: bytes | None, path: Path) -> Mapping[str, int]:
    """Return the number of applies and undos by application, which the first record has.

    Raises:
        Damaged: that record is damaged.
        NotDecodable: it does not start a run.
    """
    if data is None:
        return {}
    serials: Mapping[str, int] = decode_union(Mapping[str, int], first_in(data, path).get("serials"))
    return dict(sorted(serials.items()))


def _encode(record: JournalRecord) -> Record:
    return cast("Record", encode(record))


def _decode(kind: type[T], number: int, record: Record) -> T:
    try:
        return decode(kind, record)
    except NotDecodable as problem:
        raise NotDecodable(f"record {number}", str(problem)) from None
