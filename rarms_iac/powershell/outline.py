"""The outline of a script, read out of its tree: the run, its steps, and the calls of each.

Nothing but the script is asked, so that what it does not say does not happen. For scripts that passed the inspection.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rarms_iac.powershell.inspection.layout import without_fixed
from rarms_iac.powershell.inspection.script import CommandCall, calls_of
from rarms_iac.powershell.inspection.steps import entries, inner, only_call, statements_of
from rarms_iac.powershell.literals import Scalar, read_literal
from rarms_iac.powershell.tokens import TokenKind, tokens
from rarms_iac.powershell.tree import literal_of, sound, text_of, walk

if TYPE_CHECKING:
    from tree_sitter import Node

OPEN, STEP, GUARD = "Open-Run", "Add-Step", "Guard"


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineVariable:
    """`$vm`: the machine that the call before it found."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptCall:
    """A call of a cmdlet or of the runtime's function; a switch has the value true. `found`: it fills `$vm`."""

    name: str
    parameters: "Mapping[str, Scalar | MachineVariable | ScriptCall]"
    found: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptStep:
    """One guarded piece of a script, as it stands there."""

    number: int
    address: str
    action: str
    needs: tuple[str, ...]
    read: ScriptCall
    before: Mapping[str, Scalar]
    after: Mapping[str, Scalar]
    calls: tuple[ScriptCall, ...]
    fits: ScriptCall | None  # asks whether the host has room; None: it promises nothing more
    undoes: int | None  # of an undo script: the number of the step that it takes back


@dataclass(frozen=True, slots=True, kw_only=True)
class Outline:
    """A script that changes something: what it says of its run, and its steps in their order."""

    run: Mapping[str, Scalar]
    steps: tuple[ScriptStep, ...]


def outline(script: bytes) -> Outline:
    """Read what the script does.

    Raises:
        NotParsed: it is no PowerShell.
        ValueError: it has no run, or a step in another form; the inspection says more.
    """
    run: Mapping[str, Scalar] | None = None
    steps: list[ScriptStep] = []
    for call in calls_of(sound(without_fixed(script.decode("ascii")))):
        if call.name == OPEN:
            run = _literals({name: value for name, value in _definition(call).items() if name != GUARD})
        elif call.name == STEP:
            steps.append(_step(_definition(call)))
    if run is None:
        raise ValueError(f"the script has no {OPEN}")
    return Outline(run=run, steps=tuple(steps))


def _definition(call: CommandCall) -> Mapping[str, "Node"]:
    value = call.given[0].value if call.given else None
    table = entries(value) if value else None
    if table is None:
        raise ValueError(f"{call.name} gets no table")
    return table


def _step(table: Mapping[str, "Node"]) -> ScriptStep:
    (read,) = _calls(table["Read"])
    return ScriptStep(
        number=int(_literal(table["Number"])),
        address=str(_literal(table["Address"])),
        action=str(_literal(table["Action"])),
        needs=_texts(table["Needs"]),
        read=read,
        before=_table(table["Before"]),
        after=_table(table["After"]),
        calls=tuple(_calls(table["Set"])),
        fits=next(_calls(table["Fits"])) if "Fits" in table else None,
        undoes=int(_literal(table["Undoes"])) if "Undoes" in table else None,
    )


def _literal(node: "Node") -> Scalar:
    return read_literal(text_of(inner(node)))


def _literals(table: Mapping[str, "Node"]) -> dict[str, Scalar]:
    return {_name(key): _literal(value) for key, value in table.items()}


def _name(key: str) -> str:
    """A key as text, whether it stands in quotes or not."""
    return key if key.isidentifier() else str(read_literal(key))


def _table(node: "Node") -> dict[str, Scalar]:
    table = entries(node)
    if table is None:
        raise ValueError(f"{text_of(node)[:60]} is no table")
    return _literals(table)


def _texts(node: "Node") -> tuple[str, ...]:
    """The texts of an array of literals: plain ASCII, as addresses are."""
    return tuple(token.text for token in tokens(text_of(inner(node))) if token.kind is TokenKind.STRING)


def _calls(block: "Node") -> Iterator[ScriptCall]:
    for statement in statements_of(inner(block)):
        call = only_call(statement)
        if call is not None:
            yield _call(call, found=False)
        else:
            yield from (_call(call, found=True) for call in calls_of(statement))


def _call(call: CommandCall, *, found: bool) -> ScriptCall:
    parameters = {given.name: _value(given.value) for given in call.given}
    return ScriptCall(name=call.name, parameters=parameters, found=found)


def _value(node: "Node | None") -> Scalar | MachineVariable | ScriptCall:
    if node is None:
        return True  # a switch
    value = inner(node)
    if literal_of(value) is not None:
        return _literal(value)
    if text_of(value) == "$vm":
        return MachineVariable()
    (call,) = (candidate for candidate in walk(value) if candidate.type == "command")
    return _call(next(calls_of(call)), found=False)
