"""A host for every partition: first fit where that is as good as can be, otherwise the solver's best.

Of packings that are equally good the first by name, so that equal inputs have equal answers, however they were found.
"""

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from rarms_iac.model.capacity import Effort, decide_fit
from rarms_iac.model.claims import Claim
from rarms_iac.model.layout import Placement
from rarms_iac.planner.packing.assignment import Assignment, find_by_repacking
from rarms_iac.planner.packing.first_fit import FEW_WAYS, best_first_fit, exceeds_capacity, lower_bound
from rarms_iac.planner.packing.highs import Nodes, is_installed, minimise
from rarms_iac.planner.packing.values import (
    Bin,
    Item,
    NoPacking,
    Objective,
    Packing,
    hosts_can_hold,
    is_move,
    least_cost,
    objective_of,
)

TRIED = 4_000
"""Hosts that are tried for a partition, in all: a count, never a time."""

STEPS = 20_000
"""Steps in which places for virtual processors are searched for, in all."""


def first_by_name(items: Sequence[Item], bins: Sequence[Bin], best: Objective) -> dict[str, str] | None:
    """Find the best packing in which the first partition is on the first host that it can be on, and so on.

    Args:
        best: The objective of a packing that no other is better than.

    Returns:
        The host of each partition; None where no packing was found in `TRIED` steps.
    """
    least = [0] * (len(items) + 1)  # what the partitions from this number on reserve at least
    for number in reversed(range(len(items))):
        least[number] = least[number + 1] + least_cost(items[number])
    claims: dict[str, list[Claim]] = {host.name: list(host.foreign_claims) for host in bins}
    capacities = {host.name: host.capacity for host in bins}
    effort = Effort(STEPS)
    hosts: list[str] = []  # of the partitions that are placed
    untried: list[Iterator[tuple[str, Claim]]] = []  # of each of these and of the next one
    reserved = moves = tried = 0
    while len(hosts) < len(items):
        number = len(hosts)
        if len(untried) == number:
            untried.append(iter(sorted(items[number].claims.items())))
        name, claim = next(untried[-1], ("", None))
        if claim is None:
            if not hosts:
                return None
            untried.pop()
            name = hosts.pop()
            reserved -= claims[name].pop().percent
            moves -= is_move(items[number - 1], name)
            continue
        tried += 1
        if tried + len(items) - number - 1 > TRIED:  # each of the others takes one try at least
            return None
        move = is_move(items[number], name)
        if reserved + claim.percent + least[number + 1] > best[0] or moves + move > best[1]:
            continue
        claims[name].append(claim)
        if not decide_fit(capacities[name], claims[name], effort):
            claims[name].pop()
            continue
        hosts.append(name)
        reserved, moves = reserved + claim.percent, moves + move
    return {item.name: host for item, host in zip(items, hosts, strict=True)}


NODES = 2_000_000
"""Nodes that the solver looks at in one stage, times the variables of the program: larger programs get fewer."""

MOST_NODES = 5_000
"""Nodes of a stage, however few variables there are."""

NODES_FOR_ANY = 200_000
"""Nodes of the search for any packing, good or not, times the variables; most proofs of none take fewer."""

MOST_NODES_FOR_ANY = 200
"""Nodes of that search, however few variables there are."""

REPACKING_NODES, REPACKING_NODES_A_PARTITION = 40, 1
"""Nodes of packing a few hosts again: before that search, since it is often enough, and for each partition after it."""

ROUNDS = 40
"""Times that a stage is solved again because virtual processors found no logical ones."""

ROUNDS_FOR_ANY = 15
"""The same for the search for any packing, good or not."""


def pack(items: Sequence[Item], bins: Sequence[Bin], *, node_budget: int = NODES) -> Packing | NoPacking:
    """Find a host for each partition: least reservation in all, then fewest moves, then the first by name.

    Args:
        items: The partitions, in any order, with what each claims on the hosts that it may run on.
        bins: The hosts, in any order.
        node_budget: Nodes of a search times its variables (partitions on hosts that they may be on); where it is spent
            the best packing so far is taken. A count, never a time.

    Returns:
        The best packing that was found, with bounds; or that none was found, and whether there is none. The same
        input has the same answer with the same version of the solver. Where the solver is not installed, the best of
        a few first fits.
    """
    items, bins = without_hopeless_claims(items, bins)
    if _is_too_much(items, bins):
        return NoPacking(proven=True)
    if (forced := _forced_hosts(items)) is not None:
        fits, objective = hosts_can_hold(items, bins, forced), objective_of(items, forced)
        return (
            _packing(forced, objective, objective) if fits else NoPacking(proven=fits is False, undecided=fits is None)
        )
    bound = lower_bound(items, bins)
    host_of = best_first_fit(items, bins, bound)
    if host_of is None or objective_of(items, host_of) != bound:
        if is_installed():
            return _solve(items, bins, host_of, bound, node_budget)
        if host_of is None:
            return NoPacking(proven=False)
    return _first_of_equals(_packing(host_of, objective_of(items, host_of), bound), items, bins)


