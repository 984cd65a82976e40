"""What is asked at a terminal: levels of performance, combinations, and whether something is stopped or written."""

import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from textwrap import fill

import click

from rarms_iac.app.control import Control, StopConsent, always_consents, never_consents
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.report_model import Report
from rarms_iac.app.requests import ManifestSource
from rarms_iac.app.select import BeyondMeasured, Selection
from rarms_iac.app.use_case_errors import RequestError, UseCaseError
from rarms_iac.cli.ending import Interrupted
from rarms_iac.cli.messages import TerminalReporter, stopped, tell
from rarms_iac.cli.session import Session
from rarms_iac.measuring.level_prompt import CombiningOffer, SessionEnded
from rarms_iac.measuring.measure_request import ExperimentResult, MeasureRequest, attached_of
from rarms_iac.measuring.tune import TuningResult
from rarms_iac.model.commands import Wording, command, prose
from rarms_iac.planner.combining.oracle import Members
from rarms_iac.storage.reading import STANDARD_INPUT
from rarms_iac.views import questions
from rarms_iac.views.console import paragraph, visible
from rarms_iac.views.questions import Question, selection_text
from rarms_iac.views.tune import TuningProgress, tuned_text


def refuse_without_terminal(session: Session, source: ManifestSource, advice: Wording) -> None:
    """Refuse to ask without a user to answer, or where the answer cannot be written into a file.

    Args:
        advice: what to do without a terminal.

    Raises:
        RequestError: no terminal, or the manifest is standard input.
    """
    if not session.terminal.answers:
        raise RequestError("rarms cannot ask: standard input is not a terminal.", advice)
    refuse_standard_input(source)


def refuse_standard_input(source: ManifestSource) -> None:
    """Refuse to change a manifest that came from standard input.

    Raises:
        RequestError: It did.
    """
    if source.manifest == STANDARD_INPUT:
        raise RequestError("rarms cannot edit standard input. Name a file.")


class TerminalLevelPrompt:
    """A `LevelPrompt` that shows tables and plots, and reads a line for each component."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._terminal = session.terminal

    def show(self, result: ExperimentResult, report: Report) -> None:
        """Show the settings, a plot an index, and what all reservations add up to."""
        self._terminal.talk(questions.curves_text(result, report, ascii_only=self._terminal.ascii_only))

    def ask(self, component: str) -> str:
        """Read a line; the input's end is an empty one."""
        return read_answer(self._session, questions.level_question(component))

    def confirms(self, proposed: Selection) -> bool:
        """Show what would follow, and ask."""
        self._terminal.talk(selection_text(proposed))
        return ask_yes_or_no(self._session, questions.WRITE_LEVEL)

    def refines(self, written: Selection) -> bool:
        """Ask, naming the gaps between measured settings."""
        return ask_yes_or_no(self._session, questions.refine_question(written))

    def extends(self, beyond: BeyondMeasured) -> bool:
        """Ask, naming the settings."""
        return ask_yes_or_no(self._session, questions.extend_question(beyond))

    def refused(self, problem: RequestError | UseCaseError) -> None:
        """Say why."""
        if isinstance(problem, RequestError):
            self._terminal.tell(str(problem))
        else:
            tell(self._terminal, problem.findings, problem.sources)

    def written(self, outcome: Selection) -> None:
        """Say where it was written."""
        self._terminal.tell(f"Written to {Path(outcome.file).as_posix()}.")


class TerminalTuningPrompt(TuningProgress):
    """A `TuningPrompt` that shows how the search goes, and asks once for each combination, if at all."""

    def __init__(self, session: Session, *, asks: bool = True) -> None:
        super().__init__(session.terminal.talk)
        self._session = session
        self._asks = asks
        self._consents: dict[Members, bool] = {}

    def allows(self, members: Members, settings: int, gain: int) -> bool:
        """Ask; an empty answer, or the input's end, is no, and what is neither yes nor no is asked again."""
        if self._asks and members not in self._consents:
            question = questions.combination_question(members, settings, gain)
            self._consents[members] = ask_yes_or_no(self._session, question)
        return self._consents.get(members, True)

    def confirms(self, found: TuningResult) -> bool:  # noqa: ARG002 - the protocol's
        """Have it written."""
        return True


