"""Our line in a machine's notes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.model.state import Partition
from rarms_iac.providers.cgroups.definitions import new_settings
from rarms_iac.providers.marks import erase_mark, read_mark, with_marks, write_mark
from tests.builders import a_mark

FIRST, SECOND = "aaaaaaaa-1111-4111-8111-111111111111", "bbbbbbbb-1111-4111-8111-111111111111"
MARK = a_mark(FIRST, "robot", "vision", "0123456789ab")
LINE = "rarms/1 robot/vision vm=aaaaaaaa set=0123456789ab"


def marked(notes: dict[str, str]) -> dict[str, Partition]:
    """Machines with these notes, by id."""
    machines = ((Partition(settings=new_settings("vision", 0), id=id_), text) for id_, text in notes.items())
    return {machine.id: machine for machine in with_marks(machines)}


def test_a_mark_is_one_line_below_the_users() -> None:
    assert write_mark("", MARK) == LINE
    assert write_mark("Ask Ann first.\r\n", MARK) == f"Ask Ann first.\r\n\n{LINE}"
    assert read_mark(f"Ask Ann.\r\n{LINE}\r\nThanks.") == MARK


def test_writing_again_replaces_the_line() -> None:
    newer = a_mark(FIRST, "robot", "vision", "ffffffffffff")

    assert read_mark(write_mark(write_mark("Ask Ann.", MARK), newer)) == newer


@given(st.text(alphabet=st.sampled_from("ab \r\n\t/1=") | st.characters(codec="utf-8")))
def test_mark_taken_out_leaves_notes_as_they_were(notes: str) -> None:
    assert erase_mark(write_mark(notes, MARK)) == notes
    assert read_mark(write_mark(notes, MARK)) == MARK


@pytest.mark.parametrize(
    ("notes", "why"),
    [
        ("just words", ""),
        (f"{LINE}\n{LINE}", "its notes hold 2 marks"),
        ("rarms/1 robot/Vision vm=aaaaaaaa set=0123456789ab", "a line of its notes begins like a mark and is none"),
        ("rarms/2 robot/vision vm=aaaaaaaa set=0123456789ab", "a line of its notes begins like a mark and is none"),
        (f"{LINE} ", "a line of its notes begins like a mark and is none"),
        (
            "rarms/1 robot/vision vm=bbbbbbbb set=0123456789ab",
            "its mark names another machine (bbbbbbbb): the machine was copied or imported",
        ),
    ],
)
def test_what_does_not_count_is_said(notes: str, why: str) -> None:
    judged = marked({FIRST: notes})[FIRST]

    assert (judged.mark, judged.foreign_mark) == (None, why)


def test_copy_of_a_machine_is_not_ours() -> None:
    judged = marked({FIRST: LINE, SECOND: LINE})

    assert judged[FIRST].mark == MARK
    assert judged[SECOND].mark is None
    assert judged[SECOND].foreign_mark.startswith("its mark names another machine")


def test_a_partition_on_two_machines_is_on_none() -> None:
    twice = marked({FIRST: LINE, SECOND: write_mark("", a_mark(SECOND, "robot", "vision", "0" * 12))})

    assert [reading.mark for reading in twice.values()] == [None, None]
    assert {reading.foreign_mark for reading in twice.values()} == {"the mark of robot/vision stands on 2 machines"}


def test_the_users_lines_are_kept_apart() -> None:
    assert marked({FIRST: f"one\n{LINE}\ntwo"})[FIRST].other_notes == "one\ntwo"
