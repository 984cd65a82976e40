"""Our line in a machine's notes."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.model.changes import Address
from rarms_iac.model.journal import RunStarted, StepRecorded, StepStatus
from rarms_iac.model.operations import RemovePartition, set_to
from rarms_iac.model.plan import Step
from rarms_iac.model.state import Partition, State
from rarms_iac.model.version import __version__
from rarms_iac.providers.channel import ProgramChannel
from rarms_iac.providers.interface import UNHEARD, HostError, HostFailed
from rarms_iac.providers.journaled import journal_in
from rarms_iac.providers.machines import erase_mark, new_settings, read_mark, with_marks, write_mark
from rarms_iac.providers.robot import LINE_LIMIT, READY, OtherVersion, RobotByChannel, entry_command
from rarms_iac.storage.codec import NotDecodable, encode
from rarms_iac.storage.records import sealed_line
from tests.builders import a_host, a_mark
from tests.builders_plan import facts
from tests.contracts.runs import a_run, a_step

RUN = a_run(State(facts=facts("onboard")))
FORGED = [
    replace(a_step(0), address=Address(partition="../vision")),
    replace(a_step(0), operation=RemovePartition(partition="../vision")),
    replace(a_step(0), address=Address(partition="vision", task="..\\Windows")),
]


def journal_of(run: RunStarted) -> bytes:
    record = encode(run)
    assert isinstance(record, dict)
    return sealed_line(record)


def test_a_journal_reads_back() -> None:
    journal = journal_in(journal_of(RUN), Path("journal.jsonl"))

    assert journal is not None
    assert journal.started == RUN


@pytest.mark.parametrize("step", FORGED, ids=["address", "operation", "task"])
def test_journal_with_impossible_name_is_damaged(step: Step) -> None:
    forged = replace(RUN, steps=(step, *RUN.steps[1:]))

    with pytest.raises(NotDecodable, match="is not a valid name in a manifest"):
        journal_in(journal_of(forged), Path("journal.jsonl"))


OUT_OF_RANGE = [
    ("processors", 0),
    ("processors", 2049),
    ("reserve", -1),
    ("reserve", 101),
    ("limit", 101),
    ("weight", 10_001),
    ("quota_period_us", -1),
    ("memory", -1),
]


@pytest.mark.parametrize("part", ["operation", "undo", "before", "after"])
@pytest.mark.parametrize(("setting", "value"), OUT_OF_RANGE)
def test_journal_with_impossible_setting_is_damaged(part: str, setting: str, value: int) -> None:
    values: dict[str, Any] = {setting: value}
    step, operation = a_step(0), set_to("vision", **values)
    changes: dict[str, dict[str, Any]] = {
        "operation": {"operation": operation},
        "undo": {"undo": replace(step.undo, operation=replace(operation, before=values, after={}))},
        "before": {"before": values},
        "after": {"after": values},
    }
    forged = replace(RUN, steps=(replace(step, **changes[part]),))

    with pytest.raises(NotDecodable, match=f"{setting}: {value} is not between"):
        journal_in(journal_of(forged), Path("journal.jsonl"))


@pytest.mark.parametrize("number", [3, 2**40])
def test_journal_with_step_beyond_run_is_damaged(number: int) -> None:
    record = encode(StepRecorded(number=number, status=StepStatus.CHANGED))
    assert isinstance(record, dict)

    with pytest.raises(NotDecodable, match=f"the run has no step {number}"):
        journal_in(journal_of(RUN) + sealed_line(record), Path("journal.jsonl"))


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
        (f"{LINE}\n{LINE}", "its notes have 2 marks"),
        (
            "rarms/1 robot/Vision vm=aaaaaaaa set=0123456789ab",
            "a line of its notes begins like a mark but is not valid",
        ),
        (
            "rarms/2 robot/vision vm=aaaaaaaa set=0123456789ab",
            "a line of its notes begins like a mark but is not valid",
        ),
        (f"{LINE} ", "a line of its notes begins like a mark but is not valid"),
        (
            "rarms/1 robot/vision vm=bbbbbbbb set=0123456789ab",
            "its mark names another machine (bbbbbbbb): the machine was copied or imported",
        ),
    ],
)
def test_note_that_is_no_mark_says_why(notes: str, why: str) -> None:
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
    assert {reading.foreign_mark for reading in twice.values()} == {"2 machines have the mark of robot/vision"}


def test_the_users_lines_are_kept_apart() -> None:
    assert marked({FIRST: f"one\n{LINE}\ntwo"})[FIRST].other_notes == "one\ntwo"


def answering(program: str) -> RobotByChannel:
    """A robot behind a channel whose other end is this program of Python."""
    return RobotByChannel(
        a_host(), ProgramChannel(host="onboard", target="cell", words=(sys.executable, "-c", program))
    )


def error_of(program: str, job: Any = None) -> HostError:
    with pytest.raises(HostError) as raised:
        answering(program).ask("look", job, UNHEARD)
    return raised.value


def saying(*lines: str) -> str:
    return f"print({chr(10).join(lines)!r})"


@pytest.mark.needs("posix")
@pytest.mark.parametrize(
    ("program", "message"),
    [
        (saying("Welcome!", "Last login: today"), "rarms does not start on cell"),
        (saying("Welcome!", READY), "the connection to cell broke"),
        (saying(READY, "Segmentation fault"), "not from rarms"),
        (saying(READY, "[" * 100_000), "not from rarms"),
        (saying(READY, '["result"]'), "not from rarms"),
        (saying(READY, '{"kind":"call","target":"steps","method":"__init__","arguments":[]}'), "not from rarms"),
        (saying(READY, '{"kind":"call","target":7,"method":"x","arguments":[]}'), "not from rarms"),
        (saying(READY, '{"kind":"failure","outcome":"failed"}'), "not from rarms"),
        (saying(READY, '{"kind":"failure","outcome":"perfect","findings":[]}'), "not from rarms"),
        (f"import sys; print({READY!r}); sys.stdout.buffer.write(bytes(2 ** 26 + 9))", "not from rarms"),
        ("while True: print('noise')", "did not start the command"),
        ("import sys; sys.exit('rarms: not found')", "rarms: not found"),
    ],
    ids=["login", "cut", "text", "deep", "list", "method", "kinds", "no-findings", "outcome", "64MiB", "noise", "code"],
)
def test_garbage_of_a_robot_is_named(program: str, message: str) -> None:
    error = error_of(program)

    assert message in error.message
    assert len(error.message) < 1_000


@pytest.mark.needs("posix")
def test_more_than_64_mib_are_not_sent() -> None:
    error = error_of("raise SystemExit(1)", "x" * LINE_LIMIT)

    assert f"the limit is {LINE_LIMIT:,}" in error.message


@pytest.mark.needs("posix")
def test_another_version_is_named_with_the_command() -> None:
    error = error_of(saying("Welcome!", "rarms: installed current 0.0.8 0.0.9"))

    assert isinstance(error, OtherVersion)
    assert isinstance(error, HostFailed)
    assert error.message == f"it has rarms 0.0.8, 0.0.9; this is rarms {__version__}"


@pytest.mark.needs("posix")
def test_noise_of_a_login_is_passed_over() -> None:
    answer = json.dumps({"kind": "result", "value": 7})

    assert answering(saying("Welcome!", READY, answer)).ask("look", None, UNHEARD) == 7


@pytest.mark.needs("posix")
def test_no_text_of_manifest_is_in_command() -> None:
    robot = answering("pass")
    hostile = a_host(name="on$(reboot)board")

    assert robot.name not in entry_command()
    assert entry_command() == entry_command(__version__)
    assert RobotByChannel(hostile, robot._channel).name not in entry_command()
