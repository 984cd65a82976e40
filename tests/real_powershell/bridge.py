"""The model of the host behind a loopback socket: processes of a real PowerShell ask it, one line of JSON each way.

In: calls of the compiled cmdlets, changes that are about to be made, prompts, lines. Out: the model's answers.
Begin with `Bridge`.
"""

from __future__ import annotations

import json
import re
import socket
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from queue import Queue
from typing import Any

from tests.fake_powershell import guests as fake_guests
from tests.fake_powershell import hyperv, windows
from tests.fake_powershell.host import ADMINISTRATORS, Killed, WindowsHost
from tests.fake_powershell.hyperv import Live, StopJob, require_answer
from tests.fake_powershell.values import (
    BEGINNING,
    EMPTY,
    Enumerated,
    Guid,
    Long,
    ScriptError,
    Thing,
    Value,
    elements,
    text,
)
from tests.real_powershell import guests
from tests.real_powershell.disks import Disks

CMDLETS = hyperv.CMDLETS | windows.CMDLETS
Line = dict[str, Any]


@dataclass(slots=True)
class Conversation:
    """What the processes of one run and the model have in common."""

    host: WindowsHost
    disks: Disks
    declined: frozenset[str] = frozenset()
    answers: str = ""
    unanswered: bool = False
    prompts: int = 0
    jobs: list[Value] = field(default_factory=list)
    objects: list[Thing] = field(default_factory=list)  # that a process has in its hands, by their keys
    lines: list[str] = field(default_factory=list)  # an object at the end of the pipeline by its properties
    talk: list[str] = field(default_factory=list)
    _shown: list[str] = field(default_factory=list)  # information that is still among the lines, or will be
    failed: BaseException | None = None  # what no script may catch
    changing: dict[int, int] = field(default_factory=dict)  # by connection: the number of the effect that it makes

    def answer(self, asked: Line, connection: int) -> Line | None:
        """What the process hears; None: it waits for nothing."""
        match next(iter(asked)):
            case "line":
                self._said(asked["line"], asked["stream"])
            case "object":
                self.lines.append(json.dumps(asked["object"]))
            case "progress":
                self.host.progress.append((asked["progress"], asked["percent"]))
            case "about":
                return about(self.host)
            case "read":
                return {"values": _table(self.objects[asked["read"]], self)}
            case "removed":
                self.jobs.remove(self.objects[asked["removed"]])
                return {}
            case "prompt":
                return {"answer": self._prompted(asked["prompt"])}
            case "sleep":
                return self._slept(asked["sleep"])
            case "event":
                return self._logged(*asked["event"])
            case "effect":
                return self._may_fail(lambda: self._begin(asked["effect"], connection))
            case "done":
                return self._may_fail(lambda: self._end(connection))
            case "cmdlet":
                return self._may_fail(lambda: self._call(asked["cmdlet"], asked["given"]))
            case other:
                raise AssertionError(other)
        return None

    def _said(self, line: str, stream: str) -> None:
        """Keep a line. A console shows information, too, so that it is told twice."""
        match stream:
            case "information":
                self.talk.append(line)
                self._shown.append(line)
            case "out":
                self.lines.append(line)
            case _:
                self.talk.append(line)
        for line in [line for line in self._shown if line in self.lines]:
            self.lines.remove(line)
            self._shown.remove(line)

    def _may_fail(self, do: Callable[[], Line]) -> Line:
        try:
            return do() | {"now": self.host.clock}
        except ScriptError as error:
            return {"error": _error(error)}
        except Killed:
            return {"kill": True}

    def _begin(self, says: str, connection: int) -> Line:
        number = len(self.host.effects)
        half = self.host.tear and number == self.host.kill_after
        try:
            self.changing[connection] = self.host.begin_effect(says)
        except ScriptError as error:
            return {"error": error.says}
        return {"half": True} if half else {}

    def _end(self, connection: int) -> Line:
        if self.host.watch:
            self.disks.read_back(self.host)
        self.host.end_effect(self.changing.pop(connection))
        return {}

    def _call(self, name: str, given: Line) -> Line:
        self.disks.read_back(self.host)
        low = name.lower()
        meant = {key: self._from(value) for key, value in given.items()}
        require_answer(self.host, name, meant)
        try:
            if low in guests.CALLS:
                found = guests.CALLS[low](guests.caller(self.host), meant)
            else:
                found = AROUND[low](self, meant) if low in AROUND else CMDLETS[low](self, meant)
        finally:
            self.disks.lay_out(self.host)
        return {"objects": [self._to(one) for one in elements(found)]}

    def _slept(self, ms: int) -> Line:
        host = self.host
        if host.interrupt:
            return {"interrupt": True}
        host.clock += ms
        if host.slept:
            self.disks.read_back(host)
            host.slept(host)
            self.disks.lay_out(host)
        return {"now": host.clock} | ({} if host.opened else {"free": True})

    def _logged(self, kind: str, number: int, says: str) -> Line:
        if self.host.event_log is None or not self.host.elevated:
            return {"error": "The source was not found, but some or all event logs could not be searched."}
        self.host.event_log.append((kind, number, says))
        return {}

    def _prompted(self, message: str) -> int | None:
        """The place of the answer among Yes, Yes to All, No, No to All; None: no console answers."""
        if self.unanswered:
            return None
        self.prompts += 1
        if self.answers:
            answer, self.answers = self.answers[0], self.answers[1:]
            return "YANL".index(answer)
        found = re.search(r'the operation "(.*)" on target "(.*)"\.', message, re.DOTALL)
        assert found, message
        return 2 if set(found.groups()) & self.declined else 0

    def _from(self, value: Any) -> Value:
        match value:
            case {"$key": key}:
                return self.objects[key]
            case list():
                held = [self._from(one) for one in value]
                return held[0] if len(held) == 1 and isinstance(held[0], Thing) else held
            case int() if not isinstance(value, bool):
                return Long(value)
            case _:
                return value

    def _to(self, value: Value) -> Any:
        match value:
            case Live() | StopJob() | fake_guests.GuestSession() | fake_guests.Job():
                self.objects.append(value)
                return {
                    "$live": len(self.objects) - 1,
                    "type": guests.TYPES.get(type(value), value.type_name),
                    "values": _table(value, self),
                }
            case Guid():
                return {"$guid": str(value)}
            case Enumerated():
                return str(value)
            case Thing():
                return {"$object": _table(value, self)}
            case list():
                return [self._to(one) for one in value]
            case Long() | bool() | None:
                return value
            case int():
                return {"$int": value}
            case str():
                return value
            case _:
                raise AssertionError(repr(value))


