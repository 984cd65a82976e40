"""What the fake's guests do: sessions by PowerShell Direct, and a runner that is interpreted inside, on its own clock.

A runner is a thread that runs only while the host waits for it, so that everything happens in one order.
"""

from __future__ import annotations

import random
import threading
from collections import deque
from collections.abc import Callable, Mapping
from itertools import count

from tests.fake_powershell.host import Interrupted, Process, Vm, WindowsHost
from tests.fake_powershell.scopes import Block, Scope, Session
from tests.fake_powershell.values import (
    EMPTY,
    Enumerated,
    Long,
    Record,
    ScriptError,
    Table,
    Thing,
    Unsupported,
    Value,
    number,
    text,
)

Given = Mapping[str, Value]
BOOT_MS = 20_000
_NUMBERS = count(1000, 4)  # of processes that run blocks in guests
GUARD = "-NoProfile -Command Wait-Process -Id "


def _refused(says: str, error_id: str) -> ScriptError:
    return ScriptError(says, error_id=f"{error_id},PSSessionStateBroken", category="OpenError")


class GuestSession(Thing):
    """What New-PSSession gives."""

    type_name = "System.Management.Automation.Runspaces.PSSession"

    def __init__(self, vm: Vm) -> None:
        super().__init__()
        self.vm = vm
        self.open = True


def new_session(scope: Scope, given: Given) -> GuestSession:
    """PowerShell Direct, with what it refuses (windows.md 7)."""
    host = scope.session.host
    vm = host.vms.get(str(given["vmid"]))
    if vm is None or not host.elevated:
        raise _refused("The input VMId parameter does not resolve to a single virtual machine.", "InvalidVMId")
    if vm.state != "Running" or (vm.started_at or 0) + BOOT_MS > host.clock:
        raise _refused("A remote session might have ended.", "VMSessionEnded")
    if given["credential"].get("UserName") != host.guest_user or given["credential"].get("Secret") != host.guest_secret:
        raise _refused("The credential is invalid.", "InvalidCredential")
    return GuestSession(vm)


def remove_session(scope: Scope, given: Given) -> Value:
    given["session"].open = False
    return EMPTY


class Runner:
    """A block that runs inside a guest: as far as a caller asks what it says until a time."""

    def __init__(self, host: WindowsHost, vm: Vm, block: Block, told: str) -> None:
        self.host, self.vm = host, vm
        self.clock = float(host.clock)
        self.until = self.clock
        self.said: deque[tuple[float, str]] = deque()
        self.state = "Running"
        self.error = ""
        self.process = next(_NUMBERS)
        self.chance = random.Random(f"{vm.name} {told}")
        self._ending = False
        self._go, self._rest = threading.Semaphore(0), threading.Semaphore(0)
        self._thread = threading.Thread(target=self._run, args=(block, told), daemon=True)
        self._thread.start()

    def advance(self, until: float) -> None:
        """Let it run until this time of the host's clock."""
        self.until = until
        while self.state == "Running" and self.clock < until:
            self._go.release()
            self._rest.acquire()

    def end(self) -> None:
        """Stop its pipeline: every `finally` runs."""
        self._ending = True
        while self.state == "Running":
            self._go.release()
            self._rest.acquire()

    def pass_time(self, ms: float) -> None:
        """Its clock goes on, and the host may have something to do."""
        self.clock += ms
        if self.clock >= self.until or self._ending:
            self._rest.release()
            self._go.acquire()
        if self._ending:
            raise Interrupted

    def _run(self, block: Block, told: str) -> None:
        self._go.acquire()
        session = Session(self.host, windows_powershell=True, path="", process=self.process)
        session.runner = self
        scope = Scope(session, None)
        session.state = scope.state
        scope.variables |= {"pid": self.process, "request": told, "psdefaultparametervalues": Table()}
        try:
            block.function.body(scope, _Said(self))
        except Interrupted:
            self.state = "Stopped"
        except ScriptError as error:
            self.state, self.error = "Failed", error.says
        except BaseException as error:  # noqa: BLE001 - a thread's errors are shown to who waits for it
            self.state, self.error = "Failed", f"{type(error).__name__}: {error}"
        else:
            self.state = "Completed"
        self._rest.release()


