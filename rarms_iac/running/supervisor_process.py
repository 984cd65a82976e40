"""Supervises one component's processes: starts them, asks them to end, and leaves none behind. A program of its own.

An order has one process or several, which start in its order, all or none, and end together: with the first that ends.
A container or service runs elsewhere than below this process; words of the order end it.

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
import importlib.util
import json
import os
import select
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36
KILLING_S = 5.0
"""How long killed processes may take to be gone: one that waits for a disk cannot be hurried."""
ENGINE_S = 3.0
"""How much longer than a component's grace its container's engine, or systemd, may take to end it."""
REMOVING_S = 30.0
"""How long the removal of containers may take: one that is interrupted leaves half of a container behind."""
CLIENT_S = 2.0
"""How long an engine's program may take to end by itself after its container's end."""
PAUSE_S = 0.02
CANNOT = 127
"""The exit code of a component that cannot be started, as of a shell."""
IGNORED = [getattr(signal, name) for name in ("SIGINT", "SIGHUP", "SIGTERM") if hasattr(signal, name)]
"""What a terminal or a service manager sends to everybody: the supervisor ends when rarms does, not before."""


class PosixSupervisor:
    """The supervisor's loop: the processes of one start at a time, and all that they start."""

    def __init__(self, order: dict[str, Any], commands: bytes) -> None:
        self._order = order
        self._commands = commands
        self._mark = order["mark"].encode()
        self._prctl = ctypes.CDLL(None, use_errno=True).prctl if sys.platform == "linux" else None
        self._due: float | None = None  # when the next process is to start
        self._pids: dict[int, dict[str, Any]] = {}  # the component's own processes that run, or have ended last
        self._running: set[int] = set()  # of these
        self._uncertain: list[dict[str, Any]] = []  # whose container or service may run on without its engine's program
        self._exit: dict[str, Any] | None = None  # how the first ended, while something that they started still runs
        self._starts = 0
        self._is_silent = False  # not all were started: no end is reported
        self._asked = False
        self._kill_at: float | None = None
        self._ending = False
        self._threads = ThreadKeeper(order["threads"], order["groups"], self._send_event) if order["threads"] else None
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
        while not (self._ending and not self._pids and self._due is None):
            self._wait()
            self._reap()
            self._kill()
            if self._threads is not None and self._pids:
                self._threads.look_if_due()
            if self._due is not None and not self._pids and time.perf_counter() >= self._due:
                self._start()
        self._send_event(event="bye", cpu_ms=cpu_ms())

    def _wait(self) -> None:
        now = time.perf_counter()
        due = self._due if not self._pids else None
        look = self._threads.due if self._threads is not None and self._pids else None
        soon = [moment - now for moment in (due, self._kill_at, look) if moment is not None]
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
        if self._pids and not self._asked:
            self._asked = True
            self._ask()

    def _ask(self) -> None:
        """Ask everything to end, and note when it is to be killed."""
        endings = self._endings()
        self._kill_at = time.perf_counter() + self._order["grace_ms"] / 1000 + (ENGINE_S if endings else 0.0)
        if self._order["signal"] == "KILL":
            self._kill_at = time.perf_counter()
            return
        for process, ending in endings:
            run_words(process, ending["stop"])
        self._signal_all(getattr(signal, "SIG" + self._order["signal"]))

    def _endings(self) -> list[tuple[dict[str, Any], dict[str, Any]]]:
        return [(process, process["ending"]) for process in self._pids.values() if process["ending"]]

    def _signal_all(self, number: int) -> None:
        """Signal every process below this one, but only SIGKILL to those that belong to a container's engine."""
        if self._prctl is None:
            targets = [-pid for pid in self._pids]  # their process groups
        elif number != signal.SIGKILL and self._endings():
            sessions = {pid for pid, process in self._pids.items() if not process["ending"]}
            targets = [pid for pid in descendants(os.getpid()) if session_of(pid) in sessions]
        else:
            targets = descendants(os.getpid())
        for pid in targets:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(pid, number)

    def _start(self) -> None:
        self._due = None
        self._starts += 1
        self._send_event(event="started", at=time.perf_counter())
        for each in self._order["processes"]:
            process = of_start(each, self._starts)
            problem = self._start_one(process)
            if problem:
                self._abandon()
                where = f"its process {process['name']}: " if process["name"] else ""
                self._send_event(event="cannot", message=where + problem)
                return

    def _abandon(self) -> None:
        """End the processes that started before one that cannot, without a report."""
        self._asked, self._is_silent = True, True
        if self._pids:
            self._kill_at = time.perf_counter()
            self._kill()
        self._asked, self._is_silent = False, False

    def _start_one(self, process: dict[str, Any]) -> str:
        """Start a process; return what keeps it from that, if anything does."""
        if unwritten := write_variables(process["variables"]):
            return unwritten
        problem, report = os.pipe()  # closed by a successful exec
        pid = os.fork()
        if not pid:
            self._exec_component(process, report)
        os.close(report)
        problem_text = b""
        while piece := os.read(problem, 4096):
            problem_text += piece
        os.close(problem)
        if problem_text:
            os.waitpid(pid, 0)
            remove_variables(process["variables"])
        else:
            self._pids[pid] = process
            self._running.add(pid)
        return problem_text.decode("utf-8", "replace")

    def _exec_component(self, process: dict[str, Any], report: int) -> None:
        """Become the component, in the new process, or report why not."""
        try:
            os.setsid()
            signal.set_wakeup_fd(-1)
            for number in (*IGNORED, signal.SIGCHLD, signal.SIGPIPE, signal.SIGXFSZ):
                signal.signal(number, signal.SIG_DFL)
            if self._prctl is not None:
                self._prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
            for file in process["join"]:
                Path(file).write_text(str(os.getpid()), encoding="ascii")
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            if process["stream"] == "stderr":
                output = os.dup(1)
                os.dup2(2, 1)
                os.dup2(output, 2)
                os.close(output)
            elif process["stream"] is None:
                os.dup2(2, 1)
            os.chdir(process["folder"])
            os.execve(process["words"][0], process["words"], process["environment"])  # noqa: S606 - so it is meant
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
            if pid in self._pids:
                self._running.discard(pid)
                code, process = os.waitstatus_to_exitcode(status), self._pids[pid]
                if process["ending"] and (code < 0 or (code and not self._asked and self._exit is None)):
                    self._uncertain.append(process)
                if self._exit is None:
                    self._note_exit(process, code)
        if self._exit is not None and not alive:
            self._ended()

    def _note_exit(self, process: dict[str, Any], code: int) -> None:
        """Note the first end; the others are asked to end, and what an only process left behind goes at once."""
        self._exit = {"at": time.perf_counter(), "code": max(code, 0), "signal": max(-code, 0)}
        if process["name"] and process["stream"] is None:
            self._exit["process"] = process["name"]
        if self._asked:
            return
        if len(self._order["processes"]) > 1:
            self._ask()
        else:
            self._kill_at = self._exit["at"]

    def _kill(self) -> None:
        if self._kill_at is None or time.perf_counter() < self._kill_at:
            return
        remove([process for process, _ in self._endings()])
        until = time.perf_counter() + CLIENT_S
        while any(pid in self._running for pid, process in self._pids.items() if process["ending"]):
            if time.perf_counter() > until:  # it has not made its container yet: `_ended` looks again
                break
            self._pause()
        until = time.perf_counter() + KILLING_S
        while self._pids and time.perf_counter() < until:
            self._signal_all(signal.SIGKILL)
            self._pause()
        if self._pids:  # something cannot be killed: another user's process, or one that waits for a disk
            self._exit = self._exit or {"at": time.perf_counter(), "code": 0, "signal": int(signal.SIGKILL)}
            self._ended()

    def _pause(self) -> None:
        """Wait a moment, or until something ends."""
        select.select([self._woken], [], [], PAUSE_S)
        with contextlib.suppress(BlockingIOError):
            os.read(self._woken, 4096)
        self._reap()

    def _ended(self) -> None:
        remove(self._uncertain)
        for process in self._pids.values():
            remove_variables(process["variables"])
        self._uncertain, self._running = [], set()
        if not self._is_silent:
            self._send_event(event="ended", **(self._exit or {}))
        self._pids, self._exit, self._asked, self._kill_at = {}, None, False, None

    def _send_event(self, **fields: object) -> None:
        """Write once: a pipe does not tear that, and the component may have left a line without end."""
        os.write(1, b"\n" + self._mark + json.dumps(fields).encode() + b"\n")


