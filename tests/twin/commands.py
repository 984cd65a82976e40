"""Calls of a script: of its own functions, of script blocks, and of cmdlets, bound strictly through the tables."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fnmatch import fnmatch
from typing import TYPE_CHECKING

from rarms_iac.powershell.tree import text_of
from tests.powershell_lint.cmdlets import cmdlet, problems_of_call
from tests.twin.expressions import Expression, expression, invoke, run_block
from tests.twin.scopes import Body, Function, Scope
from tests.twin.values import EMPTY, ScriptError, Thing, Unsupported, Value, number, text, truth

if TYPE_CHECKING:
    from tree_sitter import Node


@dataclass(slots=True)
class Written:
    """A call as it stands there: parameters by name, and values without one."""

    name: str
    given: tuple[tuple[str, Expression | None], ...]
    positional: tuple[Expression, ...]
    line: int  # of its piece of the script, from 1


Pipe = Callable[[Scope, list[Value]], list[Value]]


def command(node: Node) -> Body:
    """A call at the head of a pipeline."""
    if node.children[0].type == "command_invokation_operator":
        return _invocation(node)
    written = _written(node)

    def run(scope: Scope, out: list[Value]) -> None:
        function = scope.session.functions.get(written.name.lower())
        if function is not None:
            _call_function(function, written, scope, out)
        else:
            _emit(out, _call_cmdlet(written, scope))

    return run


def _emit(out: list[Value], value: Value) -> None:
    if isinstance(value, list):
        out.extend(value)
    elif value is not EMPTY:
        out.append(value)


def _invocation(node: Node) -> Body:
    if text_of(node.children[0]) != "&" or node.child_count != 2:
        raise Unsupported(text_of(node)[:80])
    block = expression(node.children[1].children[0].children[0])
    return lambda scope, out: _emit(out, run_block(block(scope), scope))


def _written(node: Node) -> Written:
    name, parts = text_of(node.children[0]), node.children[1].children if node.child_count > 1 else []
    given: list[tuple[str, Expression | None]] = []
    positional: list[Expression] = []
    waiting = False
    for part in parts:
        if part.type == "command_argument_sep":
            continue
        if part.type == "command_parameter":
            given.append((text_of(part).removeprefix("-"), None))
            waiting = True
            continue
        value = _bare(text_of(part)) if part.type == "generic_token" else expression(part)
        if waiting:
            given[-1] = (given[-1][0], value)
        else:
            positional.append(value)
        waiting = False
    line = node.start_point.row + 1
    return Written(name=name, given=tuple(given), positional=tuple(positional), line=line)


def _bare(word: str) -> Expression:
    return lambda scope: word


def _call_function(function: Function, written: Written, scope: Scope, out: list[Value]) -> None:
    if written.positional:
        raise Unsupported(f"{written.name} is given a value without a name")
    known = {parameter.name: parameter for parameter in function.parameters}
    given: dict[str, Value] = {}
    for name, value in written.given:
        parameter = known.get(name.lower())
        if parameter is None or name.lower() in given:
            raise Unsupported(f"{written.name} has no parameter -{name}, or it is given twice")
        if value is None and parameter.type != "switch":
            raise Unsupported(f"-{name} of {written.name} has no value")
        given[name.lower()] = True if value is None else value(scope)
    invoke(function, given, scope, out)


def _call_cmdlet(written: Written, scope: Scope) -> Value:
    module, _, plain = written.name.rpartition("\\")
    called = cmdlet(plain, module)
    from tests.twin.cmdlets import CMDLETS

    do = CMDLETS.get(plain.lower())
    if called is None or do is None or (called.module == "Hyper-V") is not (module == "Hyper-V"):
        raise Unsupported(f"the command {written.name}")
    names = [name for name, _ in written.given]
    if problems := problems_of_call(called, names, positional=len(written.positional)):
        raise ScriptError(problems[0].message, error_id="NamedParameterNotFound", category="InvalidArgument")
    bound: dict[str, Value] = {}
    for name, value in written.given:
        parameter = called.parameter(name)
        switch = parameter is not None and parameter.is_switch
        if (value is None) is not switch:
            raise Unsupported(f"-{name} of {plain}: a switch stands alone, everything else has a value")
        bound[name.lower()] = True if value is None else value(scope)
        if parameter is not None and parameter.accepted and text(bound[name.lower()]) not in parameter.accepted:
            raise ScriptError(f"{plain} -{name} does not take {text(bound[name.lower()])}", error_id="CannotConvert")
    defaults = _defaults(scope, plain)
    bound = {**{name: value for name, value in defaults.items() if called.parameter(name)}, **bound}
    try:
        refused(scope, plain)
        machines = bound.get("vm")
        for machine in machines if isinstance(machines, list) else [machines]:
            if isinstance(machine, Thing):
                refused(scope, f"{plain} {machine.get('Name')}")
        return do(scope, bound)
    except ScriptError as error:
        if defaults.get("erroraction") == "SilentlyContinue":
            return EMPTY
        error.command, error.line = error.command or plain, error.line or written.line
        raise


def _defaults(scope: Scope, name: str) -> dict[str, Value]:
    """What `$PSDefaultParameterValues` adds to a call, by the lower-case name of the parameter."""
    found: dict[str, Value] = {}
    for key, value in scope.read("psdefaultparametervalues").items():
        pattern, _, parameter = text(key).lower().partition(":")
        if fnmatch(name.lower(), pattern):
            found[parameter] = value
    return found


def refused(scope: Scope, what: str) -> None:
    """Raise what the host has been told to answer this command with."""
    if found := scope.session.host.refusals.get(what):
        error_id, category, says = found
        raise ScriptError(says, error_id=error_id, category=category)


def piped(node: Node) -> Pipe:
    """A call behind a `|`."""
    written = _written(node)
    given = dict(written.given)
    own = written.name.lower()
    if written.name == "Where-Object" and set(given) == {"FilterScript"}:
        block = given["FilterScript"]
        assert block is not None
        return lambda scope, held: (
            [item for item in held if truth(run_block(block(scope), scope, this=item))]
            if own not in scope.session.functions
            else []  # a profile's own
        )
    if written.name == "Sort-Object" and set(given) <= {"Descending"}:
        return lambda scope, held: _sorted(held, descending="Descending" in given)
    raise Unsupported(f"a pipeline into {text_of(node)[:80]}")


def _sorted(held: list[Value], *, descending: bool) -> list[Value]:
    if all(isinstance(item, int) for item in held):
        return sorted(held, key=number, reverse=descending)
    return sorted(held, key=lambda item: text(item).lower(), reverse=descending)
