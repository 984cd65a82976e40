"""A host for every partition: first fit where that is as good as can be, otherwise the solver's best."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from rarms_iac.model.capacity import holds
from rarms_iac.planner.assigning.assignment import Assignment
from rarms_iac.planner.assigning.bounds import simple_bound, too_much
from rarms_iac.planner.assigning.first_fit import best_first_fit
from rarms_iac.planner.assigning.highs import is_installed, minimise
from rarms_iac.planner.assigning.names import first_by_name
from rarms_iac.planner.assigning.repair import repaired
from rarms_iac.planner.assigning.values import Bin, Item, NoPacking, Packing, all_hold, cost, least_cost, value_of

NODES = 2_000_000
"""Nodes that the solver looks at for one level of the objective, times the variables of the program."""

MOST = 5_000
"""Nodes for a level, however few variables there are."""

SHORT = 100
"""Nodes after which a packing is looked for by other ways too."""

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
    bins = sorted(bins, key=lambda host: host.name)
    items = [_where_it_fits(item, bins) for item in sorted(items, key=lambda item: item.name)]
    if any(not item.claims for item in items) or too_much(items, bins):
        return NoPacking(proven=True)
    bound = simple_bound(items, bins)
    hosts: Mapping[str, str] | None
    if all(len(item.claims) == 1 for item in items):
        hosts = {item.name: next(iter(item.claims)) for item in items}
        held = all_hold(items, bins, hosts)
        value = value_of(items, hosts)
        return _packing(hosts, value, value) if held else NoPacking(proven=held is False)
    hosts = best_first_fit(items, bins, bound)
    if hosts is None or value_of(items, hosts) != bound:
        if is_installed():
            return _solved(items, bins, hosts, bound, nodes)
        if hosts is None:
            return NoPacking(proven=False)
    return _named(_packing(hosts, value_of(items, hosts), bound), items, bins)


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
    excesses, unit = program.excesses()
    least = sum(map(least_cost, items))
    if any(excesses) and (start is None or value_of(items, start)[0] > least):
        start = _any([_where_it_costs_least(item) for item in items], bins, nodes).hosts or start
    if start is None:
        found = _any(items, bins, nodes)
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


def _any(items: Sequence[Item], bins: Sequence[Bin], nodes: int) -> "_Level":
    """A packing, whatever it is worth; without one, whether there is none."""
    program = Assignment(items, bins)
    level = _settle(program, [0] * len(program.pairs), None, SHORT * len(program.pairs))
    if level.hosts is None and level.bound is not None and nodes > SHORT * len(program.pairs):
        hosts = repaired(items, bins)
        level = (
            _settle(program, [0] * len(program.pairs), None, nodes) if hosts is None else replace(level, hosts=hosts)
        )
    return replace(level, bound=0) if program.unsure else level


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
        answer = minimise(costs, program.rows, nodes=min(MOST, nodes // len(costs)), start=chosen)
        if answer.bound is None:
            return _Level(hosts=start, bound=bound if start is not None else None)
        bound = max(bound, answer.bound)
        if answer.ones is None:
            return _Level(hosts=start, bound=bound)
        if not program.forbid(answer.ones):
            return _Level(hosts=program.hosts(answer.ones), bound=bound)
    return _Level(hosts=start, bound=bound)
