"""Ctrl-C and SIGTERM: at once where nothing is at stake, after the running step where a host is being changed."""

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TextIO

from rarms_iac.cli.codes import ExitCode

SIGNALS = {signal.SIGINT: ExitCode.INTERRUPTED, signal.SIGTERM: ExitCode.TERMINATED}


class Interrupted(KeyboardInterrupt):
    """Somebody wants rarms to end, with Ctrl-C or SIGTERM; no `except Exception` may swallow it."""

    def __init__(self, code: ExitCode) -> None:
        super().__init__(code.name.lower())
        self.code = code


class Interrupts:
    """Listens while a command runs; the first signal is remembered while the work is gentle, the second ends it."""

    def __init__(self, on_request: Callable[[], None] = lambda: None) -> None:
        """`on_request` is called at the signal that only asks; it must not use what a signal may have interrupted."""
        self.exit_code: ExitCode | None = None
        self._on_request = on_request
        self._gentle = False

    def should_stop(self) -> bool:
        """Whether the work should end at the next safe place."""
        return self.exit_code is not None

    @contextmanager
    def gently(self) -> Iterator[None]:
        """Inside, the first signal only asks: the work looks at `should_stop`."""
        self._gentle = True
        try:
            yield
        finally:
            self._gentle = False

    @contextmanager
    def at_prompt(self) -> Iterator[None]:
        """Inside, nothing is being changed, also where the work around it is gentle: a signal ends the question."""
        before, self._gentle = self._gentle, False
        try:
            yield
        finally:
            self._gentle = before

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Take the signals over, and give them back; only a process' main thread can."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {number: signal.signal(number, self.receive) for number in SIGNALS}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def receive(self, number: int, _frame: FrameType | None) -> None:
        """What a signal does."""
        first, self.exit_code = self.exit_code is None, SIGNALS[signal.Signals(number)]
        if not (self._gentle and first):
            raise Interrupted(self.exit_code)
        self._on_request()


def confirm_signal(stream: TextIO) -> None:
    """Tell the person at once, past the stream's buffer, which the signal may have come upon: a step may take long."""
    with contextlib.suppress(OSError, ValueError):
        os.write(stream.fileno(), b"\nStopping after the running step. A second Ctrl-C stops at once.\n")
