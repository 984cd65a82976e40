"""The calling end of a supervisor process: starts and stops a component's process and reads its lines, with limits."""

import contextlib
import json
import os
import queue
import secrets
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import IO, Any

from rarms_iac.model.setting import ThreadsSeen
from rarms_iac.running.events import Event, LineCutter, OutputLine, OverlongLine, ProcessEnded, ProcessStarted
from rarms_iac.running.line_sources import LineSource, source_of
from rarms_iac.running.orders import CannotStart, StartOrder, SupervisorLost, order_as_json

TAIL = 4096
PIECE = 64 * 1024
WAITING = 64
"""So many pieces wait to be read; a component that prints more waits, and rarms' memory stays small."""
CATCH_UP_S = 0.05
"""The two streams have a thread each, which may be so far apart."""
GOING_S = 10.0
"""How much longer than its grace a component's end may take."""
ENGINE_GOING_S = 80.0
"""The same of containers and services, which their engines remove: before their programs are killed, and after."""

_PROGRAM = "supervisor_process_windows.py" if sys.platform == "win32" else "supervisor_process.py"
_OPTIONS = ("-I",) if sys.platform == "win32" else ("-I", "-S")
"""What this Python is started with: the one of Windows finds pywin32 among the installed packages."""


class ReadingInterrupted(Exception):
    """Another thread wants no more of this."""


