"""A script's or module's text, made into what can be run: once for each text."""

from __future__ import annotations

import re
from functools import lru_cache

from tests.fake_powershell.expressions import binding_of, parameters_of
from tests.fake_powershell.scopes import Binding, Body, Function, Parameter, Scope
from tests.fake_powershell.statements import block_of
from tests.fake_powershell.values import Value
from tests.powershell_lint.tree import parse


@lru_cache(maxsize=64)
def compiled(script: bytes) -> Function:
    """A script or module of this text; without `CmdletBinding` it has none."""
    pieces = [_piece(text) for text in re.split(_EDGE, script.decode("ascii"))]

    def body(scope: Scope, out: list[Value]) -> None:
        for piece in pieces:
            piece.body(scope, out)

    parameters = tuple(parameter for piece in pieces for parameter in piece.parameters)
    binding = next((piece.binding for piece in pieces if piece.binding), None)
    return Function(name="", parameters=parameters, body=body, binding=binding)


_EDGE = r"(?=#region The module of rarms)|(?<=#endregion\r\n)"
"""Around what gives a script its module: the tree of the whole is those of its pieces, one by one."""


@lru_cache(maxsize=64)
def _piece(text: str) -> Function:
    parameters: tuple[Parameter, ...] = ()
    binding: Binding | None = None
    bodies: list[Body] = []
    for part in parse(text).children:
        if part.type == "param_block":
            parameters, binding = parameters_of(part), binding_of(part)
        elif part.type == "statement_list":
            bodies.append(block_of(part))
        elif part.type != "comment":
            raise AssertionError(f"{part.type} in a script")
    (body,) = bodies
    return Function(name="", parameters=parameters, body=body, binding=binding)
