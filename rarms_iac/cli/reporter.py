"""What a use case tells while it works, for a person at a terminal."""

import time
from collections.abc import Mapping, Sequence
from functools import cached_property

from rarms_iac.apply.run_report import RunReporter, SilentReporter
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.session import Session
from rarms_iac.cli.telling import tell
from rarms_iac.measuring.loop import MeasuringReporter
from rarms_iac.model.diagnostics import Diagnostic, Sources
from rarms_iac.model.measurement import Series


class TerminalReporter:
    """A `Reporter` that talks on standard error."""

    steps: RunReporter = SilentReporter()

    def __init__(self, session: Session) -> None:
        self._terminal = session.terminal

    @cached_property
    def settings(self) -> MeasuringReporter:
        """Progress in place on a terminal, a line now and then in a pipe."""
        from rarms_iac.views.measure import MeasuringProgress

        return MeasuringProgress(self._terminal.talk, time.monotonic, self._terminal.live_table())

    def message(self, text: str) -> None:
        """Say it."""
        self._terminal.talk(text)

    def findings(self, diagnostics: Sequence[Diagnostic], sources: Sources | None = None) -> None:
        """Say them in text."""
        tell(self._terminal, diagnostics, sources)


class ProofProgress:
    """Shows how far the components of a host are, while they are run all together; used in a `with`."""

    def __init__(self, session: Session) -> None:
        self._table = session.terminal.live_table()

    def __enter__(self) -> "ProofProgress":
        return self

    def __exit__(self, *_error: object) -> None:
        if self._table is not None:
            self._table.hide()

    def __call__(self, host: str, series: Mapping[str, Series]) -> None:
        """Show it in place; nothing where there is no terminal."""
        if self._table is not None:
            from rarms_iac.views.prove import sampled

            self._table.show(sampled(host, series))


def stopped(session: Session) -> ExitCode:
    """Say that somebody's end was heard, and how to go on; how the command ends then."""
    session.terminal.talk("Stopped. What is recorded stays: the same command goes on.")
    return session.interrupts.asked or ExitCode.INTERRUPTED
