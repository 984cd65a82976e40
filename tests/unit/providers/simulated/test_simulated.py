"""The file of a simulated host: only what rarms wrote is believed."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac.model.state import RunState
from rarms_iac.providers.simulated.content import (
    Registry,
    SimulatedMachine,
    empty,
    next_id,
    read_content,
    write_content,
)
from rarms_iac.storage.codec import NotDecodable
from rarms_iac.storage.records import Damaged, sealed_line
from tests.builders_plan import settings

SETTINGS = settings("vision \u2603\nrarms")
ID = next_id(empty("onboard"), "vision")
MACHINE = SimulatedMachine(id=ID, settings=SETTINGS, state=RunState.RUNNING, notes='quotes " and \\ and \u2028')
CONTENT = replace(empty("onboard"), made=3).with_machine(MACHINE)

PATH = Path("onboard.json")


def file_with(old: bytes, new: bytes) -> bytes:
    """A file whose checksum is right, with another text."""
    record = json.loads(write_content(CONTENT).replace(old, new))
    return sealed_line({name: value for name, value in record.items() if name not in {"length", "checksum"}})


def test_content_reads_back_as_written() -> None:
    with_registry = CONTENT.with_registry(ID, Registry())

    assert read_content(write_content(CONTENT), PATH) == CONTENT
    assert read_content(write_content(with_registry), PATH) == with_registry


def test_ids_are_traceable_and_unique() -> None:
    assert empty("onboard") == empty("onboard")
    assert empty("onboard").id != empty("other").id
    assert next_id(CONTENT, "vision") != ID


def test_line_ends_of_git_do_no_harm() -> None:
    assert read_content(write_content(CONTENT).replace(b"\n", b"\r\n"), PATH) == CONTENT


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"{}",
        b"\xff\xfe",
        sealed_line({"made": 1}),
        write_content(CONTENT)[:-1],
        write_content(CONTENT) + b"\n",
        write_content(CONTENT) * 2,
        write_content(CONTENT) + b"{",
        write_content(CONTENT).replace(b'"made":3', b'"made":4'),
        file_with(b'"made":3', b'"made":true'),
        file_with(b'"made":3', b'"made":-3'),
        file_with(b'"made":3', b'"made":3,"more":1'),
        file_with(b'"state":"running"', b'"state":"dancing"'),
        file_with(b"simulated-host/1", b"simulated-host/2"),
    ],
    ids=range(14),
)
def test_what_is_not_such_a_file_is_damage(data: bytes) -> None:
    with pytest.raises((Damaged, NotDecodable)):
        read_content(data, PATH)
