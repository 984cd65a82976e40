import io
import sys
from contextlib import chdir
from pathlib import Path

import pytest

from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.planning import plan_request
from rarms_iac.app.requests import HostSelection, ManifestSource, RunOptions
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.applying.run_report import RunEnding
from rarms_iac.cli.applying import _plan_or_wait, ask, code_of
from rarms_iac.cli.ending import ExitCode, Interrupted
from rarms_iac.cli.session import Session
from rarms_iac.views.terminal import Terminal
from tests.unit.cli.running import rarms


def a_session() -> Session:
    return Session(terminal=Terminal(out=io.StringIO(), err=io.StringIO(), answers=True))


def answered(text: str) -> Session:
    """A session in which the question was answered so."""
    session = a_session()
    before, sys.stdin = sys.stdin, io.StringIO(text)
    try:
        ask(session, "Run this plan?")
    finally:
        sys.stdin = before
    return session


def test_only_a_yes_goes_on() -> None:
    session = answered("yes\n")

    assert isinstance(session.terminal.err, io.StringIO)
    assert session.terminal.err.getvalue() == "\nRun this plan? Type `yes` to confirm: "


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
            ask(a_session(), "Run this plan?")
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


UNFINISHED_RUN = """\
schema: rarms/v1
application: { name: robot }
hosts:
  onboard:
    logical_processors: 2
    memory: 4 GiB
    simulated: { faults: { broken: { operation: start_partition, at: "*", effect: refuse, times: 1 } } }
components:
  vision: { criticality: 1, memory: 512 MiB, cpu: { reserve: 20 % } }
"""


def test_run_begun_before_the_plan_is_waited_for(tmp_path: Path) -> None:
    (tmp_path / "rarms.yaml").write_text(UNFINISHED_RUN, encoding="utf-8")
    with chdir(tmp_path):
        assert rarms("apply", "--auto-approve").code == 1
        hosts = select_hosts(load_manifest(ManifestSource()), HostSelection())

        with pytest.raises(UseCaseError) as refused:
            _plan_or_wait(hosts, plan_request(hosts), RunOptions())
        assert [finding.code for finding in refused.value.findings] == ["RARMS183"]
        assert _plan_or_wait(hosts, plan_request(hosts), RunOptions(lock_timeout_ms=1)) is None

        assert rarms("apply", "--lock-timeout", "1s").code == 0
        assert _plan_or_wait(hosts, plan_request(hosts), RunOptions(lock_timeout_ms=1)) is not None


@pytest.mark.parametrize("words", [["apply", "--abandon"], ["undo", "--auto-approve"], ["apply", "--auto-approve"]])
def test_damaged_first_record_is_no_ended_run(tmp_path: Path, words: list[str]) -> None:
    (tmp_path / "rarms.yaml").write_text(UNFINISHED_RUN, encoding="utf-8")
    with chdir(tmp_path):
        assert rarms("apply", "--auto-approve").code == 1
        assert rarms("apply").code == 0
        journal = Path(".rarms/hosts/onboard.journal.jsonl")
        journal.write_bytes(journal.read_bytes().replace(b"vision", b"wision", 1))

        answer = rarms(*words)

    assert answer.code == 1
    assert "error[RARMS190]" in answer.err
    assert journal.name in answer.err