class ComponentItself(PosixSupervisor):
    """Is the component: it starts at once, keeps the standard streams, and ends with it, or when it is asked to."""

    def __init__(self, order: dict[str, Any]) -> None:
        super().__init__(order, b"start 0\n")
        self.code = 0
        for number in IGNORED:
            signal.signal(number, lambda *_: self._stop())
        self._ending = True

    def _wait(self) -> None:
        if self._due is None or self._pids:  # a signal wakes it, too
            super()._wait()

    def _send_event(self, **fields: object) -> None:
        match fields:
            case {"event": "ended", "code": int(code), "signal": int(number)}:
                self.code = 128 + number if number else code
            case {"event": "cannot", "message": str(message)}:
                self.code = CANNOT
                os.write(2, f"rarms: {message}\n".encode())
            case _:
                pass


def of_start(process: dict[str, Any], number: int) -> dict[str, Any]:
    """Return a process with a name of its own for the container or service of this start."""
    ending = process["ending"]
    if not ending:
        return process
    unit = ending["unit"]
    stem, dot, suffix = unit.partition(".")
    own = f"{stem}-{number}{dot}{suffix}"

    def named(words: list[str]) -> list[str]:
        return [word.replace(unit, own) for word in words]

    ending = {**ending, "unit": own, "stop": named(ending["stop"]), "remove": [*map(named, ending["remove"])]}
    variables = {**process["variables"], "path": process["variables"]["path"].replace(unit, own)}
    return {**process, "words": named(process["words"]), "ending": ending, "variables": variables}