class _Said(list[Value]):
    def __init__(self, runner: Runner) -> None:
        super().__init__()
        self.runner = runner

    def append(self, value: Value) -> None:
        self.runner.said.append((self.runner.clock, text(value)))

    def extend(self, values: object) -> None:
        for value in values:  # type: ignore[attr-defined]  # what the interpreter gives is a list
            self.append(value)


class Job(Thing):
    """What Invoke-Command -AsJob gives."""

    type_name = "System.Management.Automation.PSRemotingJob"

    def __init__(self, runner: Runner) -> None:
        super().__init__()
        self.runner = runner

    def get(self, name: str) -> Value:
        if name.lower() != "state":
            raise Unsupported(f"{name} of a job")
        return Enumerated(self.runner.state)


def invoke_command(scope: Scope, given: Given) -> Job:
    session, block = given["session"], given["scriptblock"]
    if not given.get("asjob") or not isinstance(session, GuestSession) or not isinstance(block, Block):
        raise Unsupported("Invoke-Command in another form")
    if not session.open or session.vm.state != "Running":
        raise _refused("A remote session might have ended.", "VMSessionEnded")
    runner = Runner(scope.session.host, session.vm, block, text(given["argumentlist"]))
    scope.session.runners.append(runner)
    return Job(runner)


def receive(scope: Scope, job: Job) -> list[Value]:
    host, runner = scope.session.host, job.runner
    runner.advance(float(host.clock))
    if runner.state == "Failed":
        raise ScriptError(runner.error, error_id="JobStateFailed")
    lines: list[Value] = []
    while runner.said and runner.said[0][0] <= host.clock:
        lines.append(runner.said.popleft()[1])
    return lines


def remove_job(scope: Scope, given: Given) -> Value:
    if not given.get("force"):
        raise ScriptError("The command cannot remove the job because it is not finished.", error_id="JobNotFinished")
    given["job"].runner.end()
    return EMPTY


def drop_sessions(session: Session) -> None:
    """The process with the sessions is gone: its guests' runners die without a word, and guards do their work."""
    host = session.host
    for runner in session.runners:
        guarded = any(
            process.alive
            and process.parent == runner.process
            and process.arguments.startswith(f"{GUARD}{runner.process};")
            and "ProcessId -ne $PID" in process.arguments  # it would end itself before the others
            for process in host.processes
        )
        for process in host.processes:
            process.alive &= not (guarded and process.parent == runner.process)


class Stopwatch(Thing):
    """A clock of a guest."""

    def __init__(self, scope: Scope) -> None:
        super().__init__()
        self.session = scope.session
        self.began = self._now()

    def _now(self) -> float:
        runner = self.session.runner
        return float(self.session.host.clock) if runner is None else runner.clock

    def get(self, name: str) -> Value:
        passed = self._now() - self.began
        match name.lower():
            case "elapsedmilliseconds":
                return Long(int(passed))
            case "elapsed":
                return Record(Ticks=Long(int(passed * 10_000)))
            case _:
                raise Unsupported(f"{name} of a stopwatch")


class StartInfo(Thing):
    """How a process is to be started."""

    def __init__(self, program: str, arguments: str) -> None:
        super().__init__(EnvironmentVariables=Table())
        self.program, self.arguments = program, arguments

    def set_useshellexecute(self, value: Value) -> None:
        assert value is False

    def set_workingdirectory(self, value: Value) -> None:
        self.properties["folder"] = text(value)

    def set_redirectstandardoutput(self, value: Value) -> None:
        self.properties["heard"] = value


