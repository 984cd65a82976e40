"""Adds the data logs of a robot to the data logs here.

A robot's answer is not trusted. It may have logs of its own platform only, and their size is limited. All of them are
read and checked before one is added. Begin at `add_measurements`.
"""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path

from rarms_iac.app.measurement_files import MOMENT_MS, hold_configuration_logs, hold_data_log, log_errors
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.model.wording import quoted
from rarms_iac.planner.planning_findings import UNREADABLE
from rarms_iac.storage.datalog.files import LogUnreadable
from rarms_iac.storage.datalog.merging import MOST_BYTES, is_log, merge_records, new_records
from rarms_iac.storage.disk import MEASUREMENTS

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
        with _held(folder, name), log_errors():
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


def _held(folder: Path, name: str) -> AbstractContextManager[None]:
    path = folder / MEASUREMENTS / name
    is_data_log = name.count("/") > 1
    return hold_data_log(folder, path, MOMENT_MS) if is_data_log else hold_configuration_logs(folder)


def _refused(file: str, reason: str, line: int | None = None) -> UseCaseError:
    template = "The robot's {file}, line {line}: {reason}." if line else "The robot's {file}: {reason}."
    advice = "No record was added here. Repair or remove the file on the robot."
    return UseCaseError(
        Outcome.NEGATIVE, [UNREADABLE.at(None, template, advice, file=file, reason=reason, line=line or 0)]
    )
