"""Facts about cmdlets: those of Hyper-V's module and of PowerShell itself, in 5.1 and in 7.

The tables are facts, made once by `scripts/make-cmdlet-tables`. A script may use only what both versions have, under
its whole name.
"""

import json
import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

COMMON = frozenset(
    [
        *("Debug", "ErrorAction", "ErrorVariable", "InformationAction", "InformationVariable", "OutBuffer"),
        *("OutVariable", "PipelineVariable", "Verbose", "WarningAction", "WarningVariable"),
    ]
)
"""Parameters that every cmdlet takes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SetMembership:
    """How a parameter takes part in one parameter set."""

    mandatory: bool
    position: int | None
    from_pipeline: bool
    from_property: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One parameter; `accepted` is empty where any value of its type will do."""

    name: str
    type: str
    sets: Mapping[str, SetMembership]
    accepted: tuple[str, ...]
    aliases: tuple[str, ...]
    not_empty: bool
    in_7: bool

    @property
    def is_switch(self) -> bool:
        """Whether it stands without a value."""
        return self.type == "SwitchParameter"


@dataclass(frozen=True, slots=True, kw_only=True)
class Cmdlet:
    """One cmdlet, as Windows PowerShell 5.1 knows it and 7 confirms."""

    name: str
    module: str
    should_process: bool
    default_set: str
    in_7: bool
    parameters: Mapping[str, Parameter]

    def parameter(self, name: str) -> Parameter | None:
        """The parameter of exactly this name, in any case of its letters."""
        return self.parameters.get(name.lower())


@cache
def _tables() -> Mapping[str, Cmdlet]:
    text = (Path(__file__).parent / "tables/cmdlets.json").read_text(encoding="utf-8")
    return {name.lower(): _cmdlet(name, facts) for name, facts in json.loads(text).items()}


def _cmdlet(name: str, facts: Mapping[str, Any]) -> Cmdlet:
    missing = frozenset(facts["not_in_7"])
    parameters = {
        key.lower(): Parameter(
            name=key,
            type=fact["type"],
            sets={group: _in_set(flags) for group, flags in fact["sets"].items()},
            accepted=tuple(fact.get("values", fact.get("checks", {}).get("set", ()))),
            aliases=tuple(fact.get("aliases", ())),
            not_empty=fact.get("not_empty", False),
            in_7=key not in missing,
        )
        for key, fact in facts["parameters"].items()
    }
    return Cmdlet(
        name=name,
        module=facts["module"],
        should_process=facts["should_process"],
        default_set=facts["default_set"],
        in_7=facts["in_7"],
        parameters=parameters,
    )


def _in_set(flags: str) -> SetMembership:
    position = re.search("p(-?[0-9]+)", flags)
    return SetMembership(
        mandatory="m" in flags,
        position=int(position[1]) if position else None,
        from_pipeline="v" in flags,
        from_property="n" in flags,
    )


def cmdlet(name: str, module: str = "") -> Cmdlet | None:
    """The cmdlet of this name (and module, where it is given), in any case; None where there is none."""
    cmdlet_facts = _tables().get(name.lower())
    return cmdlet_facts if cmdlet_facts and (not module or cmdlet_facts.module.lower() == module.lower()) else None


def problems_of_call(called: Cmdlet, given: Collection[str], *, positional: int = 0) -> tuple[str, ...]:
    """Return why a call with these parameters would not bind in 5.1 and 7 alike; empty where it does.

    `given` are the names as written, `positional` the number of values without one.
    """
    misspelt = [problem for name in given for problem in spelling(called, name)]
    doubled = [name for name, count in Counter(name.lower() for name in given).items() if count > 1]
    if misspelt or doubled:
        return (*misspelt, *(f"-{name} is given twice" for name in doubled))
    own = [parameter for name in given if (parameter := called.parameter(name))]
    if positional:
        return (f"{called.name} is given a value without a name",)
    if any(_fits(called, group, own) for group in _groups(called)):
        return ()
    written = ", ".join(f"-{parameter.name}" for parameter in own) or "no parameter"
    return (f"{called.name} has no parameter set for {written}",)


def spelling(called: Cmdlet, name: str) -> Iterable[str]:
    """Yield what is wrong with a name; an alias or an abbreviation may mean another parameter in another version."""
    if name in COMMON:
        return
    parameter = called.parameter(name)
    if parameter is None:
        yield f"{called.name} has no parameter -{name}"
    elif parameter.name != name:
        yield f"-{name} is written -{parameter.name}"
    elif not parameter.in_7:
        yield f"-{name} of {called.name} does not exist in PowerShell 7"


def _groups(called: Cmdlet) -> tuple[str, ...]:
    named = {group for parameter in called.parameters.values() for group in parameter.sets}
    return tuple(sorted(named)) or ("",)


def _fits(called: Cmdlet, group: str, given: Collection[Parameter]) -> bool:
    """Whether the set takes all that is given and gets all that it must have."""
    if any(group not in parameter.sets for parameter in given):
        return False
    return not any(
        group in parameter.sets and parameter.sets[group].mandatory and parameter not in given
        for parameter in called.parameters.values()
    )