class Started(Thing):
    """A process as .NET shows it: its program takes the time that its partition's reserve gives."""

    type_name = "System.Diagnostics.Process"

    def __init__(self, runner: Runner, info: StartInfo) -> None:
        super().__init__()
        host = runner.host
        name = info.program.rpartition("\\")[2].lower()
        program = host.programs.get(name)
        if program is None:
            raise ScriptError("The system cannot find the file specified.", error_id="Win32Exception")
        self.runner, self.program = runner, program
        variables = info.get("EnvironmentVariables")
        reserve = next((text(value) for key, value in variables.items() if text(key) == "RARMS_RESERVE"), "")
        self.process = Process(name, info.arguments, runner.process, runner.vm.id, reserve=reserve, began=runner.clock)
        host.processes.append(self.process)
        self.closes = runner.clock + self.takes() if program.work_ms and not program.line else float("inf")
        self.ends = float("inf") if program.stays else self.closes
        self.next = runner.clock + self.takes() if program.line else float("inf")

    def takes(self) -> float:
        share = max(1, self.runner.vm.reserve) / 100
        return self.program.work_ms / share * self.runner.chance.uniform(0.97, 1.03)

    def get(self, name: str) -> Value:
        match name.lower():
            case "hasexited":
                return not self.process.alive
            case "exitcode":
                return self.program.code
            case "standardoutput":
                return self
            case _:
                raise Unsupported(f"{name} of a process")

    def do_readlineasync(self) -> Thing:
        return ReadLine(self)

    def do_kill(self) -> Value:
        if not self.process.alive:
            raise ScriptError("Cannot process request because the process has exited.", error_id="InvalidOperation")
        self.process.alive = False
        self.ends = self.runner.clock
        return EMPTY

    def do_waitforexit(self, ms: Value) -> bool:
        self.wait(min(float(number(ms)), max(0.0, self.ends - self.runner.clock)))
        return not self.process.alive

    def wait(self, ms: float) -> None:
        self.runner.pass_time(ms)
        if self.runner.clock >= self.ends:
            self.process.alive = False


class ReadLine(Thing):
    """A line that is awaited."""

    def __init__(self, process: Started) -> None:
        super().__init__()
        self.process = process
        self.line: str | None = None

    def do_wait(self, ms: Value) -> bool:
        process = self.process
        due = min(process.next, process.closes)
        process.wait(min(float(number(ms)), max(0.0, due - process.runner.clock)))
        if process.runner.clock < due:
            return False
        if process.next <= process.closes:
            took = process.takes()
            self.line, process.next = process.program.line.format(ms=took), process.next + took
        return True

    def get(self, name: str) -> Value:
        if name.lower() != "result":
            raise Unsupported(f"{name} of a task")
        return self.line


def runner_of(scope: Scope) -> Runner:
    """The guest's runner that asks."""
    if scope.session.runner is None:
        raise Unsupported("this is for guests")
    return scope.session.runner


def start_process(scope: Scope, info: StartInfo) -> Started:
    return Started(runner_of(scope), info)


CALLS: dict[tuple[str, str], Callable[..., Value]] = {
    ("diagnostics.stopwatch", "startnew"): Stopwatch,
    ("diagnostics.processstartinfo", "new"): lambda scope, program, arguments: StartInfo(
        text(program), text(arguments)
    ),
    ("diagnostics.process", "start"): start_process,
    ("io.path", "combine"): lambda scope, *parts: "\\".join(map(text, parts)),
    ("io.path", "getfilename"): lambda scope, path: text(path).rpartition("\\")[2],
    ("io.path", "gettemppath"): lambda scope: "C:\\Temp\\",
    ("io.path", "getdirectoryname"): lambda scope, path: text(path).rpartition("\\")[0],
    ("io.file", "writeallbytes"): lambda scope, path, data: scope.session.host.guest_files.__setitem__(
        text(path), bytes(data)
    ),
}
