"""Calls of a script: of its own functions, of script blocks, and of cmdlets, bound strictly through the tables."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from functools import cache
from typing import TYPE_CHECKING

from tests.fake_powershell.dotnet import content
from tests.fake_powershell.expressions import Expression, expression, invoke, only, run_block
from tests.fake_powershell.hyperv import require_answer
from tests.fake_powershell.scopes import Block, Body, Exit, FunctionInfo, Scope
from tests.fake_powershell.values import EMPTY, ScriptError, Unsupported, Value, number, text, truth
from tests.powershell_lint.cmdlets import cmdlet, problems_of_call
from tests.powershell_lint.tree import text_of

if TYPE_CHECKING:
    from tree_sitter import Node


@dataclass(slots=True)
class Written:
    """A call as it stands there: parameters by name, and values without one."""

    name: str
    given: tuple[tuple[str, Expression | None], ...]
    positional: tuple[Expression, ...]
    splatted: tuple[Expression, ...]  # tables behind `@`
    line: int  # of its piece of the script, from 1


Pipe = Callable[[Scope, list[Value]], list[Value]]


def command(node: Node) -> Body:
    """A call at the head of a pipeline."""
    if node.children[0].type == "command_invokation_operator":
        return _invocation(node)
    written = _written(node)
    low = written.name.lower()

    def run(scope: Scope, out: list[Value]) -> None:
        alias = scope.session.host.aliases.get(low)
        meant = replace(written, name=alias) if alias else written
        function = scope.function(meant.name.lower())
        if function is not None:
            _call_function(function, meant, scope, out)
        else:
            _emit(out, _call_cmdlet(meant, scope))

    return run


def _emit(out: list[Value], value: Value) -> None:
    if isinstance(value, list):
        out.extend(value)
    elif value is not EMPTY:
        out.append(value)


def _invocation(node: Node) -> Body:
    """`&` of a script block or a function."""
    operator, called, *elements = node.children
    if text_of(operator) != "&":
        raise Unsupported(text_of(node)[:80])
    parts = [part for group in elements for part in group.children if part.type != "command_argument_sep"]
    first = called.children[0]
    if first.type == "path_command_name" and first.child_count > 1:
        raise Unsupported(text_of(node)[:80])
    target = expression(first.children[0] if first.type == "path_command_name" else first)
    written = _with_arguments(text_of(node)[:40], parts, node.start_point.row + 1)

    def run(scope: Scope, out: list[Value]) -> None:
        held = target(scope)
        if isinstance(held, FunctionInfo):
            _call_function(held, written, scope, out)
        elif isinstance(held, Block) and not written.given and not written.splatted:
            arguments = [argument(scope) for argument in written.positional] if written.positional else None
            _emit(out, run_block(held, scope, arguments=arguments))
        elif isinstance(held, str):
            _run_file(held, written, scope, out)
        else:
            raise Unsupported(f"{written.name} calls {held!r}")

    return run


def _run_file(path: str, written: Written, scope: Scope, out: list[Value]) -> None:
    """A script by `&`: it sees what its caller sees, a module's own variables too; `exit` ends the script alone."""
    from tests.fake_powershell.compiling import compiled
    from tests.fake_powershell.run import given_to_script

    assert not written.positional
    script = compiled(content(scope, path))
    inner = Scope(scope.session, scope.state.current, is_script=True)
    given = {name.lower(): truth(value(scope)) if value else True for name, value in written.given}
    given_to_script(inner, script, given, path, written.name)
    state = scope.state
    outer, state.current = state.current, inner
    try:
        script.body(inner, out)
    except Exit as end:
        scope.variables["lastexitcode"] = end.code
    finally:
        state.current = outer


def _written(node: Node) -> Written:
    name, parts = text_of(node.children[0]), node.children[1].children if node.child_count > 1 else []
    return _with_arguments(name, parts, node.start_point.row + 1)


def _with_arguments(name: str, parts: list[Node], line: int) -> Written:
    given: list[tuple[str, Expression | None]] = []
    positional: list[Expression] = []
    splatted: list[Expression] = []
    waiting = False
    for part in parts:
        if part.type == "command_argument_sep":
            continue
        if part.type == "command_parameter":
            given.append((text_of(part).removeprefix("-"), None))
            waiting = True
            continue
        if text_of(part).startswith("@") and only(part).type == "variable":
            variable = text_of(part).removeprefix("@").lower()
            splatted.append(lambda scope, variable=variable: scope.read(variable))  # type: ignore[misc]  # its own name
            waiting = False
            continue
        value = _bare(text_of(part)) if part.type == "generic_token" else expression(part)
        if waiting:
            given[-1] = (given[-1][0], value)
        else:
            positional.append(value)
        waiting = False
    return Written(name=name, given=tuple(given), positional=tuple(positional), splatted=tuple(splatted), line=line)


def _bare(word: str) -> Expression:
    return lambda scope: word