def can_pack(
    items: Sequence[Item], bins: Sequence[Bin], *, by_first_fit: bool = False, nodes: Nodes | None = None
) -> bool | None:
    """Say whether a short search finds any packing, good or not.

    Args:
        by_first_fit: The solver is not asked: a hundred times as fast, and more often neither is known.
        nodes: What the solver may look at here and in other searches; None: as much as one search may.

    Returns:
        True: there is one; False: there is none; None: none was found, and there may be one.
    """
    found = _find_quickly(items, bins, by_first_fit=by_first_fit, nodes=nodes)
    return found.host_of is not None or (False if found.bound is None else None)


def find_packing(items: Sequence[Item], bins: Sequence[Bin], nodes: Nodes) -> Mapping[str, str] | None:
    """Find any packing by a short search, good or not.

    Returns:
        The host of each partition; None: none was found, and there may be one.
    """
    return _find_quickly(items, bins, by_first_fit=False, nodes=nodes).host_of


def _find_quickly(
    items: Sequence[Item], bins: Sequence[Bin], *, by_first_fit: bool, nodes: Nodes | None
) -> "_StageResult":
    items, bins = without_hopeless_claims(items, bins)
    if _is_too_much(items, bins):
        return _StageResult(host_of=None, bound=None)
    if (forced := _forced_hosts(items)) is not None:
        fits = hosts_can_hold(items, bins, forced)
        return _StageResult(host_of=forced if fits else None, bound=None if fits is False else 0)
    if (host_of := best_first_fit(items, bins, ways=FEW_WAYS if by_first_fit else None)) is not None:
        return _StageResult(host_of=host_of, bound=0)
    if by_first_fit or not is_installed():
        return _StageResult(host_of=None, bound=0)
    return _find_any(items, bins, nodes)


def without_hopeless_claims(items: Sequence[Item], bins: Sequence[Bin]) -> tuple[list[Item], list[Bin]]:
    """Sort both by name, and leave the partitions the claims that a host can keep while no other is there.

    Returns:
        Partitions and hosts by name; a partition may be without claims then.
    """
    bins = sorted(bins, key=lambda host: host.name)
    kinds: dict[Hashable, list[Bin]] = {}
    for host in bins:
        kinds.setdefault((host.capacity, host.foreign_claims), []).append(host)
    return [_with_possible_claims(item, kinds) for item in sorted(items, key=lambda item: item.name)], bins


def _with_possible_claims(item: Item, kinds: Mapping[Hashable, Sequence[Bin]]) -> Item:
    """Drop claims that cannot fit, judging each claim once for all hosts that are alike."""
    claims = {}
    for hosts in kinds.values():
        possible: dict[int, bool] = {}  # by the claim's identity: alike hosts share one, and most hosts are alike
        for host in hosts:
            if (claim := item.claims.get(host.name)) is not None:
                if id(claim) not in possible:
                    possible[id(claim)] = decide_fit(host.capacity, (*host.foreign_claims, claim)) is not False
                if possible[id(claim)]:
                    claims[host.name] = claim
    return replace(item, claims=dict(sorted(claims.items())))


def _is_too_much(items: Sequence[Item], bins: Sequence[Bin]) -> bool:
    return any(not item.claims for item in items) or exceeds_capacity(items, bins)


def _forced_hosts(items: Sequence[Item]) -> dict[str, str] | None:
    """Return the only possible host of each partition; None: some have a choice."""
    if any(len(item.claims) > 1 for item in items):
        return None
    return {item.name: next(iter(item.claims)) for item in items}


def _packing(host_of: Mapping[str, str], objective: Objective, bound: Objective) -> Packing:
    placement = Placement(reserved=objective[0], reserved_bound=bound[0], moves=objective[1], moves_bound=bound[1])
    return Packing(host_of=host_of, placement=placement)


def _first_of_equals(packing: Packing, items: Sequence[Item], bins: Sequence[Bin]) -> Packing:
    """Return the first by name of equally good packings, if it is found quickly."""
    if not packing.placement.proven:
        return packing
    host_of = first_by_name(items, bins, (packing.placement.reserved, packing.placement.moves))
    return packing if host_of is None else replace(packing, host_of=host_of)


