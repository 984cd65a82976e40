"""Variables by dynamic scope, the ways control leaves a block, and what a running script has at hand."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from tests.fake_powershell.values import Record, ScriptError, Table, Thing, Value

if TYPE_CHECKING:
    from tests.fake_powershell.guests import Runner
    from tests.fake_powershell.host import WindowsHost


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
    mandatory: bool = False


@dataclass(slots=True)
class Binding:
    """What `[CmdletBinding()]` says."""

    supports_should_process: bool = False
    impact: str = "Medium"


@dataclass(slots=True)
class Function:
    """A function, script or script block with its parameters, as it is written."""

    name: str
    parameters: tuple[Parameter, ...]
    body: Body
    binding: Binding | None = None  # of an advanced function


class SessionState:
    """Scopes of the session itself, or of a module: a call goes below the innermost one of where it was written."""

    __slots__ = ("current", "module", "top")

    def __init__(self, top: Scope, module: Thing | None = None) -> None:
        self.top = top
        self.current = top
        self.module = module


class Block(Thing):
    """A script block as a value: it runs below the innermost scope of the session or module that it is bound to."""

    type_name = "System.Management.Automation.ScriptBlock"

    def __init__(self, function: Function, state: SessionState) -> None:
        super().__init__()
        self.function = function
        self.state = state


class FunctionInfo(Thing):
    """A function as it was defined: in the session, or in a module."""

    type_name = "System.Management.Automation.FunctionInfo"

    def __init__(self, function: Function, state: SessionState) -> None:
        super().__init__(Name=function.name, Module=state.module)
        self.function = function
        self.state = state


@dataclass(slots=True)
class Session:
    """One process that runs one script on a host."""

    host: WindowsHost
    windows_powershell: bool  # 5.1; otherwise 7
    path: str  # the script's
    declined: frozenset[str] = frozenset()  # addresses, or actions, at which the person at the prompt says no
    invoked_by: str = "script.ps1"  # the name that it was called by; a dot: into the caller's own scope
    unanswered: bool = False  # there is no console at which a prompt could be answered
    answers: str = ""  # what the person at the prompt says, prompt by prompt: Y, N, and A and L for all that follow
    prompts: int = 0  # how often PowerShell asked
    process: int = 4711
    runner: Runner | None = None  # where the script runs inside a guest
    runners: list[Runner] = field(default_factory=list)  # what it started inside guests
    jobs: list[Value] = field(default_factory=list)  # that were started, and not removed
    state: SessionState | None = None  # where it runs just now: of the session, or of a module
    output: list[Value] = field(default_factory=list)  # the end of the pipeline: lines on standard output
    talk: list[str] = field(default_factory=list)  # lines of the information stream

    def ask(self, target: str, action: str) -> str:
        """What the person at the prompt says: Y, N, A or L.

        Raises:
            ScriptError: there is no console at which a prompt could be answered.
        """
        if self.unanswered:
            raise ScriptError("Exception calling ShouldProcess: Windows PowerShell is in NonInteractive mode.")
        self.prompts += 1
        if self.answers:
            answer, self.answers = self.answers[0], self.answers[1:]
            return answer
        return "N" if {target, action} & self.declined else "Y"


class Scope:
    """Variables and functions of a script, function, block or module; what is not here is looked for above.

    Above a function is the scope that was innermost in the session or module that it is of, when it was called; above a
    module is the global scope.
    """

    __slots__ = ("functions", "parent", "script", "session", "state", "strict", "variables")

    def __init__(
        self, session: Session, parent: Scope | None, state: SessionState | None = None, *, is_script: bool = False
    ) -> None:
        self.session = session
        self.parent = parent
        self.state: SessionState = state or (parent.state if parent else SessionState(self))
        self.script: Scope = self if is_script or parent is None else parent.script
        self.variables: dict[str, Value] = {}
        self.functions: dict[str, FunctionInfo] = {}
        self.strict: bool | None = None  # None: as it is above

    @classmethod
    def of_module(cls, session: Session, above: Scope, module: Thing) -> Scope:
        """The scope of a module, below the global one."""
        made = cls(session, above, is_script=True)
        made.state = SessionState(made, module)
        return made

    def above(self) -> Iterator[Scope]:
        """This scope and all that it sees, from the inside out."""
        at: Scope | None = self
        while at is not None:
            yield at
            at = at.parent

    @property
    def is_strict(self) -> bool:
        """Whether strict mode is on here."""
        return next((scope.strict for scope in self.above() if scope.strict is not None), False)

    def function(self, name: str) -> FunctionInfo | None:
        """The function of this lower-case name that is seen here."""
        at: Scope | None = self
        while at is not None:
            if name in at.functions:
                return at.functions[name]
            at = at.parent
        return None

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
        if found is not _MISSING:
            return found
        if not self.is_strict:
            return None
        says = f"The variable '${name}' cannot be retrieved because it has not been set."
        raise ScriptError(says, error_id="VariableIsUndefined", category="InvalidOperation")

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
HERE = "C:\\run"


class Reference(Thing):
    """`[ref] $variable`: who is given it reads and writes the caller's variable."""

    type_name = "System.Management.Automation.PSReference"

    def __init__(self, scope: Scope, name: str) -> None:
        super().__init__()
        self.scope = scope
        self.name = name

    def get(self, name: str) -> Value:
        assert name.lower() == "value"
        return self.scope.read(self.name)

    def set_value(self, value: Value) -> None:
        self.scope.write(self.name, value)


class Cmdlet(Thing):
    """`$PSCmdlet` of a script or an advanced function, who may hand it on.

    It was given -WhatIf or -Confirm, or not; where not, it reads the preference where ShouldProcess is called, once.
    With -Verbose it says what is done without a question, also where the preference for that is silent.
    """

    type_name = "System.Management.Automation.PSScriptCmdlet"

    def __init__(
        self, session: Session, impact: str, what_if: bool | None, confirm: bool | None, given: Table | None = None
    ) -> None:
        given = Table() if given is None else given
        super().__init__(MyInvocation=Record(BoundParameters=given))
        self.verbose = ("Verbose", True) in given.items()
        self.session = session
        self.impact = impact
        self.what_if = what_if
        self.preference = {None: "", True: "Low", False: "None"}[confirm]
        self.for_all = ""  # A or L, once it was answered

    def do_getunresolvedproviderpathfrompspath(self, path: str) -> str:
        """The whole path: a script's person stands where the scripts lie."""
        return path if path[1:2] == ":" else f"{HERE}\\{path.removeprefix('.' + chr(92))}"

    def do_shouldprocess(self, target: str, action: str) -> bool:
        if not action:
            raise AssertionError("a prompt without an action")
        state = self.session.state
        assert state is not None
        if self.what_if is None:
            self.what_if = bool(state.current.read("whatifpreference"))
        if self.what_if:
            self.session.output.append(f'What if: Performing the operation "{action}" on target "{target}".')
            return False
        self.preference = self.preference or str(state.current.read("confirmpreference"))
        if self.preference == "None" or _IMPACTS.index(self.impact) < _IMPACTS.index(self.preference):
            if self.verbose:
                self.session.output.append(f'VERBOSE: Performing the operation "{action}" on target "{target}".')
            return True
        answer = self.for_all or self.session.ask(target, action)
        self.for_all = answer if answer in "AL" else ""
        return answer in "YA"


_IMPACTS = ("Low", "Medium", "High")
