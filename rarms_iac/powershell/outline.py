"""The outline of a script, read out of its tree: the run, its steps, and the calls of each.

Nothing but the script is asked, so that what it does not say does not happen. For scripts that passed the inspection.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rarms_iac.powershell.inspection.layout import without_fixed
from rarms_iac.powershell.inspection.script import CommandCall, calls_of
from rarms_iac.powershell.inspection.steps import entries, inner, only_call, plan_of, statements_of
from rarms_iac.powershell.literals import Scalar, read_literal
from rarms_iac.powershell.templates import PLAN, STEP_CALL, TARGET, VM
from rarms_iac.powershell.tree import literal_of, sound, text_of, walk

if TYPE_CHECKING:
    from tree_sitter import Node

GUARD = "Guard"


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineVariable:
    """The machine that the step has read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptCall:
    """A call of a cmdlet or of the runtime's function; a switch has the value true."""

    name: str
    parameters: "Mapping[str, Scalar | MachineVariable | ScriptCall]"


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptStep:
    """One guarded piece of a script, as it stands there."""

    number: int
    address: str
    action: str
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
    facts, calls = plan_of(sound(without_fixed(script.decode("ascii"))))
    if facts is None:
        raise ValueError(f"the script has no {PLAN} that begins with the facts of its run")
    run = {name: _literal(value) for name, value in (entries(facts) or {}).items() if name != GUARD}
    steps: list[ScriptStep] = []
    target: Mapping[str, Node] = {}
    for call in calls:
        given = {parameter.name: parameter.value for parameter in call.given if parameter.value is not None}
        if call.name == TARGET:
            target = given
        elif call.name == STEP_CALL:
            steps.append(_step(len(steps), target, given))
    return Outline(run=run, steps=tuple(steps))


def _step(number: int, target: "Mapping[str, Node]", given: "Mapping[str, Node]") -> ScriptStep:
    (read,) = _calls(target["Read"])
    return ScriptStep(
        number=number,
        address=str(_literal(target["Address"])),
        action=str(_literal(given["Action"])),
        read=read,
        before=_table(given["Before"]),
        after=_table(given["After"]),
        calls=tuple(_calls(given["Set"])),
        fits=next(_calls(given["Fits"])) if "Fits" in given else None,
        undoes=int(_literal(given["Undoes"])) if "Undoes" in given else None,
    )


def _literal(node: "Node") -> Scalar:
    return read_literal(text_of(inner(node)))


def _name(key: str) -> str:
    """A key as text, whether it stands in quotes or not."""
    return key if key.isidentifier() else str(read_literal(key))


def _table(node: "Node") -> dict[str, Scalar]:
    table = entries(node)
    if table is None:
        raise ValueError(f"{text_of(node)[:60]} is no table")
    return {_name(key): _literal(value) for key, value in table.items()}


def _calls(block: "Node") -> Iterator[ScriptCall]:
    for statement in statements_of(inner(block)):
        call = only_call(statement)
        if call is not None:
            yield _call(call)


def _call(call: CommandCall) -> ScriptCall:
    return ScriptCall(name=call.name, parameters={given.name: _value(given.value) for given in call.given})


def _value(node: "Node | None") -> Scalar | MachineVariable | ScriptCall:
    if node is None:
        return True  # a switch
    value = inner(node)
    if literal_of(value) is not None:
        return _literal(value)
    if text_of(value) == VM:
        return MachineVariable()
    (call,) = (candidate for candidate in walk(value) if candidate.type == "command")
    return _call(next(calls_of(call)))
