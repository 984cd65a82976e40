"""Logs below `measurements/` as files: read whole, or some records longer.

A data log has headers, and each other record names the digest of its own. So two branches that both measured are merged
by keeping the lines of both, in any order.
"""

from collections.abc import Callable, Hashable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TypeVar
from weakref import WeakValueDictionary

from rarms_iac.storage.codec import Json, NotDecodable, decode, encode, in_range, sample_numbers
from rarms_iac.storage.datalog.identity import header_digest
from rarms_iac.storage.datalog.log import FORMAT, Header, LogFile, LogRecord, Recorded, Remeasurement, as_recorded
from rarms_iac.storage.disk import MEASUREMENTS, make_folders
from rarms_iac.storage.records import Damaged, LogLine, iterate_log, sealed_line
from rarms_iac.storage.writing import append_lines
from rarms_iac.texts.messages import quoted

T = TypeVar("T")

CONFIGURATION, TUNING = ".configuration.jsonl", "tuning.jsonl"
"""Names of the logs of decisions: the end of a component's, and that of a platform."""


class LogUnreadable(Exception):
    """The file is not a whole log; `message` gives the reason, `line` the place."""

    def __init__(self, path: Path, line: int, message: str, *, is_conflict: bool = False) -> None:
        super().__init__(f"{path}:{line}: {message}")
        self.path = path
        self.line = line
        self.message = message
        self.is_conflict = is_conflict  # git left the marks of a merge conflict there


def append_remeasurement(path: Path, header: Header, remeasurement: Remeasurement) -> None:
    """Add that a pass begins; as `append_setting`."""
    _append_below(path, header, remeasurement)


def end_remeasurement(path: Path, remeasurement: Remeasurement) -> None:
    """Add that a pass has ended to the log in which it began.

    Raises:
        LogUnreadable: the log is damaged.
        OSError: it cannot be written.
    """
    file = read_log(path)
    assert file is not None, "it began there"
    header = next(digest for digest, begun in file.remeasurements if begun == remeasurement)
    _append_below(path, file.headers[header], replace(remeasurement, ended=True))


def append_setting(path: Path, header: Header, recorded: Recorded) -> None:
    """Add a setting to a data log, and its header where the log lacks it; the log and its folder are made.

    It is on the disk on return; a torn last line gives way.

    Args:
        header: the conditions that it was measured under.
        recorded: the setting, with all its samples.

    Raises:
        LogUnreadable: the log is damaged.
        OSError: it cannot be written.
    """
    _append_below(path, header, replace(recorded, setting=as_recorded(recorded.setting)))


def _append_below(path: Path, header: Header, record: Recorded | Remeasurement) -> None:
    file = read_log(path)
    if file is None or header.digest not in file.headers:
        append_to_log(path, header)
    append_to_log(path, LogRecord(header=header.digest, record=record))


def append_to_log(path: Path, value: object) -> None:
    """Add a value as a record; the log and its folder are made. It is on the disk on return.

    Args:
        value: a frozen value that `encode` turns into an object.

    Raises:
        LogUnreadable: the log is damaged.
        OSError: it cannot be written.
    """
    make_folders(path.parent)
    record = encode(value)
    assert isinstance(record, dict)
    with log_errors():
        append_lines(path, sealed_line(record), in_git=True)


@contextmanager
def log_errors() -> Iterator[None]:
    """Turn damage of a log into `LogUnreadable`.

    Yields:
        Once, with nothing.

    Raises:
        LogUnreadable: a log is damaged.
    """
    try:
        yield
    except Damaged as damage:
        raise LogUnreadable(damage.path, damage.line, damage.message, is_conflict=damage.is_conflict) from None


def decoded_records(
    lines: Iterable[LogLine], path: Path, decode_record: Callable[[dict[str, Json]], T]
) -> tuple[T, ...]:
    """Return the values of a log's records, in the order of their lines.

    Args:
        lines: of the log (`iterate_log`, `log_lines`).
        decode_record: makes a value of a record, or raises `NotDecodable`.

    Raises:
        LogUnreadable: the log is damaged, or holds something else.
        OSError: it cannot be read.
    """
    return tuple(value for _, value in _numbered_values(lines, path, decode_record))


def _numbered_values(
    lines: Iterable[LogLine], path: Path, decode_record: Callable[[dict[str, Json]], T]
) -> Iterator[tuple[int, T]]:
    with log_errors():
        for line in lines:
            try:
                value = decode_record(line.record(path))
            except NotDecodable as problem:
                raise LogUnreadable(path, line.number, str(problem)) from None
            yield line.number, value


