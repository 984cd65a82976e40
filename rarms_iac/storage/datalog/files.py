"""Data logs as files: read whole, begun anew, or a setting longer."""

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TypeVar
from weakref import WeakValueDictionary

from rarms_iac.model.wording import quoted
from rarms_iac.storage.append import Damaged, Record, append, iterate_records, sealed_line
from rarms_iac.storage.codec import Json, NotDecodable, decode, encode
from rarms_iac.storage.datalog.columns import line_of, setting_in
from rarms_iac.storage.datalog.log import FORMAT, DataLog, Header, Recorded, Remeasurement
from rarms_iac.storage.disk import MEASUREMENTS, make_folders
from rarms_iac.storage.replace import replace

T = TypeVar("T")

REMEASUREMENT_FIELD = "pass"
"""The one field of a pass's record; of several records of a pass the last holds."""


class LogUnreadable(Exception):
    """The file is no whole data log; `message` tells why, `line` where."""

    def __init__(self, path: Path, line: int, message: str) -> None:
        super().__init__(f"{path}:{line}: {message}")
        self.path = path
        self.line = line
        self.message = message


def begin_log(path: Path, header: Header) -> None:
    """Make the file a log without settings, also where it was another; its folder is made. On return it is on the disk.

    Args:
        path: of the data log (`log_path`).
        header: what it was measured with.

    Raises:
        OSError: it cannot be written; what was there is still there.
    """
    make_folders(path.parent)
    line = encode(header)
    assert isinstance(line, dict)
    replace(path, sealed_line(line))


def append_remeasurement(path: Path, remeasurement: Remeasurement) -> None:
    """Add that a pass begins, or has ended, to a log that was begun. It is on the disk on return.

    Args:
        path: of the data log.
        remeasurement: its seed, and whether it has ended.

    Raises:
        LogUnreadable: the log is damaged.
        OSError: it cannot be written.
    """
    _append(path, {REMEASUREMENT_FIELD: encode(remeasurement)})


def append_setting(path: Path, recorded: Recorded) -> None:
    """Add a setting to a log that was begun. It is on the disk on return; a torn last line gives way.

    Args:
        path: of the data log.
        recorded: the setting, with all its samples.

    Raises:
        LogUnreadable: the log is damaged.
        OSError: it cannot be written.
    """
    _append(path, line_of(recorded))


def append_to_log(path: Path, value: object) -> None:
    """Add a value as a record; the log and its folder are made. It is on the disk on return.

    Args:
        path: of the log.
        value: a frozen value that `encode` turns into an object.

    Raises:
        LogUnreadable: the log is damaged.
        OSError: it cannot be written.
    """
    make_folders(path.parent)
    record = encode(value)
    assert isinstance(record, dict)
    _append(path, record)


def _append(path: Path, record: Record) -> None:
    try:
        append(path, record)
    except Damaged as damage:
        raise LogUnreadable(path, damage.line, damage.message) from None


def _numbered_records(path: Path) -> Iterator[tuple[int, dict[str, Json]]]:
    """The lines of a log with their records, without a last one that a crash tore; none where there is no file.

    Raises:
        LogUnreadable: the log is damaged, or no log.
        OSError: it cannot be read.
    """
    line = 0
    try:
        for line, record in enumerate(iterate_records(path), start=1):
            yield line, record
    except Damaged as damage:
        raise LogUnreadable(path, damage.line, damage.message) from None
    except NotDecodable as problem:
        raise LogUnreadable(path, line + 1, str(problem)) from None


def decoded_records(path: Path, decode_record: Callable[[dict[str, Json]], T]) -> tuple[T, ...]:
    """The values of a log's records, oldest first; none where there is no file.

    Args:
        path: of the log.
        decode_record: makes a value of a record, or raises `NotDecodable`.

    Returns:
        The values.

    Raises:
        LogUnreadable: the log is damaged, or holds something else.
        OSError: it cannot be read.
    """
    values: list[T] = []
    for line, record in _numbered_records(path):
        try:
            values.append(decode_record(record))
        except NotDecodable as problem:
            raise LogUnreadable(path, line, str(problem)) from None
    return tuple(values)