def about(host: WindowsHost) -> Line:
    """What a process that the tests did not start asks first: who calls it where, and when the model's time began."""
    beginning = BEGINNING.strftime("%Y-%m-%dT%H:%M:%SZ")
    return {
        "computer": host.computer,
        "user": host.user,
        "elevated": host.elevated,
        "hyperv_administrator": host.hyperv_administrator,
        "beginning": beginning,
        "now": host.clock,
    }


def _table(of: Thing, talk: Conversation) -> Line:
    if isinstance(of, StopJob):
        return {"Problem": of.problem} if text(of.get("State")) == "Failed" else {}
    if type(of) in guests.TYPES:
        return dict(guests.properties(of))
    return {name: talk._to(value) for name, value in of.properties.items()}


def _error(error: ScriptError) -> Line:
    return {"id": error.error_id.partition(",")[0], "category": error.category, "message": error.says}


def _owner(talk: Conversation, given: Mapping[str, Value]) -> Value:
    file = talk.host.file(given["literalpath"])
    if TEMPORARY in given["literalpath"].lower():
        return ADMINISTRATORS
    if file is None:
        raise ScriptError(
            f"Cannot find path '{given['literalpath']}'.", error_id="PathNotFound", category="ObjectNotFound"
        )
    return file.owner


def _protect(talk: Conversation, given: Mapping[str, Value]) -> Value:
    path, host = given["literalpath"], talk.host
    if TEMPORARY in path.lower():
        return EMPTY
    rights = re.fullmatch(r"O:BAG:SYD:P\(A;(?:OICI)?;FA;;;(BA|SY)\)\(A;(?:OICI)?;FA;;;(BA|SY)\)", given["sddl"])
    private = re.fullmatch(r"(O:S-1-[0-9-]+)?D:P\(A;OICI;FA;;;S-1-[0-9-]+\)", given["sddl"])
    assert private or (rights and {*rights.groups()} == {"BA", "SY"}), given["sddl"]
    file = host.file(path)
    assert file is not None, path

    def do() -> None:
        file.owner, file.protected = ADMINISTRATORS, not private

    host.effect(f"Set-Acl {path}", do)
    return EMPTY


TEMPORARY = "\\temp\\rarms-"
"""In the path of a folder that the receiver makes for scripts, which the model does not know."""
AROUND = {"get-acl": _owner, "set-acl": _protect}


class Bridge:
    """Listens for the processes of one engine; a runner among them takes orders."""

    def __init__(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.talk: Conversation | None = None
        self.ended: Queue[Line] = Queue()  # how runs ended; {}: the runner is gone
        self.turn = threading.RLock()
        self._runner: socket.socket | None = None
        self._there = threading.Event()
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            threading.Thread(target=self._serve, args=(connection,), daemon=True).start()

    def _serve(self, connection: socket.socket) -> None:
        runs = False
        with suppress(ConnectionError), connection, connection.makefile("rb") as lines:
            for line in lines:
                said = json.loads(line)
                if "runner" in said:
                    runs, self._runner = True, connection
                    self._there.set()
                elif said.keys() & {"exit", "killed", "broken"}:
                    self.ended.put(said)
                else:
                    self._reply(connection, said)
        if runs:
            self._there.clear()
            self.ended.put({})

    def _reply(self, connection: socket.socket, said: Line) -> None:
        with self.turn:
            talk = self.talk
            if talk is None:  # of a run that is over
                connection.shutdown(socket.SHUT_RDWR)
                return
            try:
                answer = talk.answer(said, connection.fileno())
            except BaseException as error:  # noqa: BLE001 - raised again, to who waits for the run
                talk.failed, answer = error, {"kill": True}
            if answer is not None:
                send(connection, answer)

    def wait_for_runner(self, timeout_s: float) -> bool:
        """Whether a runner is there."""
        return self._there.wait(timeout_s)

    def order(self, order: Line) -> None:
        """Have the runner run a script."""
        assert self._runner is not None
        send(self._runner, order)

    def close(self) -> None:
        """No process comes any more; the runner ends."""
        self._listener.close()
        if self._runner is not None:
            with suppress(OSError):  # it has ended
                self._runner.shutdown(socket.SHUT_RDWR)


def send(connection: socket.socket, value: Line) -> None:
    connection.sendall(json.dumps(value).encode() + b"\n")