def read_log(path: Path) -> LogFile | None:
    """Read a data log, without a last line that a crash tore; None without a file.

    As long as a process has the log, and the file is the same, it is not read again: a long one takes a second.

    Returns:
        Headers, settings in the order of their lines, and remeasurements; the same object to every caller.

    Raises:
        LogUnreadable: it is damaged, of another version, or no data log.
        OSError: it cannot be read.
    """
    version = _version_of(path)
    log = None if version is None else _logs_in_use.get(version)
    if log is None:
        log = log_in(iterate_log(path), path)
        if version is not None and version == _version_of(path):
            _logs_in_use[version] = log
    return log if log.headers else None


_logs_in_use: WeakValueDictionary[Hashable, LogFile] = WeakValueDictionary()


def _version_of(path: Path) -> Hashable | None:
    """Return the version of a file, which differs from every other's and changes with each write; None: no file."""
    try:
        status = path.stat()
    except (OSError, ValueError):
        return None  # reading it says why
    return (path.absolute(), status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns)


def log_in(lines: Iterable[LogLine], path: Path) -> LogFile:
    """Return the data log that lines are.

    A header may stand behind its records, where two branches were merged by hand.

    Args:
        lines: of the log (`iterate_log`, `log_lines`); none: no header.

    Raises:
        LogUnreadable: it is damaged, of another version, or no data log.
        OSError: it cannot be read.
    """
    headers: dict[str, Header] = {}
    below: list[tuple[int, LogRecord]] = []
    for number, value in _numbered_values(lines, path, _value_in):
        if isinstance(value, Header):
            headers.setdefault(value.digest, value)
        else:
            below.append((number, value))
    recorded: list[tuple[str, Recorded]] = []
    remeasurements: dict[tuple[str, int, str], Remeasurement] = {}
    for number, value in below:
        if value.header not in headers:
            raise LogUnreadable(path, number, f"the log refers to the missing header {quoted(value.header)}")
        match value.record:
            case Recorded() as record:
                _check_members(record, headers[value.header], path, number)
                recorded.append((value.header, record))
            case Remeasurement() as remeasurement:
                key = (value.header, remeasurement.seed, remeasurement.begun)
                known = remeasurements.get(key, remeasurement)
                remeasurements[key] = replace(remeasurement, ended=remeasurement.ended or known.ended)
    return LogFile(
        headers=headers,
        recorded=tuple(recorded),
        remeasurements=tuple((header, each) for (header, _, _), each in remeasurements.items()),
    )


def _value_in(record: dict[str, Json]) -> Header | LogRecord:
    if "format_version" in record:
        return _header(record)
    value = decode(LogRecord, record)
    if isinstance(value.record, Recorded):
        in_range(value.record.setting.reserve, (1, 100), "reserve")  # a run without a reservation is never recorded
        for series in value.record.setting.series:
            sample_numbers((*series.starts, *series.runs), len(series.samples), f"series of {series.component}")
    return value


def _check_members(recorded: Recorded, header: Header, path: Path, line: int) -> None:
    components = sorted(series.component for series in recorded.setting.series)
    members = sorted(header.setup.members)
    if components != members:
        message = f"series: it has the components {', '.join(components) or 'none'} instead of {', '.join(members)}"
        raise LogUnreadable(path, line, message)


def _header(record: dict[str, Json]) -> Header:
    version = record["format_version"]
    if version != FORMAT:
        raise NotDecodable("format_version", f"it is {quoted(version)}; this rarms reads {FORMAT}")
    header = decode(Header, record)
    if header.digest != header_digest(header):
        raise NotDecodable("digest", "it is not the digest of this header")
    return header


def log_path(folder: Path, platform: str, components: Iterable[str], interference: str) -> Path:
    """Return the data log of components that are in one partition, below the manifest's folder.

    Returns:
        The path; whether there is such a file is not looked at.
    """
    return folder / MEASUREMENTS / platform / "+".join(sorted(components)) / f"{interference}.jsonl"


def configuration_path(folder: Path, platform: str, component: str) -> Path:
    """Return the configuration log of a component on a platform.

    No component's folder has this name, because no name has a dot.

    Returns:
        The path; whether there is such a file is not looked at.
    """
    return folder / MEASUREMENTS / platform / f"{component}{CONFIGURATION}"
