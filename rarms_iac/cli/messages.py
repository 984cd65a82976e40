"""Messages of a command on standard error: findings and progress; and options of several commands."""

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Self

from rarms_iac.app.files import write_file
from rarms_iac.app.requests import STOP_PARTITIONS, flag, option
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.session import Session
from rarms_iac.model.diagnostics import Diagnostic, Sources, has_errors, in_order
from rarms_iac.texts.messages import STOPPED
from rarms_iac.views.finding_forms import BadOutput, OutputFormat, OutputTarget, parse_outputs
from rarms_iac.views.findings_text import findings_text
from rarms_iac.views.terminal import Terminal

if TYPE_CHECKING:
    from rich.console import RenderableType

    from rarms_iac.app.control import MeasuringReporter
    from rarms_iac.applying.run_report import RunReporter


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputOptions:
    """In which forms a command answers; `--json` is short for one of them."""

    output: tuple[str, ...] = option(
        "--output",
        metavar="FORMAT[=FILE]",
        help="The format: text, json, sarif, junit, github or markdown; repeatable, each to its own file.",
        default=(),
    )

    def targets(self, session: Session) -> tuple[OutputTarget, ...]:
        """Return each form and its destination; note in the session whether a program reads standard output.

        Raises:
            RequestError: an unknown form, or two go to one place.
        """
        try:
            outputs = parse_outputs((*self.output, "json") if session.as_json else self.output)
        except BadOutput as error:
            raise RequestError(f"--output: {error}") from error
        session.as_json = any(output.format is OutputFormat.JSON and output.path is None for output in outputs)
        return outputs


@dataclass(frozen=True, slots=True, kw_only=True)
class StopOptions:
    """Whether partitions may be stopped to measure."""

    stop_partitions: bool = flag(*STOP_PARTITIONS.flags, help=f"{STOP_PARTITIONS.help} [default: ask at a terminal]")

    def stops(self, *, on_busy_host: bool) -> bool:
        """Return whether partitions are stopped without a question.

        Raises:
            RequestError: they are to be stopped and to go on.
        """
        if self.stop_partitions and on_busy_host:
            raise RequestError("Give only one of --stop-partitions and --on-busy-host.")
        return self.stop_partitions


def tell(terminal: Terminal, diagnostics: Sequence[Diagnostic], sources: Sources | None = None) -> None:
    """Write these findings as text, in order; nothing where there are none."""
    if diagnostics:
        terminal.talk(findings_text(in_order(tuple(diagnostics)), sources or {}, in_progress=True))


def write_outputs(
    terminal: Terminal, outputs: Sequence[OutputTarget], form_of: Callable[[OutputFormat], "RenderableType"]
) -> None:
    """Write a command's answer in each form that `--output` names, to its file or else to standard output.

    Raises:
        UseCaseError: a file cannot be written.
    """
    for output in outputs:
        content = form_of(output.format)
        if output.path is not None:
            from rarms_iac.views.console import render

            text = content if isinstance(content, str) else render(content)
            write_file(output.path, text.encode("utf-8", errors="backslashreplace"))
        elif isinstance(content, str):
            terminal.data(content)
        else:
            terminal.show(content)


def is_shown(outputs: Sequence[OutputTarget]) -> bool:
    """Return whether a person reads the answer: standard output has it as text."""
    return any(output.format is OutputFormat.TEXT and output.path is None for output in outputs)


class TerminalReporter:
    """The messages and progress of a use case, for a person at a terminal; progress ends with the `with` block."""

    def __init__(self, session: Session, *, steps_as_json: bool = False) -> None:
        self._terminal = session.terminal
        self._steps_as_json = steps_as_json and not session.answer_follows
        self._progress = ExitStack()

    def __enter__(self) -> Self:
        """Return itself: progress is shown from its first word on."""
        return self

    def __exit__(self, *_: object) -> None:
        """Show the partitions that were not finished, and take the live line away."""
        self._progress.close()

    @cached_property
    def steps(self) -> "RunReporter":
        """Steps of a run, a line a partition; for programs a line a step, as data."""
        from rarms_iac.views.run import RunProgress, StepLines

        terminal = self._terminal
        if self._steps_as_json:
            return StepLines(terminal.data_now)
        return self._progress.enter_context(RunProgress(terminal.tell, time.monotonic, terminal.live_line()))

    @cached_property
    def settings(self) -> "MeasuringReporter":
        """Settings that are measured, in a table that is updated in place."""
        from rarms_iac.views.progress import MeasuringProgress

        return MeasuringProgress(self._terminal.talk, time.monotonic, self._terminal.live_line())

    def message(self, text: str) -> None:
        """Write whole sentences."""
        self._terminal.tell(text)

    def findings(self, diagnostics: Sequence[Diagnostic], sources: Sources | None = None) -> None:
        """Write findings."""
        tell(self._terminal, diagnostics, sources)


def stopped(session: Session) -> ExitCode:
    """Say that the wish to end was heard, and how to go on; how the command ends: an answer `q` is not a failure."""
    session.terminal.tell(STOPPED)
    return session.interrupts.exit_code or ExitCode.DONE


def measured(findings: Sequence[Diagnostic]) -> ExitCode:
    """Return the exit code of a command that measured and reported these findings."""
    from rarms_iac.measuring.findings import STILL_STOPPED

    if any(finding.code == STILL_STOPPED.code for finding in findings):
        return ExitCode.FAILED  # also where all was measured: the host is not as it was
    return ExitCode.NO if has_errors(tuple(findings)) else ExitCode.DONE
