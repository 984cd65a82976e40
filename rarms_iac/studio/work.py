"""One use case at a time; the page sees what a terminal would show of it, and may ask for its end."""

import time
from collections import deque
from collections.abc import Callable, Iterator, MutableSequence, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from queue import Empty, Queue
from threading import Event, Lock
from typing import TYPE_CHECKING, Literal

from rarms_iac.app.control import MeasuringReporter, StopSignal
from rarms_iac.app.use_case_errors import Outcome, RequestError, UseCaseError, bug_finding, system_finding
from rarms_iac.applying.run_report import ReportedStep, RunReporter
from rarms_iac.model.commands import Wording, sentences
from rarms_iac.model.diagnostics import Diagnostic, Sources, in_order
from rarms_iac.model.journal import StepStatus
from rarms_iac.views.console import UNLIMITED, plain_text, render, visible
from rarms_iac.views.findings_text import findings_text
from rarms_iac.views.progress import MeasuringProgress

if TYPE_CHECKING:
    from rich.console import RenderableType

MOST_LINES = 400
MOST_ROWS = 200
"""Of what is kept of a use case's words; older ones are dropped."""

Ending = Literal["", "done", "shown", "stopped", "failed"]
"""`shown`: it looked, and changed nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkState:
    """The progress of a use case, as the page shows it."""

    number: int  # of the use case, from 1; 0: none was begun yet
    command: str  # that does the same in a terminal
    ending: Ending  # empty: it runs
    rows: tuple[tuple[str, ...], ...]
    current: tuple[str, ...]  # the row of what runs now
    lines: tuple[str, ...]


class WorkRefused(Exception):
    """Something runs already."""


class Transcript:
    """The messages of a use case, kept for the page: a `Reporter`, and the `LiveRow` of the terminal's progress.

    Args:
        manifest_options: what recommended commands end with, such as ` -f cell`.
    """

    def __init__(self, manifest_options: str) -> None:
        self.rows: MutableSequence[Sequence[str]] = deque(maxlen=MOST_ROWS)
        self._manifest_options = manifest_options
        self._current: Sequence[str] = ()
        self._lines: deque[str] = deque(maxlen=MOST_LINES)

    def show(self, row: Sequence[str]) -> None:
        """Take the row of the step or setting that runs now, in place of the one before."""
        self._current = tuple(row)

    def hide(self) -> None:
        """Show no use case as running."""
        self._current = ()

    def say(self, content: "RenderableType") -> None:
        """Take what a terminal would be shown, its lines not broken."""
        self._lines.append(render(content, UNLIMITED, manifest=self._manifest_options))

    def message(self, text: Wording) -> None:
        """Take whole sentences."""
        self._lines.append(visible(plain_text(text, self._manifest_options)))

    def findings(self, diagnostics: Sequence[Diagnostic], sources: Sources | None = None) -> None:
        """Take findings."""
        if diagnostics:
            self.say(findings_text(in_order(tuple(diagnostics)), sources or {}))

    @cached_property
    def steps(self) -> RunReporter:
        """Takes each step of a run."""
        return StepRows(self)

    @cached_property
    def settings(self) -> MeasuringReporter:
        """Takes each setting that is measured."""
        return MeasuringProgress(self.say, time.monotonic, self)

    def state(self, number: int, command: str, ending: Ending) -> WorkState:
        """Return the state of the work until now.

        Args:
            ending: how it ended; empty: it runs.
        """
        return WorkState(
            number=number,
            command=command,
            ending=ending,
            rows=tuple(tuple(map(visible, row)) for row in self.rows),
            current=tuple(map(visible, self._current)),
            lines=tuple(self._lines),
        )


class StepRows(RunReporter):
    """A row a step of an apply or an undo."""

    def __init__(self, transcript: Transcript) -> None:
        self._transcript = transcript

    def step_started(self, host: str, number: int, total: int, step: ReportedStep) -> None:
        """Show it as what runs now."""
        self._transcript.show((host, _of(number, total), str(step.address), step.title, "..."))

    def step_ended(self, host: str, number: int, total: int, step: ReportedStep, status: StepStatus) -> None:
        """Keep it."""
        self._transcript.hide()
        self._transcript.rows.append((host, _of(number, total), str(step.address), step.title, status.value))

    def host_output(self, host: str, line: str) -> None:
        """Keep what the host said apart from its steps."""
        self._transcript.message(f"{host}: {line}")


def _of(number: int, total: int) -> str:
    return f"{number} of {total}" if total else str(number)


class WorkStop:
    """A `StopSignal` that the page gives, or the server when it ends."""

    def __init__(self, server: StopSignal) -> None:
        self._server = server
        self._asked = Event()

    def ask(self) -> None:
        """Ask for the end."""
        self._asked.set()

    def should_stop(self) -> bool:
        """Return whether the end was asked for."""
        return self._asked.is_set() or self._server.should_stop()

    @contextmanager
    def gently(self) -> Iterator[None]:
        """Hold nothing back: `TaskRunner` holds signals back while a use case runs.

        Yields:
            Once, with nothing.
        """
        yield


Task = Callable[[Transcript, StopSignal], Ending]
"""Does a use case, and returns how it ended."""


class TaskRunner:
    """The use case that runs, or the last one.

    Args:
        manifest_options: what recommended commands end with.
        ended: called after each use case.
    """

    def __init__(self, server: StopSignal, manifest_options: str, ended: Callable[[], None]) -> None:
        self._server = server
        self._manifest_options = manifest_options
        self._ended = ended
        self._lock = Lock()
        self.was_cut = False  # by a signal, in the middle
        self._number = 0
        self._command = ""
        self._ending: Ending = "done"
        self._transcript = Transcript(manifest_options)
        self._stop = WorkStop(server)
        self._waiting: Queue[Task] = Queue()  # at most one

    def state(self) -> WorkState:
        """Return its progress."""
        return self._transcript.state(self._number, self._command, self._ending)

    def stop(self, number: int) -> None:
        """Ask for the end of a use case; what was measured or done stays.

        Args:
            number: of the use case; where another one runs by now, it is not stopped.
        """
        with self._lock:
            if number == self._number:
                self._stop.ask()

    def start(self, command: str, task: Task) -> None:
        """Have a use case begun by the thread that calls `run_next`.

        Raises:
            WorkRefused: another one runs.
        """
        with self._lock:
            if self._ending == "":
                raise WorkRefused
            self._number += 1
            self._command, self._ending = command, ""
            self._transcript, self._stop = Transcript(self._manifest_options), WorkStop(self._server)
            self._waiting.put(task)

    def run_next(self, seconds: float) -> None:
        """Do the use case that was started, in this thread, to its end.

        Args:
            seconds: how long to wait for one.

        Raises:
            KeyboardInterrupt: a signal cut it; what a use case does at its end is done.
        """
        with suppress(Empty):
            task = self._waiting.get(timeout=seconds)
            with self._server.gently():
                self._run(task)

    def _run(self, task: Task) -> None:
        transcript = self._transcript
        ending: Ending = "failed"
        try:
            ending = task(transcript, self._stop)
        except RequestError as error:
            transcript.message(sentences(error.message, error.advice))
        except KeyboardInterrupt:
            ending = "stopped"
            self.was_cut = True
            raise
        except UseCaseError as error:
            ending = "stopped" if error.outcome is Outcome.INTERRUPTED else "failed"
            transcript.findings(error.findings, error.sources)
        except OSError as error:
            transcript.findings([system_finding(error)])
        except Exception as error:  # noqa: BLE001 - as at the entry of the command line: a fault is reported, too
            transcript.findings([bug_finding(error)])
        finally:
            transcript.hide()
            self._ended()
            self._ending = ending
