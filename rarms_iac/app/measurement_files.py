"""Files below `measurements/`: who may write to them now, what is said of a damaged one, and those that a robot sends.

Hosts of one platform share these files, and each host has a measurer of its own. A robot's answer is not trusted: it
may have logs of its own platform only, their size is limited, and all are read and checked before one is added.
"""

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.applying.refusals import LOCKED
from rarms_iac.model.commands import Prose, Wording, prose
from rarms_iac.planner.planning_findings import UNREADABLE
from rarms_iac.storage.datalog.files import LogUnreadable
from rarms_iac.storage.datalog.merging import MOST_BYTES, is_log, merge_records, new_records
from rarms_iac.storage.disk import MEASUREMENTS, PRIVATE, make_folder_for
from rarms_iac.storage.writing import Locked, hold, owner, remove_leftovers
from rarms_iac.texts.messages import quoted

LOCKS = "locks"
CHOICES = "configuration"
MOMENT_MS = 10_000
"""How long a command waits for another that writes down what was chosen or proven: that takes no time."""


@contextmanager
def hold_data_log(folder: Path, path: Path, timeout_ms: int) -> Iterator[None]:
    """Hold a data log, and remove what killed writers left next to it.

    Args:
        path: Of the log, below `measurements/` in it.
        timeout_ms: How long to wait for another run.

    Yields:
        Once, with the log held.

    Raises:
        UseCaseError: The host is held by another run (refused).
    """
    with _held(folder, path.relative_to(folder / MEASUREMENTS).as_posix(), timeout_ms):
        remove_leftovers(path)
        yield


@contextmanager
def hold_configuration_logs(folder: Path) -> Iterator[None]:
    """Hold the configuration logs of a manifest's folder for as long as it takes to add to them.

    Yields:
        Once, with the logs held.

    Raises:
        UseCaseError: Another run does not let go of them (refused).
    """
    with _held(folder, CHOICES, MOMENT_MS):
        yield


@contextmanager
def _held(folder: Path, name: str, timeout_ms: int) -> Iterator[None]:
    lock = folder / PRIVATE / LOCKS / f"{name}.lock"
    make_folder_for(lock)
    with ExitStack() as held:
        try:
            held.enter_context(hold(lock, owner(), timeout_ms))
        except Locked as problem:
            advice = "Wait until that run ends, or let rarms wait: `--lock-timeout 60s`. Results so far are saved."
            log = f"{MEASUREMENTS}/{name}"
            refusal = LOCKED.at(None, "{owner} writes to {log}.", advice, log=log, owner=problem.owner)
            raise UseCaseError(Outcome.REFUSED, [refusal]) from None
        yield


def now(precision: Literal["seconds", "microseconds"] = "seconds") -> str:
    """Return the time now in UTC, as `2026-01-31T12:00:00Z`.

    Args:
        precision: Microseconds tell two equal records of a log apart: of equal ones, its reader keeps the first.
    """
    return datetime.now(UTC).replace(tzinfo=None).isoformat(timespec=precision) + "Z"


def unreadable_advice(problem: LogUnreadable, otherwise: Wording) -> Prose:
    """Say what to do about a log that cannot be read.

    Args:
        otherwise: What to do where git does not have it, without a full stop.
    """
    if problem.is_conflict:
        return prose(
            "Delete the lines that begin with <<<<<<<, |||||||, ======= or >>>>>>>, and keep all others: "
            "the results of both branches are valid. With `measurements/**/*.jsonl merge=union` in "
            ".gitattributes, git does this automatically."
        )
    return prose("Restore the log from git, or ", otherwise, ".")


@contextmanager
def log_errors() -> Iterator[None]:
    """End the use case if a log below `measurements/` is damaged.

    Yields:
        Once, with nothing.

    Raises:
        UseCaseError: One is damaged (negative).
    """
    try:
        yield
    except LogUnreadable as problem:
        advice = unreadable_advice(problem, "remove it; rarms then measures or writes its records again")
        file = problem.path.as_posix()
        refusal = UNREADABLE.at(
            None, "{file}, line {line}: {reason}.", advice, file=file, line=problem.line, reason=problem.message
        )
        raise UseCaseError(Outcome.NEGATIVE, [refusal]) from None


_SHOWN = 80
"""Largest number of characters of a file's name in a message."""


def add_measurements(folder: Path, platform: str, logs: Mapping[str, bytes]) -> tuple[str, ...]:
    """Add the records of a robot's logs that are missing in the logs here.

    Args:
        logs: The bytes of each log, by its path below `measurements/`, as the robot sent them.

    Returns:
        Paths of the logs that changed here, below `measurements/`, sorted.

    Raises:
        UseCaseError: A log of the robot or here cannot be read, the robot sent something else than logs of its
            platform, or more than `MOST_BYTES`, so that nothing was added (negative); another run writes to one
            (refused).
        OSError: A log here cannot be written.
    """
    if sum(map(len, logs.values())) > MOST_BYTES:
        raise _refused(MEASUREMENTS, f"they have more than {MOST_BYTES:,} bytes")
    for name, came in sorted(logs.items()):
        if not (name.startswith(f"{platform}/") and is_log(name)):
            raise _refused(quoted(name, _SHOWN), f"it is not a log of {platform}")
        _check(folder, name, came)
    added = []
    for name, came in sorted(logs.items()):
        with _holding(folder, name), log_errors():
            if merge_records(folder, name, came):
                added.append(name)
    return tuple(added)


def _check(folder: Path, name: str, came: bytes) -> None:
    with log_errors():
        try:
            new_records(folder, name, came)
        except LogUnreadable as problem:
            if problem.path != Path(name):
                raise  # the log here
            raise _refused(f"{MEASUREMENTS}/{name}", problem.message, problem.line) from None


def _holding(folder: Path, name: str) -> AbstractContextManager[None]:
    path = folder / MEASUREMENTS / name
    is_data_log = name.count("/") > 1
    return hold_data_log(folder, path, MOMENT_MS) if is_data_log else hold_configuration_logs(folder)


def _refused(file: str, reason: str, line: int | None = None) -> UseCaseError:
    template = "The robot's {file}, line {line}: {reason}." if line else "The robot's {file}: {reason}."
    advice = "No record was copied. Repair or remove the file on the robot."
    return UseCaseError(
        Outcome.NEGATIVE, [UNREADABLE.at(None, template, advice, file=file, reason=reason, line=line or 0)]
    )
