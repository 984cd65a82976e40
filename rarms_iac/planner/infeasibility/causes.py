"""Why there is no layout: who cannot share which hosts, by how much, and what would fit."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import assert_never

from rarms_iac.model.claims import Claim, load_of
from rarms_iac.model.commands import PLAN, prose
from rarms_iac.model.diagnostics import Diagnostic, Facts
from rarms_iac.model.layout import Infeasible
from rarms_iac.planner import planning_findings
from rarms_iac.planner.infeasibility.conflict import (
    NODES_FOR_CHANGES,
    NODES_FOR_MOVES,
    NODES_OF_A_SEARCH,
    Conflict,
    Lack,
    SearchBudget,
    conflict_budget,
    conflicts,
    conflicts_by_sums,
    describe_rounding,
    evident_conflicts,
)
from rarms_iac.planner.infeasibility.edits import Variant, VariantPlanner
from rarms_iac.planner.infeasibility.ways_out import ways_out
from rarms_iac.planner.packing.pack import can_pack, find_packing
from rarms_iac.planner.packing.values import Bin, Item, free_on, is_move, least_cost, least_memory
from rarms_iac.planner.problem import Problem, problem_of
from rarms_iac.planner.totals import hosts_without_layout
from rarms_iac.texts.findings import Finding
from rarms_iac.texts.messages import list_names, natural_order, number, quoted
from rarms_iac.texts.quantities import show_bytes, show_lp_percent, show_processors

_MOVES = "moves"
"""The part of the search that looks for partitions that have to move."""

MOST_NAMES = 12
"""Names in a sentence; more are counted."""


def explain_infeasibility(answer: Infeasible, problem: Problem, start: Variant) -> Infeasible:
    """Add to an answer without causes who conflicts, why, and what would fit.

    Args:
        start: What the problem was made of: changes of it are planned.

    Returns:
        The same answer with causes and up to a few ways out, each planned before it is offered.
    """
    budgets = conflict_budget(), SearchBudget.of(NODES_FOR_MOVES), SearchBudget.of(NODES_FOR_CHANGES)
    for_conflict, for_moves, for_changes = budgets
    found = conflicts(problem.items, problem.bins, for_conflict, proven=answer.proven)
    needed = moves_needed(start, for_moves)
    causes = [_cause(conflict, problem, {} if at else needed) for at, conflict in enumerate(found)]
    planner = VariantPlanner(start=start, budget=for_changes)
    names = sorted({item.name for conflict in found for item in conflict.items}, key=natural_order)
    return replace(
        answer,
        proven=answer.proven or all(conflict.proven for conflict in found),
        causes=tuple(causes),
        relaxations=ways_out(problem, names, planner, needed),
        unfinished=tuple(dict.fromkeys(part for budget in budgets for part in budget.unfinished)),
        node_limit=NODES_OF_A_SEARCH,
    )


def moves_needed(start: Variant, budget: SearchBudget) -> Mapping[str, str]:
    """Find partitions whose present hosts alone leave no layout.

    Args:
        budget: Of this search; none of the moves is without need where it is enough.

    Returns:
        The host that each of them would have to leave, by name; none where moving is allowed already, or does not help.
    """
    application = start.system.application.name
    if start.may_move or not any(state.of(application).partitions for state in start.states.values()):
        return {}
    problem = problem_of(start.system, start.reservations, start.states, may_move=True)
    pairs = sum(len(item.claims) for item in problem.items)
    for items, bins in ((each.items, each.bins) for each in (problem, problem.without_checks())):
        if budget.takes(_MOVES, pairs) and (host_of := find_packing(items, bins, budget.nodes)):
            moving = [item for item in items if is_move(item, host_of[item.name])]
            return {item.name: item.current_host for item in _fewest_moves(moving, items, bins, budget)}
    return {}


def _fewest_moves(
    moving: Sequence[Item], items: Sequence[Item], bins: Sequence[Bin], budget: SearchBudget
) -> Sequence[Item]:
    """Leave out moves that are not needed, by halves, quarters and so on."""
    step = len(moving)
    while step:
        at = 0
        while at < len(moving):
            others = [*moving[:at], *moving[at + step :]]
            names = {item.name for item in others}
            tried = [item if item.name in names else _staying(item) for item in items]
            pairs = sum(len(item.claims) for item in tried)
            if budget.takes(_MOVES, pairs) and can_pack(tried, bins, nodes=budget.nodes):
                moving = others
            else:
                at += step
        step = -(-step // 2) if step > 1 else 0
    return moving


def _staying(item: Item) -> Item:
    """Return the partition where it is; one that is nowhere, or may not stay, keeps its choice."""
    current = item.current_host
    return replace(item, claims={current: item.claims[current]}) if current in item.claims else item


def _describe_moves(needed: Mapping[str, str]) -> str:
    """Write as: vision would have to leave onboard."""
    return list_names((f"{name} would have to leave {host}" for name, host in needed.items()), MOST_NAMES)


def evident_causes(problem: Problem) -> tuple[Diagnostic, ...]:
    """Name what cannot fit, as far as sums and single hosts show it.

    Args:
        problem: Partitions without any claim do not count.

    Returns:
        Causes without advice; none where it takes a search to say more.
    """
    items = [item for item in problem.items if item.claims]
    return tuple(_cause(conflict, problem) for conflict in evident_conflicts(items, problem.bins))


def explain_by_sums(answer: Infeasible, problem: Problem) -> Infeasible:
    """Say why nothing fits as far as sums show it; the solver is not asked.

    Args:
        answer: What `solve` said, without causes.
        problem: What was solved; every partition has a claim.

    Returns:
        The same answer with at least one cause, whose advice is the command that searches for more.
    """
    advice = prose("Search for the causes and for changes that help: ", PLAN, ".")
    found = conflicts_by_sums(problem.items, problem.bins)
    causes = [_cause(conflict, problem) for conflict in found]
    if not causes:
        template = "No placement of {_partitions:partition} on {_hosts:host} was found."
        numbers = {"_partitions": len(problem.items), "_hosts": len(problem.bins)}
        causes = [planning_findings.PLACEMENT.at(None, template, "", address="application", related=(), **numbers)]
    return replace(
        answer,
        proven=answer.proven or bool(found),
        causes=tuple(replace(cause, advice=advice) for cause in causes),
    )


def _cause(conflict: Conflict, problem: Problem, needed: Mapping[str, str] = MappingProxyType({})) -> Diagnostic:
    """Return a cause without advice; `needed` has the moves with which there would be a layout, as `moves_needed`."""
    finding, message = _shortage(conflict, problem)
    if conflict.lacking is Lack.MEMORY:
        message += _held_by_others(conflict, problem, lambda claim: claim.memory, show_bytes)
    else:
        message += _held_by_others(conflict, problem, lambda claim: claim.percent, show_lp_percent)
        message += describe_rounding(conflict, problem)
        message += "".join(_describe_smt(conflict, host) for host in conflict.bins)
    moves: Facts = {"would_move": tuple(needed)} if needed else {}
    if needed:
        message += f" The partitions fit if they may move: {_describe_moves(needed)}."
    free = free_on(conflict.bins)
    return finding.at(
        None,
        "{_message}",
        "",
        address=f"host/{conflict.bins[0].name}",
        related=(),
        partitions=tuple(item.name for item in conflict.items),
        hosts=tuple(host.name for host in conflict.bins),
        needs_lp=sum(map(least_cost, conflict.items)) / 100,
        has_lp=float(free.processors),
        needs_memory_bytes=sum(map(least_memory, conflict.items)),
        has_memory_bytes=free.memory,
        unmanaged_machines=tuple(name for *_, name in _claims_of_others(conflict, problem)),
        _message=message,
        **moves,
    )


def _shortage(conflict: Conflict, problem: Problem) -> tuple[Finding, str]:
    """Return the finding on the lack of the hosts of a conflict, and its sentence."""
    names = list_names((item.name for item in conflict.items), MOST_NAMES)
    cannot_share = f"{names} cannot share {list_names((host.name for host in conflict.bins), MOST_NAMES)}"
    match conflict.lacking:
        case Lack.PROCESSORS:
            return planning_findings.RESERVATIONS, _processors_exceed(conflict, problem)
        case Lack.MEMORY:
            return planning_findings.MEMORY, _memory_exceeds(conflict, problem)
        case Lack.PLACEMENT if len(conflict.bins) == 1:
            reason = f"each virtual processor needs its whole reserve on one of the {_describe_cores(conflict.bins[0])}"
            return planning_findings.PACKING, f"{cannot_share}: {reason}, and no such placement exists."
        case Lack.PLACEMENT:
            reason = "together the hosts have enough capacity, but each partition needs room on one host"
            return planning_findings.PLACEMENT, f"{cannot_share}: {reason}."
        case _:
            assert_never(conflict.lacking)


def _describe_smt(conflict: Conflict, host: Bin) -> str:
    """Return the cost there of cores that never run two machines; empty where it costs nothing."""
    claims = [*host.foreign_claims, *(item.claims[host.name] for item in conflict.items if host.name in item.claims)]
    idle = load_of(claims).idle_processors
    if not idle:
        return ""
    return (
        f" The core scheduler of {host.name} runs one machine on a core at a time. It has {_logical_processors(host)} "
        f"in {number(host.capacity.cores)} cores. {show_processors(idle)} would be idle, because machines have an odd "
        f"number of virtual processors or no SMT. Use an even number of `processors` and HwThreadCountPerCore 0."
    )


def _processors_exceed(conflict: Conflict, problem: Problem) -> str:
    """Write as: FDP 1.4 LP, SRP 0.6 LP and PPP 0.4 LP need 2.4 LP; onboard has 2 LP for partitions."""
    exceeded = _sum_exceeds(conflict, problem, least_cost, show_lp_percent, free_on(conflict.bins).percent)
    if len(conflict.bins) > 1:
        return exceeded
    (host,) = conflict.bins
    whole = host.capacity.logical_processors
    for_host = whole - host.capacity.processors
    return (
        f"{exceeded} Of its {show_processors(whole)}, {show_processors(for_host)} are kept for the host."
        if for_host
        else exceeded
    )


def _held_by_others(
    conflict: Conflict, problem: Problem, amount: Callable[[Claim], int], show: Callable[[int], str]
) -> str:
    """Write as: Unmanaged machines hold 0.8 LP: "web" 0.5 LP and "build" 0.3 LP. Empty if they hold nothing."""
    held = [
        (amount(claim), quoted(name) + (f" on {host}" if len(conflict.bins) > 1 else ""))
        for host, claim, name in _claims_of_others(conflict, problem)
        if amount(claim)
    ]
    if not held:
        return ""
    held.sort(key=lambda holder: (-holder[0], natural_order(holder[1])))
    shares = list_names((f"{name} {show(each)}" for each, name in held), MOST_NAMES)
    return f" Unmanaged machines reserve {show(sum((each for each, _ in held)))}: {shares}."


def _claims_of_others(conflict: Conflict, problem: Problem) -> Iterator[tuple[str, Claim, str]]:
    """Yield host, claim and name of each unmanaged machine on the hosts of a conflict."""
    for host in conflict.bins:
        for machine in problem.seen[host.name].claimants:
            yield host.name, machine.claim, machine.settings.name


def _memory_exceeds(conflict: Conflict, problem: Problem) -> str:
    free, needed = free_on(conflict.bins).memory, sum(map(least_memory, conflict.items))
    return _sum_exceeds(conflict, problem, least_memory, lambda memory: show_bytes(memory, free, needed), free)


def _sum_exceeds(
    conflict: Conflict, problem: Problem, need: Callable[[Item], int], show: Callable[[int], str], free: int
) -> str:
    """Write as: FDP 3 GiB and SRP 2 GiB need 5 GiB; onboard has 4 GiB for partitions. `free` has the unit of needs."""
    hosts = list_names((host.name for host in conflict.bins), MOST_NAMES)
    verb = "has" if len(conflict.bins) == 1 else "have"
    together = _all_together(conflict, problem, need, show)
    return f"{_needs(conflict, need, show)}; {hosts} {verb} {show(free)} for partitions.{together}"


def _all_together(conflict: Conflict, problem: Problem, need: Callable[[Item], int], show: Callable[[int], str]) -> str:
    """Return the sum with the other partitions that count on these hosts; empty where there are none.

    Ways out count them, and so do the totals of `rarms measure`; a conflict leaves them out.
    """
    hosts, conflicting = {host.name for host in conflict.bins}, {item.name for item in conflict.items}
    host_of = hosts_without_layout(problem)
    others = [item for item in problem.items if item.name not in conflicting and host_of.get(item.name) in hosts]
    if not others:
        return ""
    names = sorted((item.name for item in others), key=natural_order)
    in_all = sum(map(need, [*conflict.items, *others]))
    return f" With {list_names(names, MOST_NAMES)}, the total is {show(in_all)}."


def _needs(conflict: Conflict, need: Callable[[Item], int], show: Callable[[int], str]) -> str:
    if len(conflict.items) == 1:
        return f"{conflict.items[0].name} needs {show(need(conflict.items[0]))}"
    ordered = sorted(conflict.items, key=lambda item: (-need(item), natural_order(item.name)))
    shares = list_names((f"{item.name} {show(need(item))}" for item in ordered), MOST_NAMES)
    return f"{shares} need {show(sum(map(need, ordered)))}"


def _logical_processors(host: Bin) -> str:
    many = host.capacity.logical_processors
    return f"{number(many)} logical processor{'' if many == 1 else 's'}"


def _describe_cores(host: Bin) -> str:
    """Return the processors that virtual ones are laid onto: `two logical processors`, `four cores`."""
    return _logical_processors(host) if host.capacity.sharing.threads == 1 else f"{number(host.capacity.cores)} cores"
