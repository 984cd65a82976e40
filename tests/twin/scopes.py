"""Variables by dynamic scope, the ways control leaves a block, and what a running script has at hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from tests.twin.values import ScriptError, Thing, Value

if TYPE_CHECKING:
    from tests.twin.guests import Runner
    from tests.twin.host import WindowsHost


class Return(Exception):
    """`return`."""


class Continue(Exception):
    """`continue`."""


class Exit(Exception):
    """`exit`: runs every `finally` on its way, is caught by no `catch`."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


Body = Callable[["Scope", list[Value]], None]
"""Statements: what they give goes into the list."""


@dataclass(slots=True)
class Parameter:
    """One parameter of a function."""

    name: str
    type: str  # lower case, empty where it is not typed
    default: Callable[[Scope], Value] | None


@dataclass(slots=True)
class Function:
    """A function or a script block with its parameters."""

    name: str
    parameters: tuple[Parameter, ...]
    body: Body


class Block(Thing):
    """A script block as a value: it runs in the scope of its caller."""

    type_name = "System.Management.Automation.ScriptBlock"

    def __init__(self, function: Function) -> None:
        super().__init__()
        self.function = function


@dataclass(slots=True)
class Session:
    """One process that runs one script on a host."""

    host: WindowsHost
    windows_powershell: bool  # 5.1; otherwise 7
    path: str  # the script's
    what_if: bool = False
    declined: frozenset[str] = frozenset()  # addresses, or actions, at which the person at the prompt says no
    invoked_by: str = "script.ps1"  # the name that it was called by; a dot: into the caller's own scope
    confirm: bool = False  # it was given -Confirm
    unanswered: bool = False  # there is no console at which a prompt could be answered
    process: int = 4711
    runner: Runner | None = None  # where the script runs inside a guest
    runners: list[Runner] = field(default_factory=list)  # what it started inside guests
    jobs: list[Value] = field(default_factory=list)  # that were started, and not removed
    functions: dict[str, Function] = field(default_factory=dict)
    output: list[Value] = field(default_factory=list)  # the end of the pipeline: lines on standard output
    talk: list[str] = field(default_factory=list)  # lines of the information stream

    def should_process(self, target: str, action: str, *, asks: bool) -> bool:
        if self.what_if:
            self.output.append(f'What if: Performing the operation "{action}" on target "{target}".')
            return False
        if not asks:
            return True
        if self.unanswered:
            raise ScriptError("Exception calling ShouldProcess: Windows PowerShell is in NonInteractive mode.")
        return not {target, action} & self.declined


class Scope:
    """The variables of a script, function or block; what is not here is looked for in its caller's."""

    __slots__ = ("parent", "script", "session", "variables")

    def __init__(self, session: Session, parent: Scope | None) -> None:
        self.session = session
        self.parent = parent
        self.script: Scope = parent.script if parent else self
        self.variables: dict[str, Value] = {}

    def read(self, name: str) -> Value:
        where, _, rest = name.rpartition(":")
        match where:
            case "env":
                return self.session.host.environment.get(rest)
            case "script":
                found = self.script.variables.get(rest, _MISSING)
            case "":
                found = self._look(rest)
            case _:
                raise AssertionError(f"${name}")
        if found is _MISSING:
            says = f"The variable '${name}' cannot be retrieved because it has not been set."
            raise ScriptError(says, error_id="VariableIsUndefined", category="InvalidOperation")
        return found

    def _look(self, name: str) -> Value:
        at: Scope | None = self
        while at is not None:
            if name in at.variables:
                return at.variables[name]
            at = at.parent
        return _MISSING

    def write(self, name: str, value: Value) -> None:
        where, _, rest = name.rpartition(":")
        if where == "script":
            self.script.variables[rest] = value
        elif where:
            raise AssertionError(f"${name} is not written")
        else:
            self.variables[rest] = value


_MISSING = object()


class Cmdlet(Thing):
    """`$PSCmdlet`."""

    type_name = "System.Management.Automation.PSScriptCmdlet"

    def __init__(self, scope: Scope, impact: str) -> None:
        super().__init__()
        self.scope = scope
        self.impact = impact

    def do_shouldprocess(self, target: str, action: str) -> bool:
        if not action:
            raise AssertionError("a prompt without an action")
        preference = str(self.scope.read("confirmpreference"))
        asks = preference != "None" and _IMPACTS.index(self.impact) >= _IMPACTS.index(preference)
        return self.scope.session.should_process(target, action, asks=asks)


_IMPACTS = ("Low", "Medium", "High")
