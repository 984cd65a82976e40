import io
import signal
from collections.abc import Iterator, Sequence

import click
import pytest

from rarms_iac.app.general_findings import BUG, system_finding
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.cli import entry
from rarms_iac.cli.ending import ExitCode, Interrupted, Interrupts
from rarms_iac.cli.session import Session
from rarms_iac.views.terminal import Terminal


@pytest.fixture(autouse=True)
def _signals_as_before() -> Iterator[None]:
    """An interrupted command has its process ignore further signals, which here is the one of all tests."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def run_with(
    error: BaseException, *, debug: bool = False, command: str = "", begun: bool = False
) -> tuple[ExitCode, str]:
    """What becomes of an exception that a command ends with."""
    terminal = Terminal(out=io.StringIO(), err=io.StringIO(), debug=debug)

    def invoke(session: Session, _arguments: Sequence[str]) -> ExitCode:
        if begun:
            with session.interrupts.gently():
                session.interrupts.should_stop()
        raise error

    code = entry.run_guarded(Session(terminal=terminal, command=command), [], invoke)
    assert isinstance(terminal.err, io.StringIO)
    return code, terminal.err.getvalue()


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (click.exceptions.Exit(0), ExitCode.DONE),
        (click.UsageError("no"), ExitCode.USAGE),
        (KeyboardInterrupt(), ExitCode.INTERRUPTED),
        (Interrupted(ExitCode.TERMINATED), ExitCode.TERMINATED),
        (PermissionError(13, "Permission denied", "rarms.yaml"), ExitCode.FAILED),
        (UseCaseError(Outcome.NEGATIVE, [BUG.at(None, "what", "do")]), ExitCode.NO),
        (ZeroDivisionError("division by zero"), ExitCode.FAILED),
        (RecursionError(), ExitCode.FAILED),
        (MemoryError(), ExitCode.FAILED),
    ],
)
def test_every_exception_becomes_exit_code_without_trace(error: BaseException, code: ExitCode) -> None:
    given, said = run_with(error)

    assert given == code
    assert "Traceback" not in said


def test_unforeseen_error_is_a_bug() -> None:
    _, said = run_with(ZeroDivisionError("division by zero"))

    assert said.startswith("error[RARMS199] This is a bug in rarms\n")
    assert "ZeroDivisionError: division by zero" in said
    assert "--debug" in said


def test_debug_shows_the_trace() -> None:
    _, said = run_with(ZeroDivisionError("division by zero"), debug=True)

    assert said.startswith("Traceback (most recent call last):\n")


AGAIN = "If it was changing a host, run the same command again to finish that"


@pytest.mark.parametrize(
    ("command", "advice"),
    [
        ("apply", f"{AGAIN}, or `rarms undo` to take it back."),
        ("stop", f"{AGAIN}, or `rarms undo` to take it back."),
        ("undo", f"{AGAIN}."),
        ("measure", "Results are saved; run the same command to continue."),
        ("prove", "Results are saved; run the same command to continue."),
        ("plan", ""),
    ],
)
def test_an_interrupt_says_how_to_go_on(command: str, advice: str) -> None:
    _, said = run_with(Interrupted(ExitCode.INTERRUPTED), command=command, begun=True)

    assert " ".join(said.split()) == f"rarms was interrupted. {advice}".strip()


@pytest.mark.parametrize(
    ("command", "ending"), [("apply", " Nothing was done."), ("measure", " Nothing was done."), ("plan", "")]
)
def test_interrupt_before_work_says_that_nothing_was_done(command: str, ending: str) -> None:
    _, said = run_with(Interrupted(ExitCode.INTERRUPTED), command=command)

    assert " ".join(said.split()) == f"rarms was interrupted.{ending}"


def test_empty_look_has_begun_nothing() -> None:
    """`apply` first finishes what an earlier run left; where there is none, an interrupt while it plans undoes none."""
    looked, worked = Interrupts(), Interrupts()
    with looked.gently():
        assert looked.begun, "a signal that ends it at once may come upon a change"
    with worked.gently():
        worked.should_stop()
    with worked.gently():
        pass

    assert (looked.begun, worked.begun) == (False, True)


def test_the_file_of_a_refusal_is_named() -> None:
    error = PermissionError(13, "Permission denied", "/a/rarms.yaml")

    assert "/a/rarms.yaml: Permission denied." in system_finding(error).detail


def test_signal_asks_gentle_work_first() -> None:
    heard: list[str] = []
    interrupts = Interrupts(on_request=lambda: heard.append("once"))
    with interrupts.gently():
        interrupts.receive(signal.SIGTERM, None)
        assert interrupts.should_stop()
        with pytest.raises(Interrupted) as second:
            interrupts.receive(signal.SIGINT, None)
    with pytest.raises(Interrupted) as first:
        Interrupts().receive(signal.SIGTERM, None)

    assert (first.value.code, second.value.code) == (ExitCode.TERMINATED, ExitCode.INTERRUPTED)
    assert heard == ["once"]


def test_listening_takes_signals_over_and_gives_them_back() -> None:
    before = signal.getsignal(signal.SIGINT)
    interrupts = Interrupts()
    with interrupts.listening(), interrupts.gently():
        signal.raise_signal(signal.SIGINT)
        assert interrupts.exit_code is ExitCode.INTERRUPTED

    assert signal.getsignal(signal.SIGINT) is before


def test_further_interrupt_cuts_no_last_words() -> None:
    with pytest.raises(Interrupted), Interrupts().listening():
        signal.raise_signal(signal.SIGINT)

    signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN
