"""Data logs as files: read whole, begun anew, or a setting longer."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TypeVar

from rarms_iac.model.wording import quoted
from rarms_iac.storage.append import Damaged, append, read_records
from rarms_iac.storage.append import line_of as sealed_line
from rarms_iac.storage.codec import Json, NotDecodable, decode, encode
from rarms_iac.storage.datalog.columns import line_of, setting_in
from rarms_iac.storage.datalog.log import FORMAT, DataLog, Header, Recorded, Remeasurement
from rarms_iac.storage.replace import replace

T = TypeVar("T")

REMEASUREMENT_FIELD = "pass"
"""The one field of a pass's record; of several records of a pass the last holds."""


class LogUnreadable(Exception):
    """The file is no whole data log; `says` tells why and where."""

    def __init__(self, path: Path, line: int, message: str) -> None:
        super().__init__(f"{path}:{line}: {message}")
        self.path = path
        self.line = line
        self.message = message


def begin_log(path: Path, header: Header) -> None:
    """Make the file a log without settings, whatever it was; its folder is made. It is on the disk on return.

    Raises:
        OSError: it cannot be written; what was there is still there.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    line = encode(header)
    assert isinstance(line, dict)
    replace(path, sealed_line(line))


def append_remeasurement(path: Path, remeasurement: Remeasurement) -> None:
    """Add that a pass begins, or has ended, to a log that was begun. It is on the disk on return.

    Raises:
        OSError: it cannot be written.
    """
    append(path, {REMEASUREMENT_FIELD: encode(remeasurement)})


def append_setting(path: Path, recorded: Recorded) -> None:
    """Add a setting to a log that was begun. It is on the disk on return; a torn last line gives way.

    Raises:
        OSError: it cannot be written.
    """
    append(path, line_of(recorded))


def append_to_log(path: Path, value: object) -> None:
    """Add a value as a record; the log and its folder are made. It is on the disk on return.

    Raises:
        OSError: it cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    record = encode(value)
    assert isinstance(record, dict)
    append(path, record)


def whole_records(path: Path) -> tuple[dict[str, Json], ...]:
    """The records of a log, without a last one that a crash tore; none where there is no file.

    Raises:
        LogUnreadable: the log is damaged, or no log.
        OSError: it cannot be read.
    """
    try:
        return read_records(path)
    except Damaged as damage:
        raise LogUnreadable(path, damage.line, damage.message) from None
    except NotDecodable as problem:
        raise LogUnreadable(path, 1, str(problem)) from None


def decoded_records(path: Path, decode_record: Callable[[dict[str, Json]], T]) -> tuple[T, ...]:
    """The values of a log's records, oldest first; none where there is no file.

    Raises:
        LogUnreadable: the log is damaged, or holds something else.
        OSError: it cannot be read.
    """
    values: list[T] = []
    for line, record in enumerate(whole_records(path), start=1):
        try:
            values.append(decode_record(record))
        except NotDecodable as problem:
            raise LogUnreadable(path, line, str(problem)) from None
    return tuple(values)


def read_log(path: Path) -> DataLog | None:
    """The log, without a last line that a crash tore; None where there is no file, or one without a whole header.

    Raises:
        LogUnreadable: it is damaged, of another version, or no data log.
        OSError: it cannot be read.
    """
    records = whole_records(path)
    if not records:
        return None
    first, *rest = records
    header = _header(path, first)
    recorded: list[Recorded] = []
    remeasurements: dict[int, Remeasurement] = {}
    for line, record in enumerate(rest, start=2):
        try:
            if REMEASUREMENT_FIELD in record:
                remeasurement = _remeasurement_in(record)
                remeasurements[remeasurement.seed] = remeasurement
            else:
                recorded.append(setting_in(record))
        except NotDecodable as problem:
            raise LogUnreadable(path, line, str(problem)) from None
    return DataLog(header=header, recorded=tuple(recorded), remeasurements=tuple(remeasurements.values()))


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


FOLDER = "measurements"


def log_path(folder: Path, platform: str, components: Iterable[str], interference: str) -> Path:
    """The data log of components that are in one partition, below the manifest's folder."""
    return folder / FOLDER / platform / joined(components) / f"{interference}.jsonl"


def configuration_path(folder: Path, platform: str, component: str) -> Path:
    """The configuration log of a component on a platform; no name has a dot, so it is nobody's folder."""
    return folder / FOLDER / platform / f"{component}.configuration.jsonl"


def joined(components: Iterable[str]) -> str:
    """Components of one partition as one name: `path-planning+video-streaming`, in name order."""
    return "+".join(sorted(components))