class TerminalCombiningPrompt(TerminalTuningPrompt):
    """A `CombiningPrompt` that also asks whether to combine, and whether to write what was found."""

    def combines(self, offer: CombiningOffer) -> bool:
        """Ask, naming what is needed, what there is, and what is predicted."""
        return ask_yes_or_no(self._session, questions.combine_question(offer))

    def confirms(self, found: TuningResult) -> bool:
        """Show the partitions, and ask."""
        self._session.terminal.talk(tuned_text(found))
        return ask_yes_or_no(self._session, questions.WRITE_PARTITIONS)


def measuring_control(session: Session, *, stop_partitions: bool) -> Control:
    """Return the command's part while it measures: what is shown, signals, and whether partitions may be stopped."""
    consents = _stop_consent(session, stop_partitions=stop_partitions)
    return Control(reporter=TerminalReporter(session), stop=session.interrupts, consents=consents)


def _stop_consent(session: Session, *, stop_partitions: bool) -> StopConsent:
    """Return the permission to stop partitions to measure: the option, or a user at a terminal, asked once per host."""
    if stop_partitions:
        return always_consents
    if session.as_json or not session.terminal.answers:
        return never_consents

    @cache
    def asked(host: str, partitions: tuple[str, ...]) -> bool:
        try:
            return ask_yes_or_no(session, questions.stop_question(host, partitions))
        except SessionEnded:
            raise click.exceptions.Exit(stopped(session)) from None

    return asked


def with_attach_consent(session: Session, hosts: Hosts, request: MeasureRequest) -> MeasureRequest:
    """Ask at a terminal whether services and containers that run already may be slowed down, unless that was said."""
    if request.attach or session.as_json or not session.terminal.answers:
        return request
    known = [name for name in request.components if name in hosts.system.components]
    names = attached_of(hosts, replace(request, components=tuple(known)))
    try:
        consents = bool(names) and ask_yes_or_no(session, questions.attach_question(names))
    except SessionEnded:
        raise click.exceptions.Exit(stopped(session)) from None
    return replace(request, attach=consents)


def read_answer(session: Session, question: Question) -> str:
    """Read a line at the terminal; `?` shows the help and asks again, and the input's end is an empty line.

    Raises:
        SessionEnded: The answer was `q`, or a signal.
    """
    while True:
        try:
            with session.interrupts.at_prompt():
                session.terminal.flush()
                session.terminal.status(question.text)
                answer = sys.stdin.readline().strip()
        except Interrupted:
            session.terminal.talk("")
            raise SessionEnded from None
        if answer.lower() in {"q", "quit"}:
            raise SessionEnded
        if answer != "?":
            return answer
        session.terminal.talk(paragraph(question.help_text))


def ask_yes_or_no(session: Session, question: Question) -> bool:
    """Ask at the terminal; an empty answer, or the input's end, is no, and what is neither is asked again.

    Raises:
        SessionEnded: The answer was `q`, or a signal.
    """
    words = f"{visible(question.text)} [y/N/?/q]"
    text = fill(words, session.terminal.width, break_long_words=False, break_on_hyphens=False) + " "
    asked = Question(text=text, help_text=question.help_text)
    answer = read_answer(session, asked).lower()
    while answer not in {"", "y", "yes", "n", "no"}:
        answer = read_answer(session, Question(text=f"Type y or n: {text}", help_text=question.help_text)).lower()
    return answer in {"y", "yes"}


def refuse_load_unasked(session: Session, *, loads: bool, load_host: bool) -> None:
    """Refuse to use all idle time of hosts where nobody can be asked, before anything is done.

    Args:
        load_host: whether that was asked for.

    Raises:
        RequestError: there is none, and it was not asked for.
    """
    if loads and not load_host and not session.terminal.answers:
        raise RequestError(
            "A proof loads the hosts fully. rarms cannot ask first, because standard input is not a terminal.",
            prose(
                "Allow full load with --load-host, or prove without a load: ", command("prove", without_load=True), "."
            ),
        )
