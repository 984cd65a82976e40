import json

import pytest

from rarms_iac.providers.hyperv.channel import read_event
from rarms_iac.providers.interface import EventKind, EventStatus, RunEvent

EVENT = {
    "format": "rarms-event/1",
    "kind": "step",
    "plan": "0123456789ab",
    "number": 2,
    "total": 5,
    "address": "partition/vision",
    "status": "changed",
    "detail": "reserve 40 %",
}


def test_a_line_of_a_script_is_an_event() -> None:
    assert read_event(json.dumps(EVENT)) == RunEvent(
        kind=EventKind.STEP,
        plan="0123456789ab",
        number=2,
        total=5,
        address="partition/vision",
        status=EventStatus.CHANGED,
        detail="reserve 40 %",
    )


@pytest.mark.parametrize(
    "line",
    [
        "",
        "WARNING: the module was loaded twice",
        "{",
        "[]",
        json.dumps({**EVENT, "format": "rarms-event/2"}),
        json.dumps({**EVENT, "status": "exploded"}),
        json.dumps({**EVENT, "kind": "party"}),
        json.dumps({**EVENT, "number": "2"}),
        json.dumps({**EVENT, "number": -1}),
        json.dumps({**EVENT, "number": 6}),
        json.dumps({**EVENT, "number": True}),
        json.dumps({**EVENT, "more": 1}),
        json.dumps({name: value for name, value in EVENT.items() if name != "detail"}),
        json.dumps(EVENT)[:-1] + ',"detail":"twice"}',
        '{"a":' * 5000,
        json.dumps({**EVENT, "detail": "x" * 200_000}),
        json.dumps(EVENT) + " trailing",
    ],
)
def test_any_other_line_is_none(line: str) -> None:
    assert read_event(line) is None
