"""The snapshot of a host as a file: `rarms plan --snapshot FILE` then needs no host."""

from typing import ClassVar

from rarms_iac.model.state import State
from rarms_iac.storage.codec import NotDecodable, decode, encode
from rarms_iac.storage.json_text import parse_json, readable_json
from rarms_iac.texts.findings import NOT_READ, Finding
from rarms_iac.texts.messages import quoted

FORMAT = "rarms-snapshot/1"
MAX_BYTES = 64 * 2**20


class SnapshotUnreadable(Exception):
    """The file does not say what a host looks like; `message` has the reason."""

    finding: ClassVar[Finding] = NOT_READ

    def __init__(self, message: str) -> None:
        super().__init__(message)
        self.message = message


def write_snapshot(state: State) -> bytes:
    """Return the state as JSON that a person can read and git can compare.

    Returns:
        UTF-8 with LF; what no encoding has is escaped.
    """
    document = {"format_version": FORMAT, "state": encode(state)}
    return readable_json(document)


def read_snapshot(data: bytes) -> State:
    """Return the state that a snapshot says.

    Returns:
        The state; it says of what could not be looked at that it is not known.

    Raises:
        SnapshotUnreadable: it is not a snapshot, or one of another version.
    """
    try:
        document = parse_json(data.decode("utf-8-sig"))
    except ValueError as error:
        reason = error.message if isinstance(error, NotDecodable) else f"it is not JSON ({error})"
        raise SnapshotUnreadable(reason) from error
    if not isinstance(document, dict) or "format_version" not in document:
        raise SnapshotUnreadable("it has no `format_version`")
    if document["format_version"] != FORMAT:
        raise SnapshotUnreadable(f"its format is {quoted(document['format_version'])}; this rarms reads {FORMAT}")
    try:
        return decode(State, document.get("state"))
    except NotDecodable as error:
        raise SnapshotUnreadable(str(error)) from error
