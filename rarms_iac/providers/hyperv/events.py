"""The lines that a running script writes, as events (docs/scripts.md). Pure, and strict: anything else is noise."""

from dataclasses import dataclass
from typing import Literal

from rarms_iac.providers.interface import EventKind, EventStatus, RunEvent
from rarms_iac.storage.codec import NotDecodable, decode
from rarms_iac.storage.digest import parse_json

LONGEST = 100_000
"""Characters of a line that is looked at; a script's own are far shorter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _EventLine:
    """An event as it is written."""

    format: Literal["rarms-event/1"]
    kind: EventKind
    plan: str
    number: int
    total: int
    address: str
    status: EventStatus
    detail: str


def read_event(line: str) -> RunEvent | None:
    """The event that a line is, None where it is none of `rarms-event/1`."""
    if len(line) > LONGEST or not line.startswith("{"):
        return None
    try:
        event = decode(_EventLine, parse_json(line))
    except NotDecodable:
        return None
    if not 0 <= event.number <= event.total:
        return None
    return RunEvent(
        kind=event.kind,
        plan=event.plan,
        number=event.number,
        total=event.total,
        address=event.address,
        status=event.status,
        detail=event.detail,
    )
