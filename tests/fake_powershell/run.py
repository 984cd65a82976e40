"""Running a script's bytes on the fake: what they say happens, and nothing else."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tests.fake_powershell.commands import defaults_of
from tests.fake_powershell.compiling import compiled
from tests.fake_powershell.guests import drop_sessions
from tests.fake_powershell.host import Interrupted, Killed, WindowsHost
from tests.fake_powershell.scopes import HERE, Cmdlet, Exit, Function, Scope, Session
from tests.fake_powershell.signing import why_unsigned
from tests.fake_powershell.values import Enumerated, Record, ScriptError, Table, Value, text

FOLDER = HERE
"""Where scripts lie on the fake."""

BETWEEN_RUNS_MS = 10_000


@dataclass(frozen=True, slots=True)
class Ran:
    """How a process ended."""

    code: int | None  # None: it was killed
    lines: tuple[str, ...]  # standard output
    talk: tuple[str, ...]
    prompts: int = 0  # how often a person was asked

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


@dataclass(frozen=True, slots=True)
class Look:
    """A run of the stand-in with the host before and after it."""

    before: WindowsHost
    after: WindowsHost
    name: str
    how: Mapping[str, Any]
    ran: Ran
    output: Sequence[Value]


beside: Callable[[Look], None] | None = None
"""Who looks at every run: another engine does the same and compares."""


def put(host: WindowsHost, scripts: Mapping[str, bytes]) -> None:
    """Lay the scripts where they can be run from."""
    for name, data in scripts.items():
        host.write_file(f"{FOLDER}\\{name}".replace("/", "\\"), data)


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
    test: bool = False,
    verbose: bool = False,
    dot_sourced: bool = False,
    lock_timeout: int = 0,
    at_prompt: bool = False,
    answers: str = "",
    output: list[Value] | None = None,
) -> Ran:
    """Runs the script of this name that lies on the host, as an elevated operator would; its lines go to `output`.

    A run that is looked at (see `beside`) is heard of with its options, after it ended.
    """
    how = {option: value for option, value in locals().items() if option not in ("host", "name", "output")}
    before = copy.deepcopy(host) if beside else None
    file = host.file(f"{FOLDER}\\{name}")
    assert file is not None
    assert file.data is not None
    if host.all_signed and (refusal := why_unsigned(file.data)):
        return Ran(code=1, lines=(), talk=(f"File {file.path} cannot be loaded. {refusal}",))
    session = Session(host, windows_powershell=windows_powershell, path=file.path, declined=declined)
    session.unanswered, session.answers = unanswered, answers
    session.invoked_by = "." if dot_sourced else file.path
    session.output = [] if output is None else output
    host.clock += BETWEEN_RUNS_MS
    given: dict[str, bool | int] = {"asjson": as_json, "abandon": abandon, "force": force, "locktimeout": lock_timeout}
    given |= {"test": test, "verbose": verbose}
    if what_if:
        given["whatif"] = True
    if confirm or declined or answers:
        given["confirm"] = True
    code: int | None
    try:
        code = walk(session, compiled(file.data), given, at_prompt=at_prompt)
    except Interrupted:
        code = 0
    except Killed:
        code = None
        drop_sessions(session)
        host.close_all()
    assert not host.opened_here, "a process that ends closes its files"
    assert code is None or not session.jobs, "jobs are removed"
    ran = Ran(code=code, lines=tuple(map(text, session.output)), talk=tuple(session.talk), prompts=session.prompts)
    if beside and before is not None:
        beside(Look(before=before, after=host, name=name, how=how, ran=ran, output=session.output))
    return ran


def walk(session: Session, script: Function, given: Mapping[str, bool | int], *, at_prompt: bool = False) -> int:
    """Runs a script as `-File` does, in the global scope, or as `&` does at a prompt, below it."""
    outermost = Scope(session, None)
    session.state = outermost.state
    outermost.variables |= {
        "whatifpreference": False,
        "confirmpreference": "High",
        "pid": session.process,
        "psversiontable": _versions(session),
        "executioncontext": Record(SessionState=Record(LanguageMode=Enumerated(session.host.language))),
        "psdefaultparametervalues": Table(list(session.host.defaults.items())),
    }
    if session.host.profile:
        compiled(session.host.profile.encode("ascii")).body(outermost, session.output)
    scope = Scope(session, outermost, is_script=True) if at_prompt else outermost
    scope.state.current = scope
    name = session.path.rpartition("\\")[2]
    defaults = {key: bool(value) for key, value in defaults_of(outermost, name).items() if key in _WRITTEN}
    given = {**defaults, **given}
    given_to_script(scope, script, given, session.path, session.invoked_by)
    try:
        script.body(scope, session.output)
    except Exit as end:
        return end.code
    except ScriptError as error:
        session.talk.append(error.says)
        return 1
    return 0


def given_to_script(
    scope: Scope, script: Function, given: Mapping[str, bool | int], path: str, invoked_by: str
) -> None:
    """What PowerShell gives a script by itself, and its parameters."""
    what_if = bool(given["whatif"]) if "whatif" in given else None
    confirm = bool(given.get("confirm")) or None
    bound = Table([(_WRITTEN[name], value) for name, value in given.items() if value is not False])
    impact = script.binding.impact if script.binding else "Medium"
    scope.variables |= {
        "psboundparameters": bound,
        "psscriptroot": path.rpartition("\\")[0],
        "myinvocation": Record(InvocationName=invoked_by),
        "pscommandpath": path,
        "pscmdlet": Cmdlet(scope.session, impact, what_if, confirm, bound),
    }
    if what_if is not None:
        scope.variables["whatifpreference"] = what_if
    if confirm:
        scope.variables["confirmpreference"] = "Low"
    for parameter in script.parameters:
        default = parameter.default(scope) if parameter.default else False
        scope.variables[parameter.name] = given.get(parameter.name, default)


_WRITTEN = {
    "asjson": "AsJson",
    "abandon": "Abandon",
    "force": "Force",
    "locktimeout": "LockTimeout",
    "test": "Test",
    "verbose": "Verbose",
    "whatif": "WhatIf",
    "confirm": "Confirm",
}


def _versions(session: Session) -> Value:
    return Table([("PSVersion", session.host.powershell["version"]), ("PSEdition", session.host.powershell["edition"])])


def observe(host: WindowsHost, script: bytes) -> dict[str, Any]:
    """What observe.ps1 prints of the host."""
    looked = host.copy()
    put(looked, {"observe.ps1": script})
    looked.effects = []
    ran = run(looked, "observe.ps1", as_json=False)
    assert ran.code == 0, ran.says
    assert not looked.effects, "looking changes nothing"
    (line,) = ran.lines
    found: dict[str, Any] = json.loads(line)
    return found
