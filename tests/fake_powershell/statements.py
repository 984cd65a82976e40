"""Statements of a script's tree: what they give goes into their caller's list, as PowerShell's pipeline has it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING

from tests.fake_powershell import commands, members, operators
from tests.fake_powershell.expressions import Expression, expression, function_of, only, type_of
from tests.fake_powershell.host import Interrupted
from tests.fake_powershell.scopes import Body, Continue, Exit, FunctionInfo, Return, Scope
from tests.fake_powershell.values import (
    EMPTY,
    Record,
    ScriptError,
    Thing,
    Unsupported,
    Value,
    elements,
    number,
    text,
    truth,
    unwrapped,
)
from tests.powershell_lint.tree import text_of

if TYPE_CHECKING:
    from tree_sitter import Node

COR_E_IO = -2146232800
"""The number of an error of .NET that says no more than that reading or writing failed."""
_SILENT = {"comment", ";", "empty_statement", "{", "}"}


def block_of(node: Node) -> Body:
    """A list of statements, or a block in braces."""
    if node.type == "statement_block":
        inside = [child for child in node.children if child.type == "statement_list"]
        return block_of(inside[0]) if inside else lambda scope, out: None
    statements = [statement(child) for child in node.children if child.type not in _SILENT]

    def run(scope: Scope, out: list[Value]) -> None:
        for statement in statements:
            statement(scope, out)

    return run


def statement(node: Node) -> Body:
    make = _MAKERS.get(node.type)
    if make is None:
        raise Unsupported(f"{node.type}: {text_of(node)[:80]}")
    return make(node)


def emit(out: list[Value], value: Value) -> None:
    """Into the pipeline: arrays give their elements."""
    if value is EMPTY:
        return
    if isinstance(value, list | bytes):
        out.extend(value)
    else:
        out.append(value)


def _pipeline(node: Node) -> Body:
    inside = node.children[0]
    if inside.type == "assignment_expression":
        return _assignment(inside)
    if node.child_count != 1:
        raise Unsupported(text_of(node)[:80])
    return _chain(inside)


def _chain(node: Node) -> Body:
    parts = [child for child in node.children if child.type != "|"]
    first = parts[0]
    head = commands.command(first) if first.type == "command" else _expression_statement(first)
    if len(parts) == 1:
        return head
    rest = [commands.piped(part) for part in parts[1:]]

    def run(scope: Scope, out: list[Value]) -> None:
        held: list[Value] = []
        head(scope, held)
        for clause in rest:
            held = clause(scope, held)
        out.extend(held)

    return run


def _expression_statement(node: Node) -> Body:
    value = expression(node)
    return lambda scope, out: emit(out, value(scope))


def value_of(node: Node) -> Expression:
    """What a pipeline or a statement is worth: a single expression keeps its arrays."""
    inner = only(node)
    if inner.type in (
        "pipeline",
        "pipeline_chain",
        "command",
        "if_statement",
        "foreach_statement",
        "assignment_expression",
    ):
        body = _body(inner)

        def collect(scope: Scope) -> Value:
            out: list[Value] = []
            body(scope, out)
            return unwrapped(out)

        return collect
    return expression(inner)


def _body(node: Node) -> Body:
    match node.type:
        case "command":
            return commands.command(node)
        case "pipeline_chain":
            return _chain(node)
        case "assignment_expression":
            raise Unsupported("an assignment as a value")
        case _:
            return statement(node)


def _assignment(node: Node) -> Body:
    target, operator, value = [child for child in node.children if child.type != "comment"]
    place = only(target)
    new = value_of(value)
    sign = text_of(operator).removesuffix("=")
    store, load = _store(place), None if not sign else expression(place)

    def run(scope: Scope, out: list[Value]) -> None:
        result = new(scope)
        store(scope, operators.arithmetic(sign, load(scope), result) if load else result)

    return run


def _store(node: Node) -> Callable[[Scope, Value], None]:
    match node.type:
        case "variable":
            name = text_of(node).lower().removeprefix("$")
            return lambda scope, value: scope.write(name, value)
        case "element_access":
            owner, index = expression(node.children[0]), expression(node.children[2])
            return lambda scope, value: members.put(owner(scope), index(scope), value)
        case "member_access":
            thing, member = expression(node.children[0]), text_of(node.children[2])
            return lambda scope, value: members.set_property(thing(scope), member, value)
        case "cast_expression":
            to, inside = type_of(node.children[0]), _store(only(node.children[1]))
            return lambda scope, value: inside(scope, members.cast(to, value, scope))
        case "array_literal_expression":
            return _several([_store(only(child)) for child in node.children if child.type != ","])
        case _:
            raise Unsupported(f"an assignment to {text_of(node)[:80]}")


def _several(stores: list[Callable[[Scope, Value], None]]) -> Callable[[Scope, Value], None]:
    """`$a, $b = ...`: the last one takes what is left."""

    def run(scope: Scope, value: Value) -> None:
        held = elements(value)
        if len(held) != len(stores):
            raise Unsupported(f"{len(held)} values for {len(stores)} variables")
        for store, item in zip(stores, held, strict=True):
            store(scope, item)

    return run


def _if(node: Node) -> Body:
    branches = [(value_of(node.children[2]), block_of(node.children[4]))]
    otherwise: Body | None = None
    for part in node.children[5:]:
        if part.type == "elseif_clauses":
            branches += [(value_of(child.children[2]), block_of(child.children[4])) for child in part.children]
        elif part.type == "else_clause":
            otherwise = block_of(part.children[1])
        elif part.type != "comment":
            raise Unsupported(part.type)

    def run(scope: Scope, out: list[Value]) -> None:
        for condition, body in branches:
            if truth(condition(scope)):
                body(scope, out)
                return
        if otherwise:
            otherwise(scope, out)

    return run


def _foreach(node: Node) -> Body:
    parts = [child for child in node.children if child.type != "comment"]
    name, body = text_of(parts[2]).lower().removeprefix("$"), block_of(parts[6])
    over = value_of(parts[4])

    def run(scope: Scope, out: list[Value]) -> None:
        value = over(scope)
        if value is None:
            return
        found: list[Value] = []
        emit(found, value)
        for item in found:
            scope.write(name, item)
            try:
                body(scope, out)
            except Continue:
                continue

    return run


def _for(node: Node) -> Body:
    named = {child.type: child for child in node.children}
    begin, body = _pipeline(named["for_initializer"].children[0]), block_of(named["statement_block"])
    condition = value_of(named["for_condition"].children[0])
    step = _pipeline(named["for_iterator"].children[0])

    def run(scope: Scope, out: list[Value]) -> None:
        begin(scope, [])
        while truth(condition(scope)):
            with suppress(Continue):
                body(scope, out)
            step(scope, [])

    return run


def _while(node: Node) -> Body:
    named = {child.type: child for child in node.children}
    condition, body = value_of(named["while_condition"].children[0]), block_of(named["statement_block"])

    def run(scope: Scope, out: list[Value]) -> None:
        while truth(condition(scope)):
            try:
                body(scope, out)
            except Continue:
                continue

    return run


def _try(node: Node) -> Body:
    body = block_of(node.children[1])
    catches: list[tuple[set[str], Body]] = []
    last: Body | None = None
    for part in node.children[2:]:
        if part.type == "catch_clauses":
            catches += [_catch(child) for child in part.children]
        elif part.type == "finally_clause":
            last = block_of(part.children[1])

    def guarded(scope: Scope, out: list[Value]) -> None:
        try:
            body(scope, out)
        except ScriptError as error:
            kinds = {error.kind.lower(), *_ABOVE.get(error.kind.lower(), ())}
            for caught, handler in catches:
                if not caught or caught & kinds:
                    scope.write("_", error_record(error))
                    handler(scope, out)
                    return
            raise

    def run(scope: Scope, out: list[Value]) -> None:
        try:
            guarded(scope, out)
        except (ScriptError, Exit, Return, Continue, Interrupted):
            if last:
                last(scope, out)
            raise
        if last:
            last(scope, out)

    return run


_ABOVE = {"system.io.filenotfoundexception": ("system.io.ioexception",)}
"""Of the types of exceptions those that they are, too."""


def _catch(node: Node) -> tuple[set[str], Body]:
    types = [part for child in node.children if child.type == "catch_type_list" for part in child.children]
    return {type_of(part) for part in types if part.type == "type_literal"}, block_of(node.children[-1])


class ErrorRecord(Thing):
    """`$_` in a catch, which `throw` alone raises again."""

    def __init__(self, error: ScriptError, **properties: Value) -> None:
        super().__init__(**properties)
        self.error = error


def error_record(error: ScriptError) -> Thing:
    return ErrorRecord(
        error,
        Exception=Record(Message=error.says, HResult=COR_E_IO),
        FullyQualifiedErrorId=error.error_id,
        CategoryInfo=Record(Category=error.category),
        InvocationInfo=Record(MyCommand=error.command, ScriptLineNumber=error.line),
    )


def _flow(node: Node) -> Body:
    word = text_of(node.children[0]).lower()
    value = value_of(node.children[1]) if node.child_count > 1 else None
    match word:
        case "return":
            return _return(node)
        case "continue":
            return _continue
        case "throw":
            return lambda scope, out: _throw(value(scope)) if value else _raise_again(scope)
        case "exit":
            return lambda scope, out: _exit(value(scope) if value else 0)
        case _:
            raise Unsupported(word)


def _return(node: Node) -> Body:
    body = _pipeline(node.children[1]) if node.child_count > 1 else None

    def run(scope: Scope, out: list[Value]) -> None:
        if body:
            body(scope, out)
        raise Return

    return run


def _continue(scope: Scope, out: list[Value]) -> None:
    raise Continue


def _throw(value: Value) -> None:
    raise ScriptError(text(value), error_id=text(value))


def _raise_again(scope: Scope) -> None:
    record = scope.read("_")
    assert isinstance(record, ErrorRecord), "`throw` alone stands in a catch"
    raise record.error


def _exit(value: Value) -> None:
    raise Exit(number(value))


def _function(node: Node) -> Body:
    name = text_of(node.children[1])
    function = function_of(name, next((child for child in node.children if child.type == "script_block"), None))

    def run(scope: Scope, out: list[Value]) -> None:
        scope.functions[name.lower()] = FunctionInfo(function, scope.state)

    return run


_MAKERS: dict[str, Callable[[Node], Body]] = {
    "pipeline": _pipeline,
    "if_statement": _if,
    "foreach_statement": _foreach,
    "for_statement": _for,
    "while_statement": _while,
    "try_statement": _try,
    "flow_control_statement": _flow,
    "function_statement": _function,
}
