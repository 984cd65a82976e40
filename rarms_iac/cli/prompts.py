"""What is asked at a terminal: which level of performance is good enough, and whether a combination is measured."""

import sys
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import click

from rarms_iac.app.errors import Outcome, RequestError, UseCaseError, declined
from rarms_iac.app.experiments import ExperimentResult
from rarms_iac.app.files import STANDARD_INPUT
from rarms_iac.app.report_model import Measurement
from rarms_iac.app.requests import ManifestSource
from rarms_iac.app.select import SelectOutcome
from rarms_iac.cli.interrupts import Interrupted
from rarms_iac.cli.messages import tell
from rarms_iac.cli.session import Session
from rarms_iac.model.quantities import show_processors
from rarms_iac.model.wording import counted, in_a_row
from rarms_iac.planner.combining.oracle import Members


def refuse_without_terminal(session: Session, source: ManifestSource) -> None:
    """Refuse to ask where nobody can answer, or where the answer cannot be written into a file.

    Raises:
        click.UsageError: There is no terminal, or the manifest is standard input.
    """
    if not session.terminal.answers:
        message = "There is no terminal to ask at. Leave --interactive out, and choose with `rarms select`."
        raise click.UsageError(message, click.get_current_context())
    refuse_standard_input(source)


def refuse_standard_input(source: ManifestSource) -> None:
    """Refuse to change a manifest that came from standard input.

    Raises:
        click.UsageError: It did.
    """
    if source.manifest == STANDARD_INPUT:
        raise click.UsageError("Standard input cannot be changed: name a file.", click.get_current_context())


class TerminalLevelPrompt:
    """A `LevelPrompt` that shows tables and plots, and reads a line for each component."""

    def __init__(self, session: Session) -> None:
        self._terminal = session.terminal

    def show(self, result: ExperimentResult, measurements: Sequence[Measurement]) -> None:
        """Show the settings, and a plot an index."""
        from rarms_iac.views.measure import settings_text
        from rarms_iac.views.reports.terminal import TerminalPlot, legend

        ascii_only = self._terminal.ascii_only
        self._terminal.talk("")
        self._terminal.talk(settings_text(result))
        for measurement in measurements:
            for index in measurement.indexes:
                self._terminal.talk("")
                self._terminal.talk(TerminalPlot(curve=index, ascii_only=ascii_only))
            self._terminal.talk(legend(ascii_only=ascii_only))

    def ask(self, component: str) -> str:
        """Read a line; the input's end is an empty one."""
        self._terminal.flush()
        self._terminal.status(f"\nA level for {component}, as 100 ms or 95 %, or Enter to go on: ")
        return sys.stdin.readline().strip()

    def refused(self, problem: RequestError | UseCaseError) -> None:
        """Say why."""
        if isinstance(problem, RequestError):
            self._terminal.tell(str(problem))
        else:
            tell(self._terminal, problem.diagnostics, problem.sources)

    def written(self, outcome: SelectOutcome) -> None:
        """Say what follows, and where it was written."""
        from rarms_iac.views.select import selection_text

        self._terminal.talk(selection_text(outcome.selection))
        self._terminal.talk(f"Written to {Path(outcome.file).as_posix()}.")


class TerminalStopConsent:
    """Asks once for each host whether its partitions may be stopped to measure; called as a `StopConsent`."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._answers: dict[str, bool] = {}

    def __call__(self, host: str, partitions: tuple[str, ...]) -> bool:
        """Ask.

        Raises:
            UseCaseError: A signal came instead of an answer.
        """
        if host not in self._answers:
            running = f"{in_a_row(partitions)} {'runs' if len(partitions) == 1 else 'run'}"
            question = f"On {host} {running}. Stop while it is measured, and start again afterwards?"
            self._answers[host] = ask_yes_or_no(self._session, question)
        return self._answers[host]


def ask_yes_or_no(session: Session, question: str) -> bool:
    """Ask at the terminal; an empty answer, or the input's end, is no, and what is neither is asked anew.

    Raises:
        UseCaseError: A signal came instead of an answer.
    """
    from rarms_iac.views.console import paragraph, render

    terminal = session.terminal
    terminal.flush()
    text = render(paragraph(f"{question} [y/N]"), terminal.width).removesuffix("\n") + " "
    terminal.status(text)
    try:
        with session.interrupts.at_prompt():
            while (answer := sys.stdin.readline().strip().lower()) not in {"", "y", "yes", "n", "no"}:
                terminal.status(f"Say y or n: {text}")
    except Interrupted:
        terminal.talk("")
        raise UseCaseError(Outcome.INTERRUPTED, [declined()]) from None
    return answer in {"y", "yes"}


class TerminalConsent:
    """A `Consent` that asks once for each combination."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._answers: dict[Members, bool] = {}

    def allows(self, members: Members, *, settings: int, gain: int) -> bool:
        """Ask; an empty answer, or the input's end, is no, and what is neither yes nor no is asked anew."""
        if members not in self._answers:
            self._answers[members] = self._ask(members, settings, gain)
        return self._answers[members]

    def _ask(self, members: Members, settings: int, gain: int) -> bool:
        saves = show_processors(Fraction(gain, 100))
        question = f"Try {in_a_row(members)}? About {counted(settings, 'setting')}, or fewer; saves at most {saves}."
        return ask_yes_or_no(self._session, question)
