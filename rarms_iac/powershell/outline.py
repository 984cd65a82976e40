"""The outline of a script, read out of its tree: the run, its steps, and the calls of each; and how two of them differ.

Nothing but the script is asked, so that what it does not say does not happen. For scripts that passed the inspection.

The difference is told step by step and not line by line. A step is known again by its address and by what it calls; of
several alike the first stands for the first. The ids of plans stand in names that scripts give while they make
something, so they are taken out before values are compared. Pure.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from rarms_iac.powershell.inspection.parts import without_fixed
from rarms_iac.powershell.literals import Scalar, read_literal
from rarms_iac.powershell.statements import (
    CommandCall,
    calls_of,
    column_of,
    entries,
    guard_of,
    inner,
    only_call,
    plan_of,
    statements_of,
)
from rarms_iac.powershell.templates import PLAN, STEP_CALL, TARGET, VM
from rarms_iac.powershell.tree import literal_of, parse_strictly, text_of, walk

if TYPE_CHECKING:
    from tree_sitter import Node


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineVariable:
    """The machine that the step has read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptCall:
    """A call of a cmdlet or of the module's function; a switch has the value true."""

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
    facts, parts = plan_of(parse_strictly(without_fixed(script.decode("ascii"))))
    if facts is None:
        raise ValueError(f"the script has no {PLAN} that begins with the facts of its run")
    run = {name: _Reader().scalar(value) for name, value in (entries(facts) or {}).items()}
    steps: list[ScriptStep] = []
    for part in parts:
        for row in part.rows or ({},):
            steps += _Reader(row).steps(len(steps), part.calls)
    return Outline(run=run, steps=tuple(steps))


@dataclass(frozen=True, slots=True)
class _Reader:
    """Reads calls of a plan as they are made for one row of a table, or for none."""

    row: "Mapping[str, Node]" = field(default_factory=dict)

    def steps(self, number: int, calls: Sequence[CommandCall]) -> Iterator[ScriptStep]:
        target: Mapping[str, Node] = {}
        for call in calls:
            given = {name: value for name, value in call.given.items() if value is not None}
            if call.name == TARGET:
                target = given
            elif call.name == STEP_CALL:
                yield self.step(number, target, given)
                number += 1

    def step(self, number: int, target: "Mapping[str, Node]", given: "Mapping[str, Node]") -> ScriptStep:
        (read,) = self.calls(target["Read"])
        same = self.table(given["Same"]) if "Same" in given else {}
        return ScriptStep(
            number=number,
            address=str(self.scalar(target["Address"])),
            action=str(self.scalar(given["Action"])),
            read=read,
            before={**self.table(given["Before"]), **same},
            after={**self.table(given["After"]), **same},
            calls=tuple(self.calls(given["Set"])),
            fits=next(self.calls(given["Fits"])) if "Fits" in given else None,
            undoes=int(self.scalar(given["Undoes"])) if "Undoes" in given else None,
        )

    def scalar(self, node: "Node") -> Scalar:
        value = inner(node)
        return read_literal(text_of(inner(self.row.get(column_of(value), value))))

    def table(self, node: "Node") -> dict[str, Scalar]:
        table = entries(node)
        if table is None:
            raise ValueError(f"{text_of(node)[:60]} is no table")
        return {_name(key): self.scalar(value) for key, value in table.items()}

    def calls(self, block: "Node") -> Iterator[ScriptCall]:
        for statement in statements_of(inner(block)):
            guard = guard_of(statement)
            call = only_call(guard[1] if guard else statement)
            if call is not None:
                yield self.call(call)

    def call(self, call: CommandCall) -> ScriptCall:
        return ScriptCall(name=call.name, parameters={name: self.value(value) for name, value in call.given.items()})

    def value(self, node: "Node | None") -> Scalar | MachineVariable | ScriptCall:
        if node is None:
            return True  # a switch
        value = inner(node)
        if literal_of(value) is not None or column_of(value):
            return self.scalar(value)
        if text_of(value) == VM:
            return MachineVariable()
        (call,) = (candidate for candidate in walk(value) if candidate.type == "command")
        return self.call(next(calls_of(call)))


def _name(key: str) -> str:
    """A key as text, whether it stands in quotes or not."""
    return key if key.isidentifier() else str(read_literal(key))


THIS_PLAN = "<plan>"
Value = Scalar | MachineVariable | ScriptCall


