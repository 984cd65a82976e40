"""The lines that a running script writes, as events (docs/scripts.md). Pure, and strict: anything else is noise."""

from rarms_iac.providers.interface import RunEvent
from rarms_iac.storage.codec import NotDecodable, decode
from rarms_iac.storage.digest import parse_json

FORMAT = "rarms-event/1"

LONGEST = 100_000
"""Characters of a line that is looked at; a script's own are far shorter."""


def read_event(line: str) -> RunEvent | None:
    """The event that a line is, None where it is none of this format."""
    if len(line) > LONGEST or not line.startswith("{"):
        return None
    try:
        document = parse_json(line)
        if not isinstance(document, dict) or document.pop("format", None) != FORMAT:
            return None
        event = decode(RunEvent, document)
    except NotDecodable:
        return None
    return event if 0 <= event.number <= event.total else None