def _solve(
    items: Sequence[Item],
    bins: Sequence[Bin],
    start: Mapping[str, str] | None,
    bound: Objective,
    node_budget: int,
) -> Packing | NoPacking:
    """Minimise the reservation, then the moves. Each stage begins with the best packing so far.

    A stage is passed over where its start meets the bound already.
    """
    program = Assignment(items, bins)
    nodes = min(MOST_NODES, node_budget // len(program.pairs))
    excesses, unit = program.excesses()
    least, fewest = bound
    # A start: one with everybody at its cheapest ends the first stage before it begins; otherwise any packing will do.
    if any(excesses) and (start is None or objective_of(items, start)[0] > least):
        cheapest = [_with_cheapest_claims(item) for item in items]
        repacked = find_by_repacking(cheapest, bins, Nodes(REPACKING_NODES))
        start = repacked or _find_any(cheapest, bins).host_of or start
    if start is None:
        found = _find_any_or_repack(items, bins)
        if found.host_of is None:
            return NoPacking(proven=found.bound is None, undecided=found.undecided)
        start = found.host_of
    # The first stage: the least reservation, counted from the bound, in units that all excesses are multiples of.
    excess = 0
    if objective_of(items, start)[0] > least:
        stage = _minimise_costs(program, excesses, start, nodes)
        start, excess = stage.host_of or start, stage.bound or 0
    # The second: the fewest moves of packings that reserve no more than that.
    if any(excesses):
        program.bound_costs(excesses, (objective_of(items, start)[0] - least) // unit)
    host_of, moves = start, fewest
    if objective_of(items, start)[1] > moves:
        stage = _minimise_costs(program, program.moves(), start, nodes)
        host_of, moves = stage.host_of or start, stage.bound or 0
    objective = objective_of(items, host_of)
    assert hosts_can_hold(items, bins, host_of), "each host was looked at"
    # What the stages proved counts only where every set that was forbidden is known not to fit.
    if not program.forbids_unproven:
        bound = least + unit * excess, max(fewest, min(objective[1], moves))
    return _first_of_equals(_packing(host_of, objective, bound), items, bins)


def _find_any(items: Sequence[Item], bins: Sequence[Bin], nodes: Nodes | None = None) -> "_StageResult":
    """Find any packing, good or not; without one, report whether none exists."""
    program = Assignment(items, bins)
    variables = len(program.pairs)
    most = min(MOST_NODES_FOR_ANY, NODES_FOR_ANY // variables)
    found = _minimise_costs(program, [0] * variables, None, most, nodes or Nodes(most))
    return replace(found, bound=0, undecided=True) if program.forbids_unproven else found


def _find_any_or_repack(items: Sequence[Item], bins: Sequence[Bin]) -> "_StageResult":
    """Find any packing: repack a few hosts at a time before the search, and for longer after it gave up."""
    host_of = find_by_repacking(items, bins, Nodes(REPACKING_NODES))
    if host_of is not None:
        return _StageResult(host_of=host_of, bound=0)
    found = _find_any(items, bins)
    if found.host_of is not None or found.bound is None:
        return found
    return replace(found, host_of=find_by_repacking(items, bins, Nodes(REPACKING_NODES_A_PARTITION * len(items))))


def _with_cheapest_claims(item: Item) -> Item:
    claims = {host: claim for host, claim in item.claims.items() if claim.percent == least_cost(item)}
    return replace(item, claims=claims)


@dataclass(frozen=True, slots=True, kw_only=True)
class _StageResult:
    """The result of one stage."""

    host_of: Mapping[str, str] | None  # the best packing that is known
    bound: int | None  # what no packing costs less than; None: there is none
    undecided: bool = False  # as of `NoPacking`


def _minimise_costs(
    program: Assignment,
    costs: Sequence[int],
    start: Mapping[str, str] | None,
    nodes: int,
    budget: Nodes | None = None,
) -> _StageResult:
    """Solve, and solve again without the sets that do not fit, until each host can keep what is put there."""
    bound = 0
    known = None if start is None else program.variables_of(start)
    for _ in range(ROUNDS_FOR_ANY if start is None else ROUNDS):
        answer = minimise(costs, program.rows, nodes=nodes, start=known, budget=budget)
        if answer.bound is None:
            return _StageResult(host_of=start, bound=bound if start is not None else None)
        bound = max(bound, answer.bound)
        if answer.ones is None:
            return _StageResult(host_of=start, bound=bound)
        if not program.forbid(answer.ones):
            return _StageResult(host_of=program.host_of(answer.ones), bound=bound)
    return _StageResult(host_of=start, bound=bound)