def write_variables(file: dict[str, str] | None) -> str:
    """Write the file of a container's or service's variables, for this user alone; return what keeps it from that."""
    if file is None:
        return ""
    try:
        handle = os.open(file["path"], os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(handle, "w", encoding="utf-8", errors="surrogateescape") as opened:
            opened.write(file["text"])
    except OSError as error:
        return f"{file['path']}: {error.strerror or error}"
    return ""


def remove_variables(file: dict[str, str] | None) -> None:
    """Remove the file of a container's or service's variables."""
    if file is not None:
        with contextlib.suppress(OSError):
            Path(file["path"]).unlink()


def remove(processes: list[dict[str, Any]]) -> None:
    """End containers and services at once, all of them in the time of one; they may be gone."""
    until = time.perf_counter() + REMOVING_S
    for step in range(max((len(process["ending"]["remove"]) for process in processes), default=0)):
        commands = [(process, process["ending"]["remove"][step : step + 1]) for process in processes]
        for pid in [run_words(process, words) for process, rest in commands for words in rest]:
            wait_for(pid, until)


def run_words(process: dict[str, Any], words: list[str]) -> int:
    """Start a program of a container's engine or of systemd, without output; return its id."""
    null = [(os.POSIX_SPAWN_OPEN, number, os.devnull, os.O_RDWR, 0) for number in (0, 1, 2)]
    with contextlib.suppress(OSError):
        return os.posix_spawn(words[0], words, process["environment"], file_actions=null, setsid=True)
    return 0


def wait_for(pid: int, until: float) -> None:
    """Wait for a program to end, at most until `time.perf_counter` is so far."""
    with contextlib.suppress(ChildProcessError):
        while pid and time.perf_counter() < until and os.waitpid(pid, os.WNOHANG) == (0, 0):
            time.sleep(PAUSE_S)


def session_of(pid: int) -> int:
    """Return the session of a process; 0: it has ended."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        return os.getsid(pid)
    return 0


class ThreadKeeper:
    """Gives the component's threads their priority by name, and sends what it saw when that changed."""

    def __init__(self, rules: list[Any], groups: list[str], send: Callable[..., None]) -> None:
        path = Path(__file__).resolve().with_name("thread_priorities.py")
        spec = importlib.util.spec_from_file_location("thread_priorities", path)
        assert spec is not None
        assert spec.loader is not None
        self._program = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(self._program)
        self._priorities = self._program.ThreadPriorities([self._program.ThreadRule(*rule) for rule in rules])
        self._groups = groups
        self._send = send
        self._sent: dict[str, Any] = {}
        self.due = 0.0  # of the next look

    def look_if_due(self) -> None:
        """Look, unless the last look was a moment ago."""
        now = time.perf_counter()
        if now < self.due:
            return
        self.due = now + self._program.LOOK_EVERY_S
        self._priorities.look(self._program.members(self._groups) if self._groups else descendants(os.getpid()))
        if (seen := self._priorities.seen()) != self._sent:
            self._send(event="threads", **seen)
            self._sent = seen


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


def become(order: dict[str, Any]) -> int:
    """Be the component of an order until it ends; return its exit code."""
    for process in order["processes"]:
        process["stream"] = "stdout"
    itself = ComponentItself({"mark": "", **order})
    itself.run()
    return itself.code


def main() -> None:
    """Read the order, then keep."""
    received = b""
    while b"\n" not in received:
        piece = os.read(0, 65536)
        if not piece:
            return
        received += piece
    order, _, commands = received.partition(b"\n")
    wanted = json.loads(order)
    if not wanted["keeps_priority"]:
        keep_priority()
    with contextlib.suppress(BrokenPipeError):
        PosixSupervisor(wanted, commands).run()


if __name__ == "__main__":
    if len(sys.argv) > 1:  # the number of the file with the order of the component that this process is
        with os.fdopen(int(sys.argv[1])) as file:
            received_order = json.load(file)
        sys.exit(become(received_order))
    for ignored in IGNORED:
        signal.signal(ignored, signal.SIG_IGN)
    main()
