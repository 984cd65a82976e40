"""Expressions of a script's tree, made into functions of a scope once and run often."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import TYPE_CHECKING

from tests.fake_powershell import dotnet, members, operators
from tests.fake_powershell.scopes import (
    Binding,
    Block,
    Cmdlet,
    Function,
    Parameter,
    Reference,
    Return,
    Scope,
    SessionState,
)
from tests.fake_powershell.values import (
    EMPTY,
    Long,
    Record,
    ScriptError,
    Table,
    Thing,
    Unsupported,
    Value,
    text,
    truth,
    unwrapped,
)
from tests.powershell_lint.tree import text_of

if TYPE_CHECKING:
    from tree_sitter import Node

Expression = Callable[[Scope], Value]

_CONSTANTS = {"$true": True, "$false": False, "$null": None}


def only(node: Node) -> Node:
    """The node below a chain of single children: the grammar has one for every rank of operators."""
    while node.child_count == 1 and node.type not in _KEPT:
        node = node.children[0]
    return node


_KEPT = {
    "string_literal",
    "integer_literal",
    "command",
    "variable",
    "member_name",
    "array_expression",
    "real_literal",
    "type_literal",
}


def expression(node: Node) -> Expression:
    """What the node says, as a function of a scope."""
    node = only(node)
    make = _MAKERS.get(node.type)
    if make is None:
        raise Unsupported(f"{node.type}: {text_of(node)[:80]}")
    return make(node)


def _constant(value: Value) -> Expression:
    return lambda scope: value


def _literal(node: Node) -> Expression:
    shown = text_of(node)
    if not shown.startswith("'"):
        raise Unsupported(shown[:80])
    return _constant(shown[1:-1].replace("''", "'"))


def _integer(node: Node) -> Expression:
    shown = text_of(node).lower()
    value = int(shown, 16 if shown.startswith("0x") else 10)
    return _constant(value if value < 2**31 else Long(value))


def _real(node: Node) -> Expression:
    return _constant(float(text_of(node)))


def _type(node: Node) -> Expression:
    return _constant(Thing(Name=type_of(node)))


def _variable(node: Node) -> Expression:
    name = text_of(node).lower()
    if name in _CONSTANTS:
        return _constant(_CONSTANTS[name])
    plain = name.removeprefix("$")
    return lambda scope: scope.read(plain)


def _binary(node: Node) -> Expression:
    left, operator, right = node.children
    a, b, word = expression(left), expression(right), text_of(operator).lower()
    match word:
        case "-and":
            return lambda scope: truth(a(scope)) and truth(b(scope))
        case "-or":
            return lambda scope: truth(a(scope)) or truth(b(scope))
        case "-band":
            return lambda scope: operators.band(a(scope), b(scope))
        case "+" | "-" | "*" | "/":
            return lambda scope: operators.arithmetic(word, a(scope), b(scope))
        case "-f":
            return lambda scope: operators.format_with(a(scope), b(scope))
        case _:
            return lambda scope: operators.compare(word, a(scope), b(scope), scope)


def _array_literal(node: Node) -> Expression:
    parts = [expression(child) for child in node.children if child.type != ","]
    return lambda scope: [part(scope) for part in parts]


def _unary(node: Node) -> Expression:
    if node.children[0].type != "-not":
        raise Unsupported(text_of(node)[:80])
    inside = expression(node.children[1])
    return lambda scope: not truth(inside(scope))


def _cast(node: Node) -> Expression:
    to = type_of(node.children[0])
    if to == "ordered":
        entries = table_entries(only(node.children[1]))
        return lambda scope: Table(_entries(entries, scope), ordered=True)
    if to == "ref":
        referred = only(node.children[1])
        if referred.type != "variable":
            raise Unsupported(text_of(node)[:80])
        name = text_of(referred).lower().removeprefix("$")
        return lambda scope: Reference(scope, name)
    inside = expression(node.children[1])

    def run(scope: Scope) -> Value:
        value = inside(scope)
        # Of a command that gave nothing it makes `$null`; a parameter or a variable of that type would be ''.
        return None if to == "string" and value is EMPTY else members.cast(to, value, scope)

    return run


def type_of(node: Node) -> str:
    """`[System.IO.File]` as `system.io.file`."""
    return text_of(node).strip("[]").lower() + ("[]" if text_of(node).endswith("[]]") else "")


def _parenthesised(node: Node) -> Expression:
    from tests.fake_powershell.statements import value_of

    return value_of(node.children[1])


def _array_expression(node: Node) -> Expression:
    from tests.fake_powershell.statements import block_of

    lists = [child for child in node.children if child.type == "statement_list"]
    if not lists:
        return lambda scope: []
    body = block_of(lists[0])

    def collect(scope: Scope) -> Value:
        out: list[Value] = []
        body(scope, out)
        return out

    return collect


def table_entries(node: Node) -> list[tuple[Expression, Expression]]:
    """The entries of `@{ ... }`."""
    from tests.fake_powershell.statements import value_of

    if node.type != "hash_literal_expression":
        raise Unsupported(f"no table: {text_of(node)[:80]}")
    found = []
    for body in (child for child in node.children if child.type == "hash_literal_body"):
        for entry in (child for child in body.children if child.type == "hash_entry"):
            key = entry.children[0].children[0]
            named = key.type == "simple_name"
            found.append((_constant(text_of(key)) if named else expression(key), value_of(entry.children[2])))
    return found


def _entries(entries: list[tuple[Expression, Expression]], scope: Scope) -> list[tuple[Value, Value]]:
    return [(key(scope), value(scope)) for key, value in entries]


def _table(node: Node) -> Expression:
    entries = table_entries(node)
    return lambda scope: Table(_entries(entries, scope))


def _member(node: Node) -> Expression:
    owner, separator, name = node.children
    plain = text_of(name)
    if separator.type == "::":
        type_name = type_of(owner)
        return lambda scope: dotnet.static_property(type_name, plain, scope)
    inside = expression(owner)
    return lambda scope: _strictly(lambda: members.get(inside(scope), plain), scope)


_LENIENT = {"PropertyNotFoundStrict", "IndexOutOfRangeException"}
"""Errors of strict mode alone."""


def _strictly(read: Callable[[], Value], scope: Scope) -> Value:
    """What is read; without strict mode, what is not there is `$null`."""
    try:
        return read()
    except ScriptError as error:
        if error.error_id in _LENIENT and not scope.is_strict:
            return None
        raise


def _element(node: Node) -> Expression:
    owner, index = expression(node.children[0]), expression(node.children[2])
    return lambda scope: _strictly(lambda: members.element(owner(scope), index(scope)), scope)


def _call(node: Node) -> Expression:
    owner, separator, name, arguments = node.children
    given = _arguments(arguments)
    plain = text_of(name)
    if separator.type == "::":
        type_name = type_of(owner)
        return lambda scope: dotnet.static_call(type_name, plain, [argument(scope) for argument in given], scope)
    inside = expression(owner)

    return lambda scope: members.call(inside(scope), plain, [argument(scope) for argument in given])


def _arguments(node: Node) -> list[Expression]:
    lists = [child for child in node.children if child.type == "argument_expression_list"]
    return [expression(child) for child in lists[0].children if child.type != ","] if lists else []


def _increment(node: Node) -> Expression:
    variable, sign = node.children
    name = text_of(variable).lower().removeprefix("$")

    def run(scope: Scope) -> Value:
        if text_of(sign) != "++":
            raise Unsupported(text_of(node))
        old = scope.read(name)
        scope.write(name, operators.arithmetic("+", old, 1))
        return EMPTY

    return run


def _block(node: Node) -> Expression:
    function = function_of("", next((child for child in node.children if child.type == "script_block"), None))
    return lambda scope: Block(function, scope.state)


def function_of(name: str, node: Node | None) -> Function:
    """A function from its script block."""
    from tests.fake_powershell.statements import block_of

    parameters: tuple[Parameter, ...] = ()
    binding: Binding | None = None
    bodies = []
    for part in node.children if node else []:
        if part.type == "param_block":
            parameters, binding = parameters_of(part), binding_of(part)
        elif part.type == "script_block_body":
            bodies += [block_of(child) for child in part.children if child.type == "statement_list"]
        elif part.type == "statement_list":
            bodies.append(block_of(part))
        elif part.type != "comment":
            raise Unsupported(f"{part.type} in {name}")

    def run(scope: Scope, out: list[Value]) -> None:
        for body in bodies:
            body(scope, out)

    return Function(name=name, parameters=parameters, body=run, binding=binding)


def parameters_of(block: Node) -> tuple[Parameter, ...]:
    """The parameters of a `param( )`."""
    return tuple(
        _parameter(child)
        for group in block.children
        if group.type == "parameter_list"
        for child in group.children
        if child.type == "script_parameter"
    )


def _parameter(node: Node) -> Parameter:
    variable = next(part for part in node.children if part.type == "variable")
    default = next((part for part in node.children if part.type == "script_parameter_default"), None)
    attributes = [part for group in node.children if group.type == "attribute_list" for part in group.children]
    types = [type_of(only(part)) for part in attributes if only(part).type == "type_literal"]
    others = [_attribute(only(part)) for part in attributes if only(part).type != "type_literal"]
    if unknown := [name for name, _ in others if name != "parameter"]:
        raise Unsupported(f"the attribute {unknown[0]} of {text_of(variable)}")
    return Parameter(
        name=text_of(variable).removeprefix("$").lower(),
        type=types[0] if types else "",
        default=expression(default.children[1]) if default else None,
        mandatory=any("mandatory" in given for _, given in others),
    )


def _attribute(node: Node) -> tuple[str, dict[str, str]]:
    """Its name, and by lower-case name what it is given."""
    name = next(text_of(part) for part in node.children if part.type not in ("[", "("))
    arguments = [argument for part in node.children for argument in _attribute_arguments(part)]
    return name.lower(), dict(arguments)


def _attribute_arguments(node: Node) -> list[tuple[str, str]]:
    if node.type != "attribute_arguments":
        return []
    given = [text_of(child).partition("=") for child in node.children if child.type != ","]
    return [(name.strip().lower(), value.strip(" '")) for name, _, value in given]


def binding_of(block: Node) -> Binding | None:
    """What a `param( )` says of how it is called: an attribute `CmdletBinding`, or one of a parameter."""
    attributes = [_attribute(only(part)) for part in _attributes_of(block)]
    given = next((given for name, given in attributes if name == "cmdletbinding"), None)
    if given is None:
        return Binding() if "[Parameter(" in text_of(block) else None
    return Binding("supportsshouldprocess" in given, given.get("confirmimpact", "Medium"))


def _attributes_of(block: Node) -> list[Node]:
    lists = [part for part in block.children if part.type in ("attribute_list", "attribute")]
    return [inner for part in lists for inner in (part.children if part.type == "attribute_list" else [part])]


def invoke(
    function: Function, state: SessionState, given: dict[str, Value], scope: Scope, out: list[Value], **own: Value
) -> None:
    """Runs it in a new scope, below the innermost one of the session or module that it is of.

    `own` are variables that the scope has besides its parameters.
    """
    inner = Scope(scope.session, state.current)
    inner.variables |= own
    if function.name:
        _describe_call(function, state, given, inner)
    for parameter in function.parameters:
        if parameter.name in given:
            value = given.pop(parameter.name)
            value = None if value is EMPTY else value  # so that text is empty, not missing
            inner.variables[parameter.name] = (
                members.cast(parameter.type, value, scope) if parameter.type else _plain(value)
            )
        elif parameter.mandatory:
            raise Unsupported(f"{function.name} is called without -{parameter.name}, for which PowerShell would ask")
        elif parameter.default:
            inner.variables[parameter.name] = members.cast(parameter.type, parameter.default(inner), scope)
        else:
            inner.variables[parameter.name] = (
                members.cast(parameter.type, None, scope) if parameter.type in _FILLED else None
            )
    if given:
        raise Unsupported(f"{function.name} has no parameter -{', -'.join(given)}")
    session = scope.session
    outer, before = state.current, session.state
    state.current, session.state = inner, state
    try:
        function.body(inner, out)
    except Return:
        return
    finally:
        state.current, session.state = outer, before


def _describe_call(function: Function, state: SessionState, given: dict[str, Value], inner: Scope) -> None:
    """The variables that PowerShell itself gives to a function, and what its common parameters set."""
    called = Record(Name=function.name, Module=state.module)
    inner.variables["myinvocation"] = Record(MyCommand=called, InvocationName=function.name)
    named = {"whatif": "WhatIf", "confirm": "Confirm"}
    inner.variables["psboundparameters"] = Table([(named.get(name, name), value) for name, value in given.items()])
    if function.binding is None:
        return
    what_if = confirm = None
    if function.binding.supports_should_process:
        if "whatif" in given:
            inner.variables["whatifpreference"] = what_if = truth(given.pop("whatif"))
        if "confirm" in given:
            confirm = truth(given.pop("confirm"))
            inner.variables["confirmpreference"] = "Low" if confirm else "None"
    for name, preference in _PREFERENCES.items():
        if name in given:
            inner.variables[preference] = text(given.pop(name))
    inner.variables["pscmdlet"] = Cmdlet(inner.session, function.binding.impact, what_if, confirm)


_PREFERENCES = {
    "erroraction": "erroractionpreference",
    "warningaction": "warningpreference",
    "informationaction": "informationpreference",
}
"""By common parameter: the variable that it sets for what an advanced function calls."""

_FILLED = {"string", "int", "long", "bool", "switch"}


def _plain(value: Value) -> Value:
    return None if value is EMPTY else value


def run_block(block: Value, scope: Scope, *, this: Value = EMPTY, arguments: list[Value] | None = None) -> Value:
    """What a script block gives, called with `$_` or `$args`."""
    if not isinstance(block, Block):
        raise Unsupported(f"{block!r} is not a script block")
    own: dict[str, Value] = {}
    if this is not EMPTY:
        own["_"] = this
    if arguments is not None:
        own["args"] = arguments
    out: list[Value] = []
    invoke(block.function, block.state, {}, scope, out, **own)
    return unwrapped(out)


@cache
def _makers() -> Mapping[str, Callable[[Node], Expression]]:
    binary = ("logical", "bitwise", "comparison", "additive", "multiplicative", "format")
    both: dict[str, Callable[[Node], Expression]] = {
        f"{name}{part}_expression": _binary for name in binary for part in ("", "_argument")
    }
    return both | {
        "string_literal": _literal,
        "integer_literal": _integer,
        "real_literal": _real,
        "type_literal": _type,
        "variable": _variable,
        "array_literal_expression": _array_literal,
        "expression_with_unary_operator": _unary,
        "cast_expression": _cast,
        "parenthesized_expression": _parenthesised,
        "array_expression": _array_expression,
        "hash_literal_expression": _table,
        "member_access": _member,
        "element_access": _element,
        "invokation_expression": _call,
        "post_increment_expression": _increment,
        "script_block_expression": _block,
    }


_MAKERS = _makers()