def read_log(path: Path) -> DataLog | None:
    """The log, without a last line that a crash tore; None where there is no file.

    As long as a process has the log, and the file is the same, it is not read again: a long one takes a second.

    Args:
        path: of the data log.

    Returns:
        Header, settings in the order of their lines, and remeasurements; the same object to every caller.

    Raises:
        LogUnreadable: it is damaged, of another version, or no data log.
        OSError: it cannot be read.
    """
    version = _version_of(path)
    log = None if version is None else _logs_in_use.get(version)
    if log is None:
        log = _read_log(path)
        if log is not None and version is not None and version == _version_of(path):
            _logs_in_use[version] = log
    return log


_logs_in_use: WeakValueDictionary[Hashable, DataLog] = WeakValueDictionary()


def _version_of(path: Path) -> Hashable | None:
    """What tells a file from every other, and from itself once it was written to; None: there is none."""
    try:
        status = path.stat()
    except (OSError, ValueError):
        return None  # reading it says why
    return (path.absolute(), status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns)


def _read_log(path: Path) -> DataLog | None:
    records = _numbered_records(path)
    _, first = next(records, (0, None))
    if first is None:
        return None
    header = _header(path, first)
    recorded: list[Recorded] = []
    remeasurements: dict[int, Remeasurement] = {}
    for line, record in records:
        try:
            if REMEASUREMENT_FIELD in record:
                remeasurement = _remeasurement_in(record)
                remeasurements[remeasurement.seed] = remeasurement
            else:
                recorded.append(_setting(record, header))
        except NotDecodable as problem:
            raise LogUnreadable(path, line, str(problem)) from None
    return DataLog(header=header, recorded=tuple(recorded), remeasurements=tuple(remeasurements.values()))


def _setting(record: Mapping[str, Json], header: Header) -> Recorded:
    recorded = setting_in(record)
    if (components := sorted(series.component for series in recorded.setting.series)) != sorted(header.setup.members):
        message = f"it is of {', '.join(components) or 'nothing'}, not of {', '.join(sorted(header.setup.members))}"
        raise NotDecodable("series", message)
    return recorded


def _remeasurement_in(record: Mapping[str, Json]) -> Remeasurement:
    if unknown := record.keys() - {REMEASUREMENT_FIELD}:
        raise NotDecodable(min(unknown), "there is no such field")
    return decode(Remeasurement, record[REMEASUREMENT_FIELD])


def _header(path: Path, record: dict[str, Json]) -> Header:
    version = record.get("format_version")
    if version != FORMAT:
        raise LogUnreadable(path, 1, f"it is of the format {quoted(version)}, and this rarms reads {FORMAT}")
    try:
        return decode(Header, record)
    except NotDecodable as problem:
        raise LogUnreadable(path, 1, str(problem)) from None


def log_path(folder: Path, platform: str, components: Iterable[str], interference: str) -> Path:
    """The data log of components that are in one partition, below the manifest's folder.

    Args:
        folder: the manifest's.
        platform: of the hosts that the log holds for.
        components: names, in any order.
        interference: the load's name.

    Returns:
        The path; whether there is such a file is not looked at.
    """
    return folder / MEASUREMENTS / platform / "+".join(sorted(components)) / f"{interference}.jsonl"


def configuration_path(folder: Path, platform: str, component: str) -> Path:
    """The configuration log of a component on a platform; no name has a dot, so it is no component's folder.

    Args:
        folder: the manifest's.
        platform: of the hosts.
        component: its name.

    Returns:
        The path; whether there is such a file is not looked at.
    """
    return folder / MEASUREMENTS / platform / f"{component}.configuration.jsonl"
