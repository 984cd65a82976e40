"""Supervises one component's processes: starts them, asks them to end, and leaves none behind. A program of its own.

rarms starts it as a process between itself and the component, since only a process that outlives rarms can clear up
when rarms is killed: its standard input is the lifeline. It adopts what the component's processes leave behind, sends
the processor time of all of them, and needs the standard library only. `supervisor.py` is the other end.

Standard input, a line each: the order (a JSON object), then `start <time>`, `stop`; its end ends everything.
Standard output has the lines of the component's stream that the order names, and between them the supervisor's
messages, in lines that begin with the order's mark. Standard error has the component's other stream.
Times are those of `time.perf_counter`, which all processes of a system share.
"""

import contextlib
import ctypes
import json
import os
import select
import signal
import sys
import time
from pathlib import Path
from typing import Any

PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36
KILLING_S = 5.0
"""How long killed processes may take to be gone: one that waits for a disk cannot be hurried."""
PAUSE_S = 0.02
IGNORED = [getattr(signal, name) for name in ("SIGINT", "SIGHUP", "SIGTERM") if hasattr(signal, name)]
"""What a terminal or a service manager sends to everybody: the supervisor ends when rarms does, not before."""


class PosixSupervisor:
    """The supervisor's loop: one component's process at a time, and all that it starts."""

    def __init__(self, order: dict[str, Any], commands: bytes) -> None:
        self._order = order
        self._commands = commands
        self._mark = order["mark"].encode()
        self._prctl = ctypes.CDLL(None, use_errno=True).prctl if sys.platform == "linux" else None
        self._due: float | None = None  # when the next process is to start
        self._pid = 0  # the component's own process; 0: none
        self._exit: dict[str, Any] | None = None  # how it ended, while something that it started still runs
        self._asked = False
        self._kill_at: float | None = None
        self._ending = False
        self._woken, self._wake = os.pipe()
        if self._prctl is not None:
            self._prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)

    def run(self) -> None:
        """Obey until standard input ends."""
        os.set_blocking(self._wake, False)
        os.set_blocking(self._woken, False)
        signal.set_wakeup_fd(self._wake)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        self._handle_commands()
        while not (self._ending and not self._pid):
            self._wait()
            self._reap()
            self._kill()
            if self._due is not None and not self._pid and time.perf_counter() >= self._due:
                self._start()
        self._send_event(event="bye", cpu_ms=cpu_ms())

    def _wait(self) -> None:
        now = time.perf_counter()
        due = self._due if not self._pid else None
        soon = [moment - now for moment in (due, self._kill_at) if moment is not None]
        listens = [self._woken] if self._ending else [self._woken, 0]
        ready, _, _ = select.select(listens, [], [], max(0.0, min(soon)) if soon else None)
        if self._woken in ready:
            with contextlib.suppress(BlockingIOError):
                os.read(self._woken, 4096)
        if 0 in ready:
            received = os.read(0, 65536)
            self._commands += received
            if not received:
                self._commands += b"end\n"
            self._handle_commands()

    def _handle_commands(self) -> None:
        while b"\n" in self._commands:
            line, _, self._commands = self._commands.partition(b"\n")
            word, _, value = line.decode("ascii").partition(" ")
            if word == "start":
                self._due = float(value)
            elif word in {"stop", "end"}:
                self._ending = self._ending or word == "end"
                self._stop()

    def _stop(self) -> None:
        self._due = None
        if not self._pid or self._asked:
            return
        self._asked = True
        self._kill_at = time.perf_counter() + self._order["grace_ms"] / 1000
        if self._order["signal"] == "KILL":
            self._kill_at = time.perf_counter()
        else:
            self._signal_all(getattr(signal, "SIG" + self._order["signal"]))

    def _signal_all(self, number: int) -> None:
        for pid in descendants(os.getpid()) if self._prctl else [-self._pid]:  # negative: its process group
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(pid, number)

    def _start(self) -> None:
        self._due = None
        problem, report = os.pipe()  # closed by a successful exec
        self._send_event(event="started", at=time.perf_counter())
        self._pid = os.fork()
        if not self._pid:
            self._exec_component(report)
        os.close(report)
        problem_text = b""
        while piece := os.read(problem, 4096):
            problem_text += piece
        os.close(problem)
        if problem_text:
            os.waitpid(self._pid, 0)
            self._pid = 0
            self._send_event(event="cannot", message=problem_text.decode("utf-8", "replace"))

    def _exec_component(self, report: int) -> None:
        """Become the component, in the new process, or report why not."""
        try:
            os.setsid()
            signal.set_wakeup_fd(-1)
            for number in (*IGNORED, signal.SIGCHLD, signal.SIGPIPE, signal.SIGXFSZ):
                signal.signal(number, signal.SIG_DFL)
            if self._prctl is not None:
                self._prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
            for file in self._order["join"]:
                Path(file).write_text(str(os.getpid()), encoding="ascii")
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            if self._order["stream"] == "stderr":
                output = os.dup(1)
                os.dup2(2, 1)
                os.dup2(output, 2)
                os.close(output)
            os.chdir(self._order["folder"])
            os.execve(self._order["words"][0], self._order["words"], self._order["environment"])  # noqa: S606 - so it is meant
        except BaseException as error:  # noqa: BLE001 - after any error this process must not go on as a second supervisor
            named = f"{error.filename}: " if isinstance(error, OSError) and error.filename else ""
            text = (error.strerror if isinstance(error, OSError) else "") or str(error) or type(error).__name__
            os.write(report, (named + text).encode("utf-8", "replace")[:4000])
        finally:
            os._exit(127)

    def _reap(self) -> None:
        alive = True
        while alive:
            try:
                pid, status = os.waitpid(-1, os.WNOHANG)
            except ChildProcessError:
                alive = False
                break
            if not pid:
                break
            if pid == self._pid:
                code = os.waitstatus_to_exitcode(status)
                self._exit = {"at": time.perf_counter(), "code": max(code, 0), "signal": max(-code, 0)}
                if not self._asked:
                    self._kill_at = self._exit["at"]  # what it left behind goes at once
        if self._exit is not None and not alive:
            self._ended()

    def _kill(self) -> None:
        if self._kill_at is None or time.perf_counter() < self._kill_at:
            return
        until = time.perf_counter() + KILLING_S
        while self._pid and time.perf_counter() < until:
            self._signal_all(signal.SIGKILL)
            select.select([self._woken], [], [], PAUSE_S)
            with contextlib.suppress(BlockingIOError):
                os.read(self._woken, 4096)
            self._reap()
        if self._pid:  # something cannot be killed: another user's process, or one that waits for a disk
            self._exit = self._exit or {"at": time.perf_counter(), "code": 0, "signal": int(signal.SIGKILL)}
            self._ended()

    def _ended(self) -> None:
        self._send_event(event="ended", **(self._exit or {}))
        self._pid, self._exit, self._asked, self._kill_at = 0, None, False, None

    def _send_event(self, **fields: object) -> None:
        """Write once: a pipe does not tear that, and the component may have left a line without end."""
        os.write(1, b"\n" + self._mark + json.dumps(fields).encode() + b"\n")


