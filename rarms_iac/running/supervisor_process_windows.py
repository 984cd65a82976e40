"""The supervisor where there are no signals: the same orders and the same words as `supervisor_process.py`, on Windows.

Job objects do what process groups and adoption do there: the supervisor and everything below it are in one that ends
with the supervisor, and every process of the component is in one of its own besides. There is nothing to ask with but
Ctrl-Break; a process that it cannot reach is ended at once.
"""

import contextlib
import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from typing import Any

import win32job
import win32process

NEW_GROUP = 0x200
CRASHED = 0xC0000000


def new_job() -> Any:
    """Return a job object whose processes end with its last handle."""
    job = win32job.CreateJobObject(None, "")
    limits = win32job.QueryInformationJobObject(job, win32job.JobObjectExtendedLimitInformation)
    limits["BasicLimitInformation"]["LimitFlags"] |= win32job.JOB_OBJECT_LIMIT_KILL_ON_JOB_CLOSE
    win32job.SetInformationJobObject(job, win32job.JobObjectExtendedLimitInformation, limits)
    return job


def end_job(job: Any) -> float | None:
    """End every process of the job; the processor time that they had in ms, None where it is not known."""
    win32job.TerminateJobObject(job, 1)
    used = win32job.QueryInformationJobObject(job, win32job.JobObjectBasicAccountingInformation)
    hundreds_ns: int = used["TotalUserTime"] + used["TotalKernelTime"]
    return hundreds_ns / 10_000 or None


class WindowsSupervisor:
    """One component's process at a time, and all that it starts."""

    def __init__(self, order: dict[str, Any]) -> None:
        self._order = order
        self._commands: queue.Queue[tuple[str, float]] = queue.Queue()
        self._due: float | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._job: Any = None
        self._kill_at: float | None = None
        self._cpu_ms: float | None = 0.0

    def run(self) -> None:
        """Obey until standard input ends."""
        threading.Thread(target=self._read_commands, daemon=True).start()
        ending = False
        while not (ending and self._process is None):
            word, at = self._next()
            if word == "start":
                self._due = at
            elif word in {"stop", "end"}:
                ending = ending or word == "end"
                self._stop()
            elif word == "exit":
                self._ended(at)
            now = time.perf_counter()
            if self._kill_at is not None and now >= self._kill_at and self._process is not None:
                self._process.kill()
                self._kill_at = None
            if self._due is not None and self._process is None and now >= self._due:
                self._start()
        self._send_event(event="bye", cpu_ms=self._cpu_ms)

    def _read_commands(self) -> None:
        for line in sys.stdin.buffer:
            word, _, value = line.decode("ascii").strip().partition(" ")
            self._commands.put((word, float(value or 0)))
        self._commands.put(("end", 0.0))

    def _next(self) -> tuple[str, float]:
        due = self._due if self._process is None else None
        soon = [moment - time.perf_counter() for moment in (due, self._kill_at) if moment is not None]
        try:
            return self._commands.get(timeout=max(0.0, min(soon)) if soon else None)
        except queue.Empty:
            return "", 0.0

    def _start(self) -> None:
        self._due = None
        self._send_event(event="started", at=time.perf_counter())
        (process,) = self._order["processes"]  # several are Linux's
        is_swapped = process["stream"] == "stderr"
        try:
            self._process = subprocess.Popen(
                process["words"],
                stdin=subprocess.DEVNULL,
                stdout=2 if is_swapped else None,
                stderr=1 if is_swapped else None,
                cwd=process["folder"],
                env=process["environment"],
                creationflags=NEW_GROUP,
            )
        except OSError as error:
            self._send_event(event="cannot", message=f"{process['words'][0]}: {error.strerror or error!r}")
            return
        self._job = new_job()
        win32job.AssignProcessToJobObject(self._job, int(self._process._handle))  # type: ignore[attr-defined]  # noqa: SLF001 - Windows only
        threading.Thread(target=self._watch, args=(self._process,), daemon=True).start()

    def _watch(self, process: "subprocess.Popen[bytes]") -> None:
        process.wait()
        self._commands.put(("exit", time.perf_counter()))

    def _stop(self) -> None:
        self._due = None
        if self._process is None or self._kill_at is not None:
            return
        self._kill_at = time.perf_counter()
        if self._order["signal"] != "KILL":
            with contextlib.suppress(OSError):
                os.kill(self._process.pid, signal.CTRL_BREAK_EVENT)  # type: ignore[attr-defined]  # Windows only
                self._kill_at += self._order["grace_ms"] / 1000

    def _ended(self, at: float) -> None:
        code = (self._process.returncode if self._process else 0) or 0
        used = None if self._job is None else end_job(self._job)
        self._cpu_ms = None if used is None or self._cpu_ms is None else self._cpu_ms + used
        self._process, self._job, self._kill_at = None, None, None
        crashed = code % 2**32 >= CRASHED
        self._send_event(event="ended", at=at, code=0 if crashed else code, signal=code % 2**32 if crashed else 0)

    def _send_event(self, **fields: object) -> None:
        os.write(1, b"\n" + self._order["mark"].encode() + json.dumps(fields).encode() + b"\n")


def main() -> None:
    """Read the order, then keep."""
    order = sys.stdin.buffer.readline()
    if order:
        job = new_job()
        win32job.AssignProcessToJobObject(job, win32process.GetCurrentProcess())
        with contextlib.suppress(OSError):
            WindowsSupervisor(json.loads(order)).run()
    os._exit(0)  # the job object goes with the supervisor, and all that is left in it


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    main()