@dataclass(frozen=True, slots=True, kw_only=True)
class Detail:
    """One reading or parameter that differs; None: it is not there."""

    name: str  # before.reserve, after.reserve, Hyper-V\\Set-VMProcessor -Reserve, run.Serial
    old: str | None
    new: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class StepDifference:
    """A step that only one of them has, or that differs; numbers count from 1; None: it is not there."""

    address: str
    action: str
    old: int | None
    new: int | None
    details: tuple[Detail, ...] = ()
    moved: bool = False  # it stands elsewhere in the order of the steps that both have


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptDifference:
    """All that differs: of the run as a whole, and of its steps in the new script's order, gone ones last."""

    kind: Literal["script_difference"] = "script_difference"
    old: str = ""  # where the old script comes from
    new: str = ""  # the new script
    run: tuple[Detail, ...]
    steps: tuple[StepDifference, ...]
    same: int  # steps that both have, and that do not differ

    @property
    def is_empty(self) -> bool:
        """Whether both do the same."""
        return not self.run and not self.steps


def difference(old: Outline, new: Outline) -> ScriptDifference:
    """Compare what the new script does with what the old one does."""
    keys_old, keys_new = _keys(old), _keys(new)
    common = [key for key in keys_new if key in keys_old]
    places = {key: at for at, key in enumerate(keys_old)}
    stay = _longest_rising([places[key] for key in common])
    differences: list[StepDifference] = []
    for key, step in keys_new.items():
        before = keys_old.get(key)
        if before is None:
            differences.append(StepDifference(address=step.address, action=step.action, old=None, new=step.number + 1))
            continue
        details = tuple(_details(_facts(before, old), _facts(step, new)))
        moved = places[key] not in stay
        if details or moved:
            differences.append(
                StepDifference(
                    address=step.address,
                    action=step.action,
                    old=before.number + 1,
                    new=step.number + 1,
                    details=details,
                    moved=moved,
                )
            )
    differences += [
        StepDifference(address=step.address, action=step.action, old=step.number + 1, new=None)
        for key, step in keys_old.items()
        if key not in keys_new
    ]
    changed = sum(difference.old is not None and difference.new is not None for difference in differences)
    return ScriptDifference(run=tuple(_run(old, new)), steps=tuple(differences), same=len(common) - changed)


def _keys(script: Outline) -> dict[tuple[str, tuple[str, ...], int], ScriptStep]:
    keys: dict[tuple[str, tuple[str, ...], int], ScriptStep] = {}
    for step in script.steps:
        kind = (step.address, tuple(call.name for call in step.calls))
        at = 0
        while (*kind, at) in keys:
            at += 1
        keys[*kind, at] = step
    return keys


def _longest_rising(numbers: Sequence[int]) -> frozenset[int]:
    """Of numbers that differ, as many as can be kept in rising order: the others have moved."""
    best: list[list[int]] = [[]]
    for number in numbers:
        before = [run for run in best if not run or run[-1] < number]
        best.append([*max(before, key=len), number])
    longest = max(best, key=len)
    return frozenset(longest)


def _run(old: Outline, new: Outline) -> Iterator[Detail]:
    counted = {"Total", "UndoDigest"}  # they follow from the steps
    before = {f"run.{name}": _format_value(value, "") for name, value in old.run.items() if name not in counted}
    after = {f"run.{name}": _format_value(value, "") for name, value in new.run.items() if name not in counted}
    yield from _details(before, after)


def _facts(step: ScriptStep, script: Outline) -> dict[str, str]:
    """Everything about a step that can differ, by name."""
    plan = str(script.run.get("Plan", ""))
    facts = {f"before.{name}": _format_value(value, plan) for name, value in step.before.items()}
    facts |= {f"after.{name}": _format_value(value, plan) for name, value in step.after.items()}
    for asked in (step.read, *([step.fits] if step.fits else [])):
        facts |= {f"{asked.name} -{name}": _format_value(value, plan) for name, value in asked.parameters.items()}
    names = [call.name for call in step.calls]
    for at, call in enumerate(step.calls):
        name = call.name if names.count(call.name) == 1 else f"{call.name}[{at}]"
        facts |= {f"{name} -{key}": _format_value(value, plan) for key, value in call.parameters.items()}
    if step.undoes is not None:
        facts["undoes step"] = str(step.undoes + 1)
    return facts


def _details(old: Mapping[str, str], new: Mapping[str, str]) -> Iterator[Detail]:
    for name in dict.fromkeys([*old, *new]):
        if old.get(name) != new.get(name):
            yield Detail(name=name, old=old.get(name), new=new.get(name))


def _format_value(value: Value, plan: str) -> str:
    match value:
        case bool():
            return "yes" if value else "no"
        case ScriptCall(name=name, parameters=parameters):
            return " ".join([name, *(f"-{key} {_format_value(value, plan)}" for key, value in parameters.items())])
        case MachineVariable():
            return "the machine"
        case str() if plan:
            return value.replace(plan, THIS_PLAN)
        case _:
            return str(value)
