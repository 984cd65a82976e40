"""What is claimed of a packing, as plain data that `checker.check` accepts or rejects."""

from rarms_iac.planner.packing.branch import Proof
from rarms_iac.planner.packing.columns import Weights, excess_of
from rarms_iac.planner.packing.host_sets import ByHosts
from rarms_iac.planner.packing.program import Problem, Program, cheapest, feasible, fewest_moves, unpriced
from rarms_iac.planner.packing.solve import Impossible, Packed
from rarms_iac.planner.packing.waste import full_dimensions, without_waste

Data = dict[str, object]


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


def _data(program: Program, proof: Proof | ByHosts) -> Data | list[Data] | None:
    """The proof as the checker reads it; None where no excess is known."""
    if isinstance(proof, ByHosts):
        alone = [_weighing(unpriced(program), one, one, tried=True) for one in proof.weights]
        known = [one for one in alone if one is not None]
        return known if len(known) == len(alone) else None
    return _weighing(program, proof.weights, _lifted(program, proof.weights), tried=proof.tried)


def _weighing(program: Program, weights: Weights, told: Weights, *, tried: bool) -> Data | None:
    excess = [excess_of(program, at, weights) for at in range(len(program.kinds))]
    by_host = {host: more for more, kind in zip(excess, program.kinds, strict=True) for host in kind.hosts}
    if None in excess:
        return None
    return {
        "items": list(told.items),
        "excess": [by_host[host] for host in sorted(by_host)],
        "rates": [told.budget, told.scale],
        "tried": tried,
    }


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
