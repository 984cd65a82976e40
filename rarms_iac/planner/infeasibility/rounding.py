"""Whether a conflict is there only because reserves are rounded up to whole per cent of each virtual processor."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from rarms_iac.model.claims import Claim
from rarms_iac.model.quantities import LogicalProcessors, guaranteed, show_processors
from rarms_iac.model.wording import counted, in_a_row, natural_order
from rarms_iac.planner.infeasibility.conflict import Conflict, Lack
from rarms_iac.planner.measured_together import NotMeasured
from rarms_iac.planner.packing.pack import can_pack
from rarms_iac.planner.packing.values import Item, free_on, least_cost
from rarms_iac.planner.problem import Problem
from rarms_iac.planner.reservations import depends_on_a_log
from rarms_iac.planner.sizes import wanted_reserve


@dataclass(frozen=True, slots=True, kw_only=True)
class _Rounded:
    """A fixed reserve that a host rounds up, and the largest one below it that it does not."""

    wanted: LogicalProcessors
    processors: int  # virtual ones
    given: LogicalProcessors
    below: LogicalProcessors


def describe_rounding(conflict: Conflict, problem: Problem) -> str:
    """Say which reserves are rounded up, if the whole per cent below would fit, or the sum would without rounding.

    Returns:
        Sentences that begin with a space; empty where rounding does not decide.
    """
    rounded = {item.name: found for item in problem.items if (found := dict(_rounded(item.name, problem)))}
    names = [item.name for item in conflict.items if item.name in rounded]
    for lowered in (names, list(rounded)):
        items = [_lowered(item, rounded[item.name]) if item.name in lowered else item for item in problem.items]
        if lowered and can_pack(items, problem.bins, by_first_fit=True):
            found = {name: next(iter(rounded[name].values())) for name in sorted(lowered, key=natural_order)}
            return f"{_rounding(found.values())} {_fitting(found)}"
    first = [next(iter(rounded[name].values())) for name in names]
    surplus = sum(100 * (each.given - each.wanted) for each in first)
    needed, free = sum(map(least_cost, conflict.items)), free_on(conflict.bins).percent
    decides = conflict.lacking is Lack.PROCESSORS and needed - surplus <= free < needed
    return _rounding(first) if decides else ""


def _rounded(name: str, problem: Problem) -> Iterator[tuple[str, _Rounded]]:
    group = next(group for group in problem.groups if group.name == name)
    if depends_on_a_log(group):
        return  # less was not shown to be enough
    for host, partition in problem.sizes[name].items():
        wanted = wanted_reserve(group, problem.system.hosts[host], problem.reservations)
        settings = partition.settings
        if isinstance(wanted, NotMeasured) or settings.reserve < 2:  # below 1 % is nothing
            continue
        given = guaranteed(settings.reserve, settings.processors)
        if wanted < given:
            below = guaranteed(settings.reserve - 1, settings.processors)
            yield host, _Rounded(wanted=wanted, processors=settings.processors, given=given, below=below)


def _lowered(item: Item, rounded: Mapping[str, _Rounded]) -> Item:
    claims: dict[str, Claim] = {
        host: replace(claim, reserve=claim.reserve - 1) if host in rounded else claim
        for host, claim in item.claims.items()
    }
    return replace(item, claims=claims)


def _rounding(rounded: Iterable[_Rounded]) -> str:
    ups = dict.fromkeys(
        f"{show_processors(each.wanted)} on {counted(each.processors, 'VP')} is rounded up to "
        f"{show_processors(each.given)}"
        for each in rounded
    )
    return f" A host gives whole per cent of each VP: {in_a_row([*ups])}."


def _fitting(rounded: Mapping[str, _Rounded]) -> str:
    amounts = {name: show_processors(each.below) for name, each in rounded.items()}
    if len(amounts) > 1 and len({*amounts.values()}) == 1:
        return f"With {next(iter(amounts.values()))} each, {in_a_row([*amounts])} fit."
    return f"With {in_a_row([f'{amount} for {name}' for name, amount in amounts.items()])}, everything fits."
