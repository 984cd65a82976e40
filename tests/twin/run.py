"""Running a script's bytes on the twin: what they say happens, and nothing else."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from rarms_iac.powershell.tree import sound
from tests.twin.expressions import parameters_of
from tests.twin.guests import drop_sessions
from tests.twin.host import Interrupted, Killed, WindowsHost
from tests.twin.scopes import Body, Cmdlet, Exit, Parameter, Scope, Session
from tests.twin.statements import block_of
from tests.twin.values import Enumerated, Record, ScriptError, Table, Value, text

FOLDER = "C:\\run"
"""Where scripts lie on the twin."""

BETWEEN_RUNS_MS = 10_000


@dataclass(frozen=True, slots=True)
class Ran:
    """How a process ended."""

    code: int | None  # None: it was killed
    lines: tuple[str, ...]  # standard output
    talk: tuple[str, ...]

    @property
    def events(self) -> list[dict[str, Any]]:
        """The lines as events."""
        return [json.loads(line) for line in self.lines]

    def status_of(self, address: str) -> list[str]:
        """What was told of an address."""
        return [event["status"] for event in self.events if event["address"] == address]

    @property
    def says(self) -> str:
        """All of it, to be shown where a test fails."""
        return "\n".join((f"exit {self.code}", *self.lines, *self.talk))


@dataclass(slots=True)
class _Compiled:
    parameters: tuple[Parameter, ...]
    body: Body
    impact: str = ""  # what its ConfirmImpact says


@lru_cache(maxsize=64)
def _compiled(script: bytes) -> _Compiled:
    pieces = [_piece(text) for text in re.split(_EDGE, script.decode("ascii"))]

    def body(scope: Scope, out: list[Value]) -> None:
        for piece in pieces:
            piece.body(scope, out)

    impact = re.search(rb"ConfirmImpact = '([A-Za-z]+)'", script)
    parameters = tuple(parameter for piece in pieces for parameter in piece.parameters)
    return _Compiled(parameters, body, impact[1].decode() if impact else "Medium")


_EDGE = r"(?=# --- runtime: )|(?<=-\r\n)(?=# --- part )|(?<=-\r\n)(?=Invoke-(?:Run|Measuring) )"
"""Between what is fixed in scripts and what follows it: the tree of the whole is those of its pieces, one by one."""


@lru_cache(maxsize=64)
def _piece(text: str) -> _Compiled:
    parameters: tuple[Parameter, ...] = ()
    bodies: list[Body] = []
    for part in sound(text).children:
        if part.type == "param_block":
            parameters = parameters_of(part)
        elif part.type == "statement_list":
            bodies.append(block_of(part))
        elif part.type != "comment":
            raise AssertionError(f"{part.type} in a script")
    (body,) = bodies
    return _Compiled(parameters, body)


SIGNED = re.compile(rb"\r\n# SIG # Begin signature block\r\n# ([0-9a-f]{64})\r\n# SIG # End signature block\r\n")


def signed(script: bytes) -> bytes:
    """A script with a made signature: as Windows adds one, with a digest in the place of the certificate's word."""
    digest = hashlib.sha256(script).hexdigest().encode()
    return script + b"\r\n# SIG # Begin signature block\r\n# " + digest + b"\r\n# SIG # End signature block\r\n"


def why_unsigned(script: bytes) -> str:
    """Why a Windows that wants signed scripts refuses this one."""
    found = SIGNED.search(script)
    if found is None or found.end() != len(script):
        return "The file is not digitally signed."
    return "" if signed(script[: found.start()]) == script else "The hash of the file does not match."


def put(host: WindowsHost, scripts: Mapping[str, bytes]) -> None:
    """Lay the scripts where they can be run from."""
    for name, data in scripts.items():
        host.write_file(f"{FOLDER}\\{name}", data)


def run(
    host: WindowsHost,
    name: str,
    *,
    windows_powershell: bool = True,
    what_if: bool = False,
    declined: frozenset[str] = frozenset(),
    as_json: bool = True,
    abandon: bool = False,
    unanswered: bool = False,
    confirm: bool = False,
    force: bool = False,
    dot_sourced: bool = False,
    lock_timeout: int = 0,
    output: list[Value] | None = None,
) -> Ran:
    """Runs the script of this name that lies on the host, as an elevated operator would; its lines go to `output`."""
    file = host.file(f"{FOLDER}\\{name}")
    assert file is not None
    assert file.data is not None
    if host.all_signed and (refusal := why_unsigned(file.data)):
        return Ran(code=1, lines=(), talk=(f"File {file.path} cannot be loaded. {refusal}",))
    session = Session(host, windows_powershell=windows_powershell, path=file.path, what_if=what_if, declined=declined)
    session.unanswered = unanswered
    session.invoked_by = "." if dot_sourced else file.path
    session.confirm = confirm or bool(declined)
    session.output = [] if output is None else output
    host.clock += BETWEEN_RUNS_MS
    code: int | None
    try:
        arguments = {"asjson": as_json, "abandon": abandon, "force": force, "locktimeout": lock_timeout}
        code = _walk(session, _compiled(file.data), arguments)
    except Interrupted:
        code = 0
    except Killed:
        code = None
        drop_sessions(session)
        host.lock = "" if host.lock == "ours" else host.lock
    assert host.lock != "ours", "a process that ends closes its files"
    assert code is None or not session.jobs, "jobs are removed"
    return Ran(code=code, lines=tuple(map(text, session.output)), talk=tuple(session.talk))


def _walk(session: Session, script: _Compiled, arguments: Mapping[str, int]) -> int:
    scope = Scope(session, None)
    scope.variables |= {
        "whatifpreference": session.what_if,
        "confirmpreference": "Low" if session.confirm else "High",
        "psboundparameters": Table([("Confirm", True)] if session.confirm else []),
        "psscriptroot": FOLDER,
        "myinvocation": Record(InvocationName=session.invoked_by),
        "pscommandpath": session.path,
        "pscmdlet": Cmdlet(scope, script.impact),
        "pid": session.process,
        "psversiontable": _versions(session),
        "executioncontext": Record(SessionState=Record(LanguageMode=Enumerated(session.host.language))),
        "psdefaultparametervalues": Table(list(session.host.defaults.items())),
    }
    for parameter in script.parameters:
        scope.variables[parameter.name] = arguments[parameter.name]
    if session.host.profile:
        _compiled(session.host.profile.encode("ascii")).body(scope, session.output)
    try:
        script.body(scope, session.output)
    except Exit as end:
        return end.code
    except ScriptError as error:
        session.talk.append(error.says)
        return 1
    return 0


def _versions(session: Session) -> Value:
    return Table([("PSVersion", session.host.powershell["version"]), ("PSEdition", session.host.powershell["edition"])])


def observe(host: WindowsHost, script: bytes) -> dict[str, Any]:
    """What observe.ps1 prints of the host."""
    looked = host.copy()
    put(looked, {"observe.ps1": script})
    looked.effects = []
    ran = run(looked, "observe.ps1")
    assert ran.code == 0, ran.says
    assert not looked.effects, "looking changes nothing"
    (line,) = ran.lines
    found: dict[str, Any] = json.loads(line)
    return found