def _call_function(called: FunctionInfo, written: Written, scope: Scope, out: list[Value]) -> None:
    function = called.function
    if written.positional:
        raise Unsupported(f"{written.name} is given a value without a name")
    known = {parameter.name: parameter.type for parameter in function.parameters}
    if function.binding:
        known |= COMMON_PARAMETERS if function.binding.supports_should_process else {"erroraction": ""}
    given: dict[str, Value] = {}
    for name, value in written.given:
        low = name.lower()
        if low not in known or low in given:
            raise Unsupported(f"{written.name} has no parameter -{name}, or it is given twice")
        if value is None and known[low] != "switch":
            raise Unsupported(f"-{name} of {written.name} has no value")
        given[low] = True if value is None else value(scope)
    for name, value in _splatted(written, scope):
        if name not in known or name in given:
            raise Unsupported(f"{written.name} has no parameter -{name}, or it is given twice")
        given[name] = value
    invoke(function, called.state, given, scope, out)


COMMON_PARAMETERS = {
    "whatif": "switch",
    "confirm": "switch",
    "erroraction": "",
    "warningaction": "",
    "informationaction": "",
}
"""By lower-case name: types of what an advanced function takes besides its own, where it supports ShouldProcess."""


def _splatted(written: Written, scope: Scope) -> list[tuple[str, Value]]:
    """What tables behind `@` give, by lower-case name."""
    return [(text(name).lower(), value) for table in written.splatted for name, value in table(scope).items()]


def _call_cmdlet(written: Written, scope: Scope) -> Value:
    module, _, plain = written.name.rpartition("\\")
    called = cmdlet(plain, module)
    from tests.fake_powershell.cmdlets import CMDLETS

    do = CMDLETS.get(plain.lower())
    if called is None or do is None or (called.module == "Hyper-V") is not (module == "Hyper-V"):
        raise Unsupported(f"the command {written.name}")
    if written.splatted:
        raise Unsupported(f"a table behind @ for {plain}")
    names = tuple(name for name, _ in written.given)
    if problem := _problem_of_call(plain, names, len(written.positional)):
        raise ScriptError(problem, error_id="NamedParameterNotFound", category="InvalidArgument")
    bound: dict[str, Value] = {}
    for name, value in written.given:
        parameter = called.parameter(name)
        switch = parameter is not None and parameter.is_switch
        if (value is None) is not switch:
            raise Unsupported(f"-{name} of {plain}: a switch stands alone, everything else has a value")
        bound[name.lower()] = True if value is None else value(scope)
        if parameter is not None and parameter.accepted and text(bound[name.lower()]) not in parameter.accepted:
            raise ScriptError(f"{plain} -{name} does not take {text(bound[name.lower()])}", error_id="CannotConvert")
    defaults = defaults_of(scope, plain)
    bound = {**{name: value for name, value in defaults.items() if called.parameter(name)}, **bound}
    try:
        if bound.get("vm") is not None:
            _require_kind(scope)
        require_answer(scope.session.host, plain, bound)
        if called.should_process and not _is_wanted(scope, plain):
            return EMPTY
        return do(scope, bound)
    except ScriptError as error:
        if defaults.get("erroraction") == "SilentlyContinue":
            return EMPTY
        error.command, error.line = error.command or plain, error.line or written.line
        raise


@cache
def _problem_of_call(name: str, given: tuple[str, ...], positional: int) -> str:
    """Why a call of this cmdlet does not bind; empty: it does."""
    called = cmdlet(name)
    assert called is not None
    problems = problems_of_call(called, given, positional=positional)
    return problems[0] if problems else ""


def _require_kind(scope: Scope) -> None:
    """Raise where Hyper-V's objects came from another process: they are of no kind that a cmdlet takes."""
    if not scope.session.host.loads_hyperv:
        says = "Cannot bind parameter 'VM'. Cannot convert the value to type \"VirtualMachine\"."
        raise ScriptError(says, error_id="CannotConvertArgumentNoMessage", category="InvalidArgument")


def _is_wanted(scope: Scope, name: str) -> bool:
    """What a cmdlet that changes something asks by itself, as the preferences where it is called have it."""
    if truth(scope.read("whatifpreference")):
        raise AssertionError(f"{name}, which changes something, is reached under -WhatIf")
    return scope.read("confirmpreference") != "Low" or scope.session.ask(name, name) in "YA"


def defaults_of(scope: Scope, name: str) -> dict[str, Value]:
    """What `$PSDefaultParameterValues` adds to a call, by the lower-case name of the parameter."""
    found: dict[str, Value] = {}
    for key, value in scope.read("psdefaultparametervalues").items():
        pattern, _, parameter = text(key).lower().partition(":")
        if fnmatch(name.lower(), pattern):
            found[parameter] = value
    return found


def piped(node: Node) -> Pipe:
    """A call behind a `|`."""
    written = _written(node)
    given = dict(written.given)
    own = written.name.lower()
    plain = written.name.rpartition("\\")[2]
    if plain == "Where-Object" and set(given) == {"FilterScript"}:
        block = given["FilterScript"]
        assert block is not None
        return lambda scope, held: (
            [item for item in held if truth(run_block(block(scope), scope, this=item))]
            if scope.function(own) is None and own not in scope.session.host.aliases
            else []  # a profile's own
        )
    if plain == "Sort-Object" and set(given) <= {"Descending"}:
        return lambda scope, held: _sorted(held, descending="Descending" in given)
    raise Unsupported(f"a pipeline into {text_of(node)[:80]}")


def _sorted(held: list[Value], *, descending: bool) -> list[Value]:
    if not all(isinstance(item, int) for item in held):
        raise Unsupported("Sort-Object of text: its order depends on the culture")
    return sorted(held, key=number, reverse=descending)
