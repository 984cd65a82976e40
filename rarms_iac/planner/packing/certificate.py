"""What is claimed of a packing, as plain data that `checker.check` accepts or rejects."""

from rarms_iac.planner.packing.branch import Proof
from rarms_iac.planner.packing.columns import Weights, fixed_cost, profits_of
from rarms_iac.planner.packing.patterns import best_pattern
from rarms_iac.planner.packing.program import Problem, Program, cheapest, feasible, fewest_moves
from rarms_iac.planner.packing.solve import Impossible, Packed
from rarms_iac.planner.packing.waste import full_dimensions, without_waste

Data = dict[str, object]

NODES = 50_000
"""Sets that are tried for the excess of a host: a count, so that the same input has the same certificate."""


def problem_data(problem: Problem) -> Data:
    """The problem as the checker reads it; hosts that nothing tells apart are told once."""
    kinds: dict[str, int] = {}
    told: list[Data] = []
    hosts = []
    for host in range(len(problem.rooms)):
        kind = _kind(problem, host)
        number = kinds.setdefault(repr(kind), len(told))
        hosts.append(number)
        if number == len(told):
            told.append(kind)
    return {
        "hosts": hosts,
        "kinds": told,
        "now": list(problem.now) or [None] * problem.items,
        "conflicts": sorted(map(list, problem.conflicts)),
    }


def _kind(problem: Problem, host: int) -> Data:
    there = problem.processors[host] if problem.processors else None
    return {
        "room": list(problem.rooms[host]),
        "sizes": [None if size is None else list(size) for size in problem.sizes[host]],
        "opening": problem.opening[host],
        "costs": list(problem.costs[host]),
        "processors": None
        if there is None
        else [there.logical, [*map(list, there.virtual)], [*map(list, there.others)]],
    }


def claim_of(problem: Problem, result: Packed | Impossible) -> Data | None:
    """The claim that the result is the best; None where that was not proved, or an excess is not known."""
    first = cheapest(problem)
    if isinstance(result, Impossible):
        proof = None if result.proof is None else _data(feasible(first), result.proof)
        return None if proof is None else {"impossible": proof}
    second = without_waste(fewest_moves(problem, result.cost.value)) if result.moves.value else first
    claim: Data = {"hosts": list(result.hosts), "cost": result.cost.value, "moves": result.moves.value}
    for name, level, program in (("cost_proof", result.cost, first), ("moves_proof", result.moves, second)):
        if level.value == 0:
            claim[name] = None  # nothing is below nothing
            continue
        data = _data(program, level.proof) if level.proof is not None and level.value == level.bound else None
        if data is None:
            return None
        claim[name] = data
    return claim


def _data(program: Program, proof: Proof) -> Data | None:
    """The proof as the checker reads it; None where no excess is known."""
    excess = [_excess(program, at, proof.weights) for at in range(len(program.kinds))]
    weights = _lifted(program, proof.weights)
    by_host = {host: more for more, kind in zip(excess, program.kinds, strict=True) for host in kind.hosts}
    if None in excess:
        return None
    return {
        "items": list(weights.items),
        "excess": [by_host[host] for host in sorted(by_host)],
        "rates": [weights.budget, weights.scale],
        "tried": proof.tried,
    }


def _excess(program: Program, at: int, weights: Weights) -> int | None:
    """What a set of items on such a host weighs more than it costs, at most; None where no search has the end of it."""
    fixed, profits = fixed_cost(program, at, weights), profits_of(program, at, weights)
    most, complete = fixed, False
    while not complete:
        best, complete = best_pattern(program, at, profits, NODES, most)
        if best is None and not complete:
            return None
        most = most if best is None else best.profit
    return most - fixed


def _lifted(program: Program, weights: Weights) -> Weights:
    """The weights, so heavy on size that no set which leaves room on a host matters.

    Where the hosts that are paid for must be full, the search looks at full hosts only. Size added to the weights, and
    taken away again by the budget row, changes nothing for those and lowers all others.
    """
    full = full_dimensions(program)
    if not full:
        return weights
    first = program.kinds[0]
    more = first.charge * (1 + sum(map(abs, weights.items)) + abs(weights.budget) * first.charge)
    sizes = [sum(size[d] for d in full) if size is not None else 0 for size in first.sizes]
    room = sum(first.room[d] for d in full)
    return Weights(
        items=tuple(weight + more * size for weight, size in zip(weights.items, sizes, strict=True)),
        budget=weights.budget - more // first.charge * room,
        scale=weights.scale,
    )
