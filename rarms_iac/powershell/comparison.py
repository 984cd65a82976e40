"""How the steps of one script differ from those of another, as two plans render them. Pure.

A step is known again by its address and by the names of what it calls. The ids of plans stand in names that scripts
give while they make something, so they are taken out before steps are compared.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from rarms_iac.powershell.literals import Scalar
from rarms_iac.powershell.pieces import ScriptPiece

THIS_PLAN = "<plan>"


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptSteps:
    """The steps of a script, in their order."""

    plan: str  # id
    steps: tuple[ScriptPiece, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Detail:
    """One reading or call that differs; None: it is not there."""

    name: str  # before.reserve, after.reserve, Hyper-V\\Set-VMProcessor
    old: str | None
    new: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class StepDifference:
    """A step that only one script has, or that differs; numbers count from 1; None: it is not there."""

    address: str
    action: str
    old: int | None
    new: int | None
    details: tuple[Detail, ...] = ()
    moved: bool = False  # it stands elsewhere in the order of the steps that both have


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptDifference:
    """The steps that differ, in the new script's order, those that are gone last."""

    kind: Literal["script_difference"] = "script_difference"
    old: str  # where the old script comes from
    new: str  # the new script
    steps: tuple[StepDifference, ...]
    same: int  # steps that both have, and that do not differ


_Key = tuple[str, tuple[str, ...], int]


def compare_steps(old: ScriptSteps, new: ScriptSteps, names: tuple[str, str]) -> ScriptDifference:
    """Compare the steps of two scripts, which have these names."""
    from difflib import SequenceMatcher

    there, here = _by_key(old), _by_key(new)
    places = {key: number for number, key in enumerate(there, start=1)}
    blocks = SequenceMatcher(None, [*there], [*here], autojunk=False).get_matching_blocks()
    in_place = {key for block in blocks for key in [*here][block.b : block.b + block.size]}
    differences: list[StepDifference] = []
    for number, (key, step) in enumerate(here.items(), start=1):
        details = tuple(_details(_facts(there[key], old.plan), _facts(step, new.plan))) if key in there else ()
        moved = key in there and key not in in_place
        if key not in there or details or moved:
            differences.append(
                StepDifference(
                    address=step.address,
                    action=step.action,
                    old=places.get(key),
                    new=number,
                    details=details,
                    moved=moved,
                )
            )
    same = len(here) - len(differences)
    differences += [
        StepDifference(address=step.address, action=step.action, old=places[key], new=None)
        for key, step in there.items()
        if key not in here
    ]
    return ScriptDifference(old=names[0], new=names[1], steps=tuple(differences), same=same)


def _by_key(script: ScriptSteps) -> dict[_Key, ScriptPiece]:
    """Return the steps by address, names of calls, and how many alike stand before it."""
    seen: Counter[tuple[str, tuple[str, ...]]] = Counter()
    steps: dict[_Key, ScriptPiece] = {}
    for step in script.steps:
        kind = step.address, tuple(call.partition(" ")[0] for call in step.calls)
        steps[*kind, seen[kind]] = step
        seen[kind] += 1
    return steps


def _facts(step: ScriptPiece, plan: str) -> dict[str, str]:
    """Return everything about a step that can differ, by name."""
    facts = {f"before.{name}": _text_of(value) for name, value in step.before.items()}
    facts |= {f"after.{name}": _text_of(value) for name, value in step.after.items()}
    facts |= dict(_calls((step.read, *step.calls)))
    return {name: text.replace(plan, THIS_PLAN) for name, text in facts.items()}


def _calls(calls: Sequence[str]) -> Iterator[tuple[str, str]]:
    seen: Counter[str] = Counter()
    for call in calls:
        name, _, parameters = call.partition(" ")
        seen[name] += 1
        yield name if seen[name] == 1 else f"{name}[{seen[name]}]", parameters


def _text_of(value: Scalar) -> str:
    return ("yes" if value else "no") if isinstance(value, bool) else str(value)


def _details(old: Mapping[str, str], new: Mapping[str, str]) -> Iterator[Detail]:
    for name in dict.fromkeys([*old, *new]):
        if old.get(name) != new.get(name):
            yield Detail(name=name, old=old.get(name), new=new.get(name))


@dataclass(frozen=True, slots=True, kw_only=True)
class TextDifference:
    """The lines that differ between a file and a script, as `diff -u` writes them; none: they are equal."""

    kind: Literal["script_text_difference"] = "script_text_difference"
    old: str  # the file
    new: str  # the script
    lines: tuple[str, ...]


def compare_texts(old: str, new: str, names: tuple[str, str]) -> TextDifference:
    """Compare two texts, which have these names, line by line."""
    from difflib import unified_diff

    lines = unified_diff(old.splitlines(), new.splitlines(), *names, lineterm="")
    return TextDifference(old=names[0], new=names[1], lines=tuple(lines))
