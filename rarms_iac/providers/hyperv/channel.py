"""A program that was started, line by line: what it writes, what it is sent, and whether it still lives.

Threads read and write, so that neither side can block the other and the caller may look up now and then. The program
gets a process group of its own: Ctrl-C is for rarms, which then asks the script to stop after the running step. What it
writes is read as events (docs/scripts.md), strictly: any other line is noise.
"""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from queue import Empty, SimpleQueue
from subprocess import PIPE
from types import TracebackType

from rarms_iac.providers.interface import RunEvent
from rarms_iac.storage.codec import NotDecodable, decode
from rarms_iac.storage.digest import parse_json

FORMAT = "rarms-event/1"
LONGEST = 100_000
"""Characters of a line that is looked at; a script's own are far shorter."""

LOOK_SECONDS = 0.1
LAST_SECONDS = 10.0  # for a program that has closed its output to end
KEPT_LINES = 20
LONGEST_LINE = 64 * 2**20  # bytes: an observation is one line


class SilenceTimeout(Exception):
    """Nothing came for so long."""


class Channel:
    """A started program. Use it as a context: when that ends, the program has ended too.

    Raises:
        OSError: it cannot be started.
    """

    def __init__(self, words: Sequence[str]) -> None:
        self._process, self._kill = _start(words)
        self._lines: SimpleQueue[bytes | None] = SimpleQueue()
        self._sending: SimpleQueue[bytes | None] = SimpleQueue()
        self._errors: deque[str] = deque(maxlen=KEPT_LINES)
        targets = (self._read, self._read_errors, self._write)
        self._threads = [threading.Thread(target=target, daemon=True) for target in targets]
        for thread in self._threads:
            thread.start()

    def __enter__(self) -> "Channel":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process.poll() is None:
            self._kill()  # and whatever it started: what lives on would hold the pipes
        self.close()
        self._process.wait()
        for thread in self._threads:
            thread.join()
        for pipe in (self._process.stdout, self._process.stderr):
            if pipe is not None:
                pipe.close()

    @property
    def error_lines(self) -> tuple[str, ...]:
        """The last lines of its standard error."""
        return tuple(self._errors)

    def send(self, data: bytes) -> None:
        """Have this on its standard input, after what was sent before; a program that does not listen is no error."""
        self._sending.put(data)

    def close(self) -> None:
        """Nothing more is sent."""
        self._sending.put(None)

    def next_line(self, silence_s: float, look: Callable[[], None]) -> str | None:
        """The next line without its end, None when there are no more; `look` is called while waiting.

        Raises:
            SilenceTimeout: nothing came for so long.
        """
        until = time.monotonic() + silence_s
        while True:
            look()
            try:
                line = self._lines.get(timeout=LOOK_SECONDS)
            except Empty:
                if time.monotonic() >= until:
                    raise SilenceTimeout from None
                continue
            return None if line is None else line.decode("utf-8", "replace").rstrip("\r\n")

    def code(self) -> int | None:
        """Its exit code once its output has ended; None where it lives on."""
        try:
            return self._process.wait(LAST_SECONDS)
        except subprocess.TimeoutExpired:
            return None

    def _read(self) -> None:
        assert self._process.stdout is not None, "it was started with a pipe"
        while line := self._process.stdout.readline(LONGEST_LINE):
            self._lines.put(line)
        self._lines.put(None)

    def _read_errors(self) -> None:
        assert self._process.stderr is not None, "it was started with a pipe"
        while line := self._process.stderr.readline(LONGEST_LINE):
            if text := line.decode("utf-8", "replace").strip():
                self._errors.append(text)

    def _write(self) -> None:
        pipe = self._process.stdin
        assert pipe is not None, "it was started with a pipe"
        with contextlib.suppress(OSError):  # it ended without listening: its exit code says more
            while (data := self._sending.get()) is not None:
                pipe.write(data)
                pipe.flush()
        with contextlib.suppress(OSError):
            pipe.close()


if sys.platform == "win32":

    def _start(words: Sequence[str]) -> "tuple[subprocess.Popen[bytes], Callable[[], None]]":
        """In a job object, which ends whatever it started; it does not end with rarms, as a script must not."""
        import win32job

        group = subprocess.CREATE_NEW_PROCESS_GROUP
        process = subprocess.Popen(words, stdin=PIPE, stdout=PIPE, stderr=PIPE, creationflags=group)
        job = win32job.CreateJobObject(None, "")
        win32job.AssignProcessToJobObject(job, int(process._handle))  # noqa: SLF001 - nobody else has it
        return process, lambda: win32job.TerminateJobObject(job, 1)

else:

    def _start(words: Sequence[str]) -> "tuple[subprocess.Popen[bytes], Callable[[], None]]":
        process = subprocess.Popen(words, stdin=PIPE, stdout=PIPE, stderr=PIPE, process_group=0)

        def kill() -> None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)

        return process, kill


def read_event(line: str) -> RunEvent | None:
    """The event that a line is, None where it is none of this format."""
    if len(line) > LONGEST or not line.startswith("{"):
        return None
    try:
        document = parse_json(line)
        if not isinstance(document, dict) or document.pop("format", None) != FORMAT:
            return None
        event = decode(RunEvent, document)
    except NotDecodable:
        return None
    return event if 0 <= event.number <= event.total else None
