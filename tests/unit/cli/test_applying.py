import io
import sys

import pytest

from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.applying.run_report import RunEnding
from rarms_iac.cli.applying import ask, code_of
from rarms_iac.cli.ending import ExitCode, Interrupted
from rarms_iac.cli.session import Session
from rarms_iac.views.terminal import Terminal


def a_session() -> Session:
    return Session(terminal=Terminal(out=io.StringIO(), err=io.StringIO(), answers=True))


def answered(text: str) -> Session:
    """A session in which the question was answered so."""
    session = a_session()
    before, sys.stdin = sys.stdin, io.StringIO(text)
    try:
        ask(session, "Do this?")
    finally:
        sys.stdin = before
    return session


def test_only_a_yes_goes_on() -> None:
    session = answered("yes\n")

    assert isinstance(session.terminal.err, io.StringIO)
    assert session.terminal.err.getvalue() == "\nDo this? Only `yes` does it: "


class Interrupting(io.RawIOBase):
    """A person who presses Ctrl-C instead of answering."""

    def readable(self) -> bool:
        return True

    def readinto(self, _buffer: object, /) -> int:
        raise Interrupted(ExitCode.INTERRUPTED)


def test_an_interrupted_question_says_that_nothing_was_changed() -> None:
    before, sys.stdin = sys.stdin, io.TextIOWrapper(io.BufferedReader(Interrupting()), encoding="utf-8")
    try:
        with pytest.raises(UseCaseError) as interrupted:
            ask(a_session(), "Do this?")
    finally:
        sys.stdin = before

    assert interrupted.value.outcome is Outcome.INTERRUPTED
    assert [diagnostic.summary for diagnostic in interrupted.value.findings] == ["Nothing was changed"]


@pytest.mark.parametrize("text", ["no\n", "y\n", "", "YES\n"])
def test_every_other_answer_is_a_no(text: str) -> None:
    with pytest.raises(UseCaseError) as refused:
        answered(text)

    assert refused.value.outcome is Outcome.REFUSED


@pytest.mark.parametrize(
    ("ending", "code"),
    [
        (RunEnding.DONE, ExitCode.DONE),
        (RunEnding.NOTHING, ExitCode.DONE),
        (RunEnding.REFUSED, ExitCode.REFUSED),
        (RunEnding.FAILED, ExitCode.FAILED),
        (RunEnding.INTERRUPTED, ExitCode.INTERRUPTED),
    ],
)
def test_how_a_run_ended_is_its_exit_code(ending: RunEnding, code: ExitCode) -> None:
    assert code_of(a_session(), ending) is code


def test_a_terminated_run_says_which_signal_it_was() -> None:
    session = a_session()
    session.interrupts.exit_code = ExitCode.TERMINATED

    assert code_of(session, RunEnding.INTERRUPTED) is ExitCode.TERMINATED
