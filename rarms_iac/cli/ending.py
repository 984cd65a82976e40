"""How a command ends: the exit codes that a script or a pipeline may rely on, and what Ctrl-C and SIGTERM do.

An interrupt ends a command at once where nothing is at stake, after the running step where a host is being changed.
"""

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import IntEnum
from types import FrameType
from typing import TextIO

import click

from rarms_iac.app.use_case_errors import Outcome, RequestError
from rarms_iac.model.commands import Wording


class ExitCode(IntEnum):
    """The ending of a command."""

    DONE = 0  # done, nothing to do, or warnings only
    FAILED = 1  # the tool or a host failed, or a host cannot be reached
    FOUND = 2  # plan --detailed-exitcode: changes; validate: errors; fmt --check, drift: not as it should be
    REFUSED = 3  # host moved, busy or locked; plan stale, edited or used; another run unfinished
    NO = 4  # errors in the manifest, does not fit
    NOT_APPLIED = 5  # drift: only not applied yet
    USAGE = 64  # wrong words, or a name that neither the manifest nor a host has
    INTERRUPTED = 130  # Ctrl-C; can be resumed
    TERMINATED = 143


CODES = {
    Outcome.FAILED: ExitCode.FAILED,
    Outcome.REFUSED: ExitCode.REFUSED,
    Outcome.NEGATIVE: ExitCode.NO,
    Outcome.MISSING: ExitCode.USAGE,
    Outcome.INTERRUPTED: ExitCode.INTERRUPTED,
}
"""How a command ends whose use case ended without an answer."""


SIGNALS = {signal.SIGINT: ExitCode.INTERRUPTED, signal.SIGTERM: ExitCode.TERMINATED}


class WrongRequest(click.UsageError):
    """A request that cannot be done as it was given, with what to do instead."""

    def __init__(self, error: RequestError, context: click.Context) -> None:
        super().__init__(error.message, context)
        self.advice: Wording = error.advice


class Interrupted(KeyboardInterrupt):
    """The user or the system wants rarms to end, with Ctrl-C or SIGTERM; no `except Exception` may swallow it."""

    def __init__(self, code: ExitCode) -> None:
        super().__init__(code.name.lower())
        self.code = code


class Interrupts:
    """Listens while a command runs; the first signal is remembered while the work is gentle, the second ends it."""

    def __init__(self, on_request: Callable[[], None] = lambda: None) -> None:
        """Take `on_request`, called at the gentle signal; it must not use what a signal may have interrupted."""
        self.exit_code: ExitCode | None = None
        self._on_request = on_request
        self.begun = False  # whether any work was done that asks for a gentle end
        self._gentle = False
        self._asked = False  # whether the gentle work asked if it should end, as all work does between its pieces

    def should_stop(self) -> bool:
        """Return whether the work should end at the next safe place."""
        self._asked = True
        return self.exit_code is not None

    @contextmanager
    def gently(self) -> Iterator[None]:
        """Let the first signal only ask within the context: the work looks at `should_stop`."""
        before, self._asked = self.begun, False
        self._gentle = self.begun = True
        try:
            yield
            self.begun = before or self._asked  # a look that found nothing to do asks nothing
        finally:
            self._gentle = False

    @contextmanager
    def at_prompt(self) -> Iterator[None]:
        """Let a signal end a question at once, also within gentle work: nothing changes meanwhile."""
        before, self._gentle = self._gentle, False
        try:
            yield
        finally:
            self._gentle = before

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Take the signals over, and give them back; only a process' main thread can.

        After an interrupt they are ignored: a further Ctrl-C would only cut the last words, and the exit code.
        """
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {number: signal.signal(number, self.receive) for number in SIGNALS}
        try:
            yield
        except Interrupted:
            before = dict.fromkeys(SIGNALS, signal.SIG_IGN)
            raise
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def receive(self, number: int, _frame: FrameType | None) -> None:
        """Handle a signal."""
        first, self.exit_code = self.exit_code is None, SIGNALS[signal.Signals(number)]
        if not (self._gentle and first):
            raise Interrupted(self.exit_code)
        self._on_request()


def confirm_signal(stream: TextIO) -> None:
    """Tell the person at once, past the stream's buffer, which the signal may have come upon: a step may take long."""
    with contextlib.suppress(OSError, ValueError):
        os.write(stream.fileno(), b"\nStopping. A second Ctrl-C stops at once.\n")
