"""What is asked at a terminal: which level of performance is good enough, and whether a combination is measured."""

import sys
from pathlib import Path

import click

from rarms_iac.app.errors import Outcome, RequestError, UseCaseError, declined
from rarms_iac.app.experiments import ExperimentResult
from rarms_iac.app.files import STANDARD_INPUT
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.level_prompt import SessionEnded
from rarms_iac.app.report_model import Report
from rarms_iac.app.requests import ManifestSource
from rarms_iac.app.select import SelectOutcome
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.interrupts import Interrupted
from rarms_iac.cli.messages import TerminalReporter, stopped, tell
from rarms_iac.cli.session import Session
from rarms_iac.model.quantities import show_lp_percent
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
        self._session = session
        self._terminal = session.terminal

    def show(self, result: ExperimentResult, report: Report) -> None:
        """Show the settings, a plot an index, and what all reservations add up to."""
        from rarms_iac.views.console import paragraph
        from rarms_iac.views.measure import settings_text
        from rarms_iac.views.reports.summary import fit_text, platform_fits
        from rarms_iac.views.reports.terminal import TerminalPlot, legend

        ascii_only = self._terminal.ascii_only
        self._terminal.talk("")
        self._terminal.talk(settings_text(result))
        members = result.experiment.setup.members
        for measurement in report.measurements:
            if not measurement.rests or measurement.components != members:
                continue
            for index in measurement.indexes:
                self._terminal.talk("")
                self._terminal.talk(TerminalPlot(curve=index, ascii_only=ascii_only))
            self._terminal.talk(legend(ascii_only=ascii_only))
        for fit in platform_fits(report):
            self._terminal.talk(paragraph(f"{', '.join(fit.capacity.hosts)}: {fit_text(fit)}"))

    def ask(self, component: str) -> str:
        """Read a line; the input's end is an empty one."""
        question = f"\nA level for {component}, as 100 ms or 95 %, or Enter to go on [?, q]: "
        return read_answer(self._session, question, LEVEL_HELP)

    def confirms(self, proposed: SelectOutcome) -> bool:
        """Show what would follow, and ask."""
        from rarms_iac.views.select import selection_text

        self._terminal.talk(selection_text(proposed.selection))
        return ask_yes_or_no(self._session, "Write this level into the manifest?", WRITE_HELP)

    def refines(self, written: SelectOutcome) -> bool:
        """Ask, naming the reservations that were not measured themselves."""
        reserves = sorted({level.reserve for level in written.selection.levels if level.interpolated})
        named = in_a_row([f"{reserve} %" for reserve in reserves])
        return ask_yes_or_no(self._session, f"{named} lies between measured settings. Measure there?", REFINE_HELP)

    def refused(self, problem: RequestError | UseCaseError) -> None:
        """Say why."""
        if isinstance(problem, RequestError):
            self._terminal.tell(str(problem))
        else:
            tell(self._terminal, problem.diagnostics, problem.sources)

    def written(self, outcome: SelectOutcome) -> None:
        """Say where it was written."""
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
            try:
                self._answers[host] = ask_yes_or_no(self._session, question, STOP_HELP)
            except SessionEnded:
                raise UseCaseError(Outcome.INTERRUPTED, [declined()]) from None
        return self._answers[host]


LEVEL_HELP = (
    "A level is how well it must do, with its unit: 100 ms, 95 %, 24 /s. Where it may belong to several indexes, begin "
    "with the index: p99_response_time 100 ms. What follows is shown before anything is written. Enter goes on, q ends."
)
WRITE_HELP = "y writes it as the component's `apt`, comments kept; n leaves the manifest as it is; q ends."
COMBINE_HELP = (
    "y measures components together, each combination after a question, as `rarms tune --interactive` does; q ends."
)
PARTITIONS_HELP = "y writes them as `partitions`, comments kept; n leaves the manifest as it is; q ends."
STOP_HELP = "y stops them as `rarms stop` does, and starts them when all is measured; n measures nothing."
TRY_HELP = "y measures them together, setting by setting, and keeps what is recorded; n tries another; q ends."
REFINE_HELP = "y searches the least reservation there, setting by setting; n takes what the curve says; q ends."


def read_answer(session: Session, question: str, help_text: str) -> str:
    """Read a line at the terminal; `?` shows the help and asks anew, and the input's end is an empty line.

    Raises:
        SessionEnded: The answer was `q`, or a signal.
    """
    from rarms_iac.views.console import paragraph

    while True:
        try:
            with session.interrupts.at_prompt():
                session.terminal.flush()
                session.terminal.status(question)
                answer = sys.stdin.readline().strip()
        except Interrupted:
            session.terminal.talk("")
            raise SessionEnded from None
        if answer.lower() in {"q", "quit"}:
            raise SessionEnded
        if answer != "?":
            return answer
        session.terminal.talk(paragraph(help_text))


def ask_yes_or_no(session: Session, question: str, help_text: str) -> bool:
    """Ask at the terminal; an empty answer, or the input's end, is no, and what is neither is asked anew.

    Raises:
        SessionEnded: The answer was `q`, or a signal.
    """
    from rarms_iac.views.console import paragraph, render

    text = render(paragraph(f"{question} [y/N/?/q]"), session.terminal.width).removesuffix("\n") + " "
    answer = read_answer(session, text, help_text).lower()
    while answer not in {"", "y", "yes", "n", "no"}:
        answer = read_answer(session, f"Say y or n: {text}", help_text).lower()
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
        saves = show_lp_percent(gain)
        question = f"Try {in_a_row(members)}? About {counted(settings, 'setting')}, or fewer; saves at most {saves}."
        return ask_yes_or_no(self._session, question, TRY_HELP)


def combine_if_wanted(session: Session, hosts: Hosts) -> ExitCode:
    """After levels were chosen: where they need more than there is, offer to combine components, and to write that."""
    from rarms_iac.app.combining_offer import combining_offer
    from rarms_iac.app.tune import TuneRequest, tune_components
    from rarms_iac.views.tune import TuningProgress, tuned_text

    offer = combining_offer(hosts)
    if offer is None:
        return ExitCode.DONE
    need, have = (show_lp_percent(amount) for amount in (offer.need, offer.have))
    then = "" if offer.predicted is None else f", predicted {show_lp_percent(offer.predicted)} combined"
    try:
        if not ask_yes_or_no(session, f"Need {need}, have {have}{then}. Combine components?", COMBINE_HELP):
            return ExitCode.DONE
        progress = TuningProgress(session.terminal.talk, session.terminal.live_table())
        reporter, consent = TerminalReporter(session), TerminalConsent(session)
        found = tune_components(
            hosts,
            TuneRequest(dry_run=True),
            reporter=reporter,
            stop=session.interrupts,
            planner_reporter=progress,
            consent=consent,
        )
        progress.ended()
        tell(session.terminal, found.findings, hosts.manifest.sources)
        session.terminal.talk(tuned_text(found))
        if found.run.ending == "stopped":
            return stopped(session)
        if found.run.ending != "successful":
            return ExitCode.NO
        if ask_yes_or_no(session, "Write these partitions into the manifest?", PARTITIONS_HELP):
            written = tune_components(hosts, TuneRequest(), reporter=reporter, stop=session.interrupts, consent=consent)
            session.terminal.talk(f"Written to {', '.join(written.files)}.")
    except SessionEnded:
        session.terminal.talk("Ended. What is measured and written stays: `rarms tune` goes on with combining.")
    return session.interrupts.exit_code or ExitCode.DONE
