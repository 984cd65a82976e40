"""A host for every partition: first fit where that is as good as can be, otherwise the solver's best."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from rarms_iac.model.capacity import holds
from rarms_iac.planner.packing.assignment import Assignment
from rarms_iac.planner.packing.bounds import simple_bound, too_much
from rarms_iac.planner.packing.first_fit import best_first_fit
from rarms_iac.planner.packing.highs import is_installed, minimise
from rarms_iac.planner.packing.names import first_by_name
from rarms_iac.planner.packing.repair import repaired
from rarms_iac.planner.packing.values import Bin, Item, NoPacking, Packing, all_hold, cost, least_cost, value_of

NODES = 2_000_000
"""Nodes that the solver looks at for one level of the objective, times the variables of the program."""

MOST = 5_000
"""Nodes for a level, however few variables there are."""

SHORT = 500
"""Nodes of the search for a packing, whatever it is worth; most proofs that there is none take fewer."""

ROUNDS = 40
"""Times that a level is solved anew because virtual processors found no logical ones."""


def pack(items: Sequence[Item], bins: Sequence[Bin], *, nodes: int = NODES) -> Packing | NoPacking:
    """Find a host for each partition: least reservation in all, then fewest moves, then the first by name.

    Args:
        items: The partitions, in any order, with what each claims on the hosts that it may run on.
        bins: The hosts, in any order.
        nodes: After so many nodes of a search, times partitions on hosts that they may be on, the best packing so far
            is taken: a count, never a time.

    Returns:
        The best packing that was found, with bounds; or that none was found, and whether there is none. The same
        input has the same answer with the same version of the solver. Where the solver is not installed, the best of
        a few first fits.
    """
    items, bins = _ready(items, bins)
    if _is_too_much(items, bins):
        return NoPacking(proven=True)
    if (only := _only_way(items)) is not None:
        held, value = all_hold(items, bins, only), value_of(items, only)
        return _packing(only, value, value) if held else NoPacking(proven=held is False)
    bound = simple_bound(items, bins)
    hosts = best_first_fit(items, bins, bound)
    if hosts is None or value_of(items, hosts) != bound:
        if is_installed():
            return _solved(items, bins, hosts, bound, nodes)
        if hosts is None:
            return NoPacking(proven=False)
    return _named(_packing(hosts, value_of(items, hosts), bound), items, bins)


def packs(items: Sequence[Item], bins: Sequence[Bin], *, by_first_fit: bool = False) -> bool | None:
    """Say whether a short search finds a packing, whatever it is worth.

    Args:
        items: As of `pack`.
        bins: As of `pack`.
        by_first_fit: The solver is not asked: a hundred times as fast, and more often neither is known.

    Returns:
        True: there is one; False: there is none; None: none was found, and there may be one.
    """
    items, bins = _ready(items, bins)
    if _is_too_much(items, bins):
        return False
    if (only := _only_way(items)) is not None:
        return all_hold(items, bins, only)
    if best_first_fit(items, bins) is not None:
        return True
    if by_first_fit or not is_installed():
        return None
    level = _any(items, bins)
    return level.hosts is not None or (False if level.bound is None else None)


def _ready(items: Sequence[Item], bins: Sequence[Bin]) -> tuple[list[Item], list[Bin]]:
    """Both by name, the partitions with the claims that a host can keep while no other is there."""
    bins = sorted(bins, key=lambda host: host.name)
    return [_where_it_fits(item, bins) for item in sorted(items, key=lambda item: item.name)], bins


def _is_too_much(items: Sequence[Item], bins: Sequence[Bin]) -> bool:
    return any(not item.claims for item in items) or too_much(items, bins)


def _only_way(items: Sequence[Item]) -> dict[str, str] | None:
    """Where each partition has to be; None: some have a choice."""
    if any(len(item.claims) > 1 for item in items):
        return None
    return {item.name: next(iter(item.claims)) for item in items}


def _where_it_fits(item: Item, bins: Sequence[Bin]) -> Item:
    """The same with the claims that a host can keep while nothing else that is packed is there."""
    claims = {
        host.name: item.claims[host.name]
        for host in bins
        if host.name in item.claims and holds(host.capacity, (*host.taken, item.claims[host.name])) is not False
    }
    return replace(item, claims=claims)


def _packing(hosts: Mapping[str, str], value: tuple[int, int], bound: tuple[int, int]) -> Packing:
    return Packing(hosts=hosts, reserved=value[0], reserved_bound=bound[0], moves=value[1], moves_bound=bound[1])


def _named(packing: Packing, items: Sequence[Item], bins: Sequence[Bin]) -> Packing:
    """Of the packings that are as good the first by name, where that is quickly found."""
    if not packing.proven:
        return packing
    hosts = first_by_name(items, bins, (packing.reserved, packing.moves))
    return packing if hosts is None else replace(packing, hosts=hosts)


def _solved(
    items: Sequence[Item],
    bins: Sequence[Bin],
    start: Mapping[str, str] | None,
    bound: tuple[int, int],
    nodes: int,
) -> Packing | NoPacking:
    """Level after level: the least reservation, and with that the fewest moves."""
    program = Assignment(items, bins)
    nodes = min(MOST, nodes // len(program.pairs))
    excesses, unit = program.excesses()
    least = sum(map(least_cost, items))
    if any(excesses) and (start is None or value_of(items, start)[0] > least):
        start = _any_or_repaired([_where_it_costs_least(item) for item in items], bins).hosts or start
    if start is None:
        found = _any_or_repaired(items, bins)
        if found.hosts is None:
            return NoPacking(proven=found.bound is None)
        start = found.hosts
    reserved = 0
    if value_of(items, start)[0] > least:
        level = _settle(program, excesses, start, nodes)
        start, reserved = level.hosts or start, level.bound or 0
    if any(excesses):
        program.limit(excesses, (value_of(items, start)[0] - least) // unit)
    hosts, moves = start, bound[1]
    if value_of(items, start)[1] > moves:
        level = _settle(program, program.moves(), start, nodes)
        hosts, moves = level.hosts or start, level.bound or 0
    value = value_of(items, hosts)
    assert all_hold(items, bins, hosts), "each host was looked at"
    if not program.unsure:
        bound = max(bound[0], least + unit * reserved), max(bound[1], min(value[1], moves))
    return _named(_packing(hosts, value, bound), items, bins)


def _any(items: Sequence[Item], bins: Sequence[Bin]) -> "_Level":
    """A packing, whatever it is worth; without one, whether there is none."""
    program = Assignment(items, bins)
    level = _settle(program, [0] * len(program.pairs), None, SHORT)
    return replace(level, bound=0) if program.unsure else level


def _any_or_repaired(items: Sequence[Item], bins: Sequence[Bin]) -> "_Level":
    """The same; where the search ended at its limit, hosts are packed anew."""
    level = _any(items, bins)
    return level if level.hosts is not None or level.bound is None else replace(level, hosts=repaired(items, bins))


def _where_it_costs_least(item: Item) -> Item:
    claims = {host: claim for host, claim in item.claims.items() if cost(claim) == least_cost(item)}
    return replace(item, claims=claims)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Level:
    """What came of one level."""

    hosts: Mapping[str, str] | None  # the best packing that is known
    bound: int | None  # what no packing costs less than; None: there is none


def _settle(program: Assignment, costs: Sequence[int], start: Mapping[str, str] | None, nodes: int) -> _Level:
    """Solve, and solve again without the sets that do not fit, until each host can keep what is put there."""
    bound = 0
    chosen = None if start is None else program.chosen(start)
    for _ in range(ROUNDS):
        answer = minimise(costs, program.rows, nodes=nodes, start=chosen)
        if answer.bound is None:
            return _Level(hosts=start, bound=bound if start is not None else None)
        bound = max(bound, answer.bound)
        if answer.ones is None:
            return _Level(hosts=start, bound=bound)
        if not program.forbid(answer.ones):
            return _Level(hosts=program.hosts(answer.ones), bound=bound)
    return _Level(hosts=start, bound=bound)