def descendants(of: int) -> list[int]:
    """List every process that this one started, and theirs, as far as /proc shows them."""
    children: dict[int, list[int]] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError, ValueError, IndexError):
            stat = (folder / "stat").read_text(encoding="utf-8", errors="replace")
            children.setdefault(int(stat.rpartition(")")[2].split()[1]), []).append(int(folder.name))
    found, look = [], [of]
    while look:
        below = children.get(look.pop(), [])
        found += below
        look += below
    return found


def cpu_ms() -> float:
    """Return the processor time of everything that was started and is gone."""
    import resource

    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return 1000 * (used.ru_utime + used.ru_stime)


def keep_priority() -> None:
    """Leave a real-time priority, where rarms has one, to this process: what it starts has the usual one."""
    if sys.platform == "linux" and (policy := os.sched_getscheduler(0)) in {os.SCHED_FIFO, os.SCHED_RR}:
        os.sched_setscheduler(0, policy | os.SCHED_RESET_ON_FORK, os.sched_getparam(0))


def main() -> None:
    """Read the order, then keep."""
    keep_priority()
    received = b""
    while b"\n" not in received:
        piece = os.read(0, 65536)
        if not piece:
            return
        received += piece
    order, _, commands = received.partition(b"\n")
    with contextlib.suppress(BrokenPipeError):
        PosixSupervisor(json.loads(order), commands).run()


if __name__ == "__main__":
    for ignored in IGNORED:
        signal.signal(ignored, signal.SIG_IGN)
    main()
