"""The file of a simulated host: only what a series of operations could have made is believed."""

import hashlib
from dataclasses import replace

import pytest

from rarms_iac.model.state import PartitionSettings, RunState
from rarms_iac.providers.simulated.content import Content, SimulatedMachine, empty, next_id
from rarms_iac.providers.simulated.content_file import FORMAT, read_content, write_content
from rarms_iac.providers.simulated.registry import Registry
from rarms_iac.storage.codec import NotDecodable
from tests.builders_plan import settings

SETTINGS = settings("vision \u2603\nrarms")
ID = next_id(empty("onboard"), "vision")
MACHINE = SimulatedMachine(id=ID, settings=SETTINGS, state=RunState.RUNNING, notes='quotes " and \\ and \u2028')
CONTENT = replace(empty("onboard"), made=3).with_machine(MACHINE)


def sealed(text: str) -> bytes:
    checksum = hashlib.sha256(text.encode()).hexdigest()
    return f'{{"format":"{FORMAT}","checksum":"{checksum}","content":{text}}}\n'.encode()


def content_text(content: Content) -> str:
    return write_content(content).decode().split('"content":', 1)[1].removesuffix("}\n")


def test_content_reads_back_as_written() -> None:
    with_registry = CONTENT.with_registry(ID, Registry())

    assert read_content(write_content(CONTENT)) == CONTENT
    assert read_content(write_content(with_registry)) == with_registry
    assert sealed(content_text(CONTENT)) == write_content(CONTENT)


def test_ids_are_traceable_and_unique() -> None:
    assert empty("onboard") == empty("onboard")
    assert empty("onboard").id != empty("other").id
    assert next_id(CONTENT, "vision") != ID


def test_line_ends_of_git_do_no_harm() -> None:
    assert read_content(write_content(CONTENT).replace(b"\n", b"\r\n")) == CONTENT


@pytest.mark.parametrize(
    ("impossible", "message"),
    [
        (replace(SETTINGS, reserve=101), "101 is not between 0 and 100"),
        (replace(SETTINGS, reserve=50, limit=40), "above the limit"),
        (replace(SETTINGS, generation=7), "7 is not between 0 and 2"),
        (replace(SETTINGS, running=False), "running and not running"),
        (replace(SETTINGS, name="x" * 101), "1 to 100 characters"),
    ],
)
def test_settings_that_no_machine_can_have_are_damage(impossible: PartitionSettings, message: str) -> None:
    with pytest.raises(NotDecodable, match=message):
        read_content(write_content(CONTENT.with_machine(replace(MACHINE, settings=impossible))))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (replace(CONTENT, made=0), "a count is too small"),
        (replace(CONTENT, struck={"f": -1}), "not between 0 and"),
        (replace(CONTENT, id="x"), '"x" is no id'),
        (CONTENT.with_registry("ghost", Registry()), "there is no such machine"),
        (replace(CONTENT, machines={ID.upper(): MACHINE}), "filed under another id"),
    ],
)
def test_content_that_cannot_be_is_damage(content: Content, message: str) -> None:
    with pytest.raises(NotDecodable, match=message):
        read_content(write_content(content))


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"{}",
        b"\xff\xfe",
        sealed("{}"),
        sealed("[1]"),
        sealed('{"id":"x","id":"y"}'),
        sealed("[" * 50_000),
        write_content(CONTENT)[:-1],
        write_content(CONTENT) + b"\n",
        sealed(content_text(CONTENT).replace('"made":3', '"made":true')),
        sealed(content_text(CONTENT).replace('"made":3', '"made":3,"more":1')),
        sealed(content_text(CONTENT).replace('"state":"running"', '"state":"dancing"')),
    ],
    ids=range(12),
)
def test_what_is_not_such_a_file_is_damage(data: bytes) -> None:
    with pytest.raises(NotDecodable):
        read_content(data)
