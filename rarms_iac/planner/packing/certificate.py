"""What is claimed of a packing, as plain data that `checker.check` accepts or rejects."""

from rarms_iac.planner.packing.branch import Proof
from rarms_iac.planner.packing.columns import Weights
from rarms_iac.planner.packing.program import Problem, Program, cheapest, feasible, fewest_moves
from rarms_iac.planner.packing.solve import Impossible, Packed
from rarms_iac.planner.packing.waste import full_dimensions

Data = dict[str, object]


def problem_data(problem: Problem) -> Data:
    """The problem as the checker reads it; what `Problem.fits` adds is not in it, so bounds hold with or without."""
    return {
        "sizes": [[None if size is None else list(size) for size in row] for row in problem.sizes],
        "rooms": [list(room) for room in problem.rooms],
        "opening": list(problem.opening),
        "costs": [list(row) for row in problem.costs],
        "now": list(problem.now),
        "conflicts": sorted(map(list, problem.conflicts)),
    }


def claim_of(problem: Problem, result: Packed | Impossible) -> Data | None:
    """The claim that the result is the best, None where that was not proved."""
    first = cheapest(problem)
    if isinstance(result, Impossible):
        return None if result.proof is None else {"impossible": _data(feasible(first), result.proof)}
    second = fewest_moves(problem, result.cost.value)
    proofs: Data = {}
    for name, level, program in (("cost_proof", result.cost, first), ("moves_proof", result.moves, second)):
        if level.value == 0:
            proofs[name] = None  # nothing is below nothing
        elif level.proof is None or level.value > level.bound:
            return None
        else:
            proofs[name] = _data(program, level.proof)
    return {
        "hosts": list(result.hosts),
        "cost": result.cost.value,
        "moves": result.moves.value,
        **proofs,
    }


def _data(program: Program, proof: Proof) -> Data:
    weights = _lifted(program, proof.weights)
    return {"items": list(weights.items), "budget": weights.budget, "scale": weights.scale, "tried": proof.tried}


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