class Supervisor:
    """A supervisor with a component's process, or none at the moment.

    Raises:
        CannotStart: from `next`, when the process cannot be started.
        SupervisorLost: from anything, when the supervisor is gone.
    """

    def __init__(self, order: StartOrder) -> None:
        self.name = order.name
        is_elsewhere = any(process.ending is not None for process in order.processes)
        self._patience_s = float(order.stop.grace) / 1000 + (ENGINE_GOING_S if is_elsewhere else GOING_S)
        self._mark = secrets.token_hex(16).encode()
        self._events: queue.Queue[list[Event | dict[str, Any]]] = queue.Queue(WAITING)
        self._ready: list[Event | dict[str, Any]] = []
        self._tail = b""
        self._closing = threading.Event()
        self._interrupted = threading.Event()
        self._output_ignored = threading.Event()  # lines are not read: they go nowhere
        self._cpu_ms: float | None = None
        self._seen_threads = ThreadsSeen()
        self._process = subprocess.Popen(
            [sys.executable, *_OPTIONS, str(Path(__file__).resolve().with_name(_PROGRAM))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            bufsize=0,
            start_new_session=True,  # a Ctrl-C in the terminal is for rarms, which then stops the component
        )
        self._threads = [
            threading.Thread(target=self._read_output, args=(self._process.stdout,), daemon=True),
            threading.Thread(target=self._read_errors, args=(self._process.stderr,), daemon=True),
        ]
        self._lines = self._other_lines(order)
        for thread in self._threads:
            thread.start()
        self._send(json.dumps(self._as_json(order)))

    def start(self, at: float = 0.0) -> None:
        """Start the process when `time.perf_counter` is so far."""
        self._send(f"start {at!r}")

    def stop(self) -> None:
        """Ask the process to end, and kill it with all that it started after its grace; `ProcessEnded` comes then."""
        self._send("stop")

    def ignore_output(self) -> None:
        """Drop the lines of this component from now on: they are not read."""
        self._output_ignored.set()

    def interrupt(self) -> None:
        """Have `next` raise `ReadingInterrupted` from now on, in the thread in which it waits."""
        self._interrupted.set()
        with contextlib.suppress(queue.Full):
            self._events.put_nowait([])

    def next(self, until: float | None = None) -> Event | None:
        """Return the next thing that happened.

        None when nothing has by then. What happened already always comes first.
        """
        while not self._ready:
            if self._interrupted.is_set():
                raise ReadingInterrupted
            try:
                # Waited for in short pieces: on Windows a wait without end would not hear a Ctrl-C.
                remaining = None if until is None else until - time.perf_counter()
                self._ready = self._events.get(timeout=0.5 if remaining is None else max(0.0, min(remaining, 0.5)))[
                    ::-1
                ]
            except queue.Empty:
                if until is not None and time.perf_counter() >= until:
                    return None
        if self._interrupted.is_set():
            raise ReadingInterrupted
        event = self._ready.pop()
        return event if not isinstance(event, dict) else self._event_of(event)

    def close(self) -> None:
        """End it all and wait for it; may be called twice."""
        self._closing.set()
        with contextlib.suppress(OSError):
            self._commands().close()
        if self._lines is not None:
            self._lines.close()
        deadline = time.perf_counter() + self._patience_s
        while self._process.poll() is None and time.perf_counter() < deadline:
            with contextlib.suppress(queue.Empty):
                self._note_cpu_time(self._events.get(timeout=0.02))
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        while any(thread.is_alive() for thread in self._threads) and time.perf_counter() < deadline:
            with contextlib.suppress(queue.Empty):
                self._note_cpu_time(self._events.get(timeout=0.02))
        while not self._events.empty():
            self._note_cpu_time(self._events.get_nowait())
        if not any(thread.is_alive() for thread in self._threads):  # else: something escaped with the pipe in its hand
            for pipe in (self._process.stdout, self._process.stderr):
                if pipe is not None:
                    pipe.close()

    @property
    def cpu_ms(self) -> float | None:
        """The processor time of all of the component's processes, once closed; None where it is not known."""
        return self._cpu_ms

    @property
    def threads(self) -> ThreadsSeen:
        """The latest look at threads with a name of `threads`."""
        return self._seen_threads

    @property
    def process(self) -> int:
        """The supervisor's own id."""
        return self._process.pid

    @property
    def tail(self) -> str:
        """The last text of the stream whose lines are not read: standard error, unless the order says otherwise."""
        return self._tail.decode("utf-8", "replace")

    def settled_tail(self) -> str:
        """Return `tail` when the thread that reads it has caught up with what was written before."""
        time.sleep(CATCH_UP_S)
        return self.tail

    def _commands(self) -> IO[bytes]:
        assert self._process.stdin is not None
        return self._process.stdin

    def _other_lines(self, order: StartOrder) -> LineSource | None:
        """Read lines from a file or socket instead of the stream, where the order says so."""
        source = source_of(order)
        if source is not None:
            self._output_ignored.set()
            self._threads.append(threading.Thread(target=source.read, args=(self._take_lines,), daemon=True))
        return source

    def _take_lines(self, events: list[Event | dict[str, Any]]) -> None:
        if not self._closing.is_set():
            self._put(events)

    def _as_json(self, order: StartOrder) -> dict[str, Any]:
        return {
            "mark": self._mark.decode(),
            **order_as_json(order),
        }

    def _send(self, line: str) -> None:
        try:
            self._commands().write(line.encode("ascii") + b"\n")
        except OSError as error:
            raise SupervisorLost(self.name, f"its supervisor (process {self._process.pid}) has ended") from error

    def _event_of(self, message: dict[str, Any]) -> Event:
        match message:
            case {"event": "started", "at": at}:
                return ProcessStarted(at=at)
            case {"event": "ended", "at": at, "code": code, "signal": number, **rest}:
                return ProcessEnded(at=at, code=code, signal=number, process=rest.get("process", ""))
            case {"event": "cannot", "message": reason}:
                raise CannotStart(self.name, reason)
            case _:
                raise SupervisorLost(
                    self.name, f"its supervisor (process {self._process.pid}) ended: {self.tail[-200:]}"
                )

    def _note_cpu_time(self, events: list[Event | dict[str, Any]]) -> None:
        for event in events:
            if isinstance(event, dict) and event.get("event") == "bye":
                self._cpu_ms = event["cpu_ms"]

    def _read_output(self, stream: IO[bytes]) -> None:
        """Read standard output to its end; runs in a thread."""
        lines = LineCutter(self._mark)
        while piece := _read(stream):
            events = [event for event in lines.cut(piece, time.perf_counter()) if not self._is_of_threads(event)]
            if self._closing.is_set() or self._output_ignored.is_set():
                events = [event for event in events if not isinstance(event, OutputLine | OverlongLine)]
            if events:
                self._put(events)
        self._put([{"event": "gone"}])

    def _is_of_threads(self, event: Event | dict[str, Any]) -> bool:
        """Keep the latest message on threads, which nobody waits for."""
        if not isinstance(event, dict) or event.get("event") != "threads":
            return False
        self._seen_threads = ThreadsSeen(
            unmatched=tuple(event["unmatched"]), names=tuple(event["names"]), refused=event["refused"]
        )
        return True

    def _put(self, events: list[Event | dict[str, Any]]) -> None:
        self._events.put(events)

    def _read_errors(self, stream: IO[bytes]) -> None:
        """Keep the end of standard error; runs in a thread."""
        while piece := _read(stream):
            self._tail = (self._tail + piece)[-TAIL:]


def _read(stream: IO[bytes]) -> bytes:
    try:
        return os.read(stream.fileno(), PIECE)
    except (OSError, ValueError):
        return b""
