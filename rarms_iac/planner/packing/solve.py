"""The best packing of items onto hosts: least cost, then fewest moves, each with its proof where there is one."""

from dataclasses import dataclass, field

from rarms_iac.planner.packing.branch import PENALTY, Limits, Outcome, Proof, Search
from rarms_iac.planner.packing.columns import Weights, relax
from rarms_iac.planner.packing.dual import too_heavy
from rarms_iac.planner.packing.heuristics import quick_packing
from rarms_iac.planner.packing.host_sets import ByHosts, Fewest, fewest_by_hosts
from rarms_iac.planner.packing.improve import improved
from rarms_iac.planner.packing.program import (
    Assignment,
    Bundles,
    Problem,
    Program,
    assignment_of,
    cheapest,
    feasible,
    fewest_moves,
    members,
    value_of,
)
from rarms_iac.planner.packing.waste import without_waste

SEARCHED_UP_TO, RELAXED_UP_TO = 30, 60
"""Items of which it is searched whether there is a packing, and of which the relaxation is asked."""

TRIES = 60
"""Greedy packings that are tried before anything is proved."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Level:
    """One level of the objective: the value of the packing, what none can be below, and the proof that they meet."""

    value: int
    bound: int
    proof: Proof | ByHosts | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Packed:
    """A packing, with what is known of better ones."""

    hosts: Assignment
    cost: Level
    moves: Level
    anew: Assignment = ()  # what the first level found, whatever runs; empty: nothing runs


@dataclass(frozen=True, slots=True, kw_only=True)
class Impossible:
    """There is no packing; the proof is of a program without costs, bounded above nothing."""

    proof: Proof | None  # None: by search


@dataclass(frozen=True, slots=True, kw_only=True)
class GaveUp:
    """No packing was found, and none was ruled out."""


Result = Packed | Impossible | GaveUp


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """How much is tried."""

    limits: Limits = field(default_factory=lambda: Limits(improve=improved))
    tries: int = TRIES


def solve(problem: Problem, settings: Settings | None = None) -> Result:
    """Pack, at least cost first and then with the fewest moves; the same problem always has the same answer."""
    how = settings or Settings()
    first = cheapest(problem)
    least = _least(first)
    start = _any(first, how)
    if isinstance(start, Impossible | GaveUp):
        return start
    if value_of(first, start) == sum(least):  # each item where it costs least: nothing to search
        value, proof = sum(least), Proof(weights=Weights(items=least, scale=1))
        return _with_moves(problem, first, start, Level(value=value, bound=value, proof=proof), how)
    cheapest_of_all = Search(first, start, how.limits, ceiling=_ceiling(first)).run()
    assert cheapest_of_all.bundles is not None
    cost = _level(first, cheapest_of_all)
    return _with_moves(problem, first, cheapest_of_all.bundles, cost, how)


def ruled_out(problem: Problem, settings: Settings | None = None) -> Impossible | None:
    """That there is no packing, where that was shown; the best one is not looked for.

    Of many items only sizes and the relaxation are looked at.
    """
    heavy = too_heavy(problem)
    if heavy is not None:
        return Impossible(proof=Proof(weights=Weights(items=heavy, scale=1)))
    how, first = settings or Settings(), cheapest(problem)
    if problem.items <= SEARCHED_UP_TO:
        answer = _any(first, how)
        return answer if isinstance(answer, Impossible) else None
    if problem.items > RELAXED_UP_TO or quick_packing(first, sum(_least(first)), how.tries) is not None:
        return None
    relaxed = relax(feasible(first), (), 1, PENALTY, how.limits.effort)
    return Impossible(proof=Proof(weights=relaxed.weights)) if relaxed is not None and relaxed.bound else None


def _any(first: Program, how: Settings) -> Bundles | Impossible | GaveUp:
    """A packing to start from, whatever it costs; or that there is none."""
    start = quick_packing(first, sum(_least(first)), how.tries)
    if start is not None:
        return start
    answer = Search(feasible(first), None, how.limits, ceiling=1).run()
    if answer.bundles is not None:
        return answer.bundles
    return Impossible(proof=answer.proof) if answer.bound else GaveUp()


def _with_moves(problem: Problem, first: Program, bundles: Bundles, cost: Level, how: Settings) -> Packed:
    hosts = assignment_of(first, bundles)
    if not problem.now or all(one is None for one in problem.now):
        return Packed(hosts=hosts, cost=cost, moves=Level(value=0, bound=0, proof=None))
    second = fewest_moves(problem, cost.value)
    starts = [settled(problem, first, bundles)]
    quick = quick_packing(second, 0, how.tries)
    starts += [quick] if quick is not None else []
    known = min(starts, key=lambda one: value_of(second, one))
    if value_of(second, known):
        by_hosts = fewest_by_hosts(second, known, how.limits) if cost.value == cost.bound else None
        fewest = by_hosts or Search(without_waste(second), known, how.limits, ceiling=_ceiling(second)).run()
        assert fewest.bundles is not None
        known, moves = fewest.bundles, _level(second, fewest)
    else:
        moves = Level(value=0, bound=0, proof=None)
    return Packed(hosts=assignment_of(second, known), cost=cost, moves=moves, anew=hosts)


def _level(program: Program, outcome: Outcome | Fewest) -> Level:
    assert outcome.bundles is not None
    return Level(value=value_of(program, outcome.bundles), bound=outcome.bound, proof=outcome.proof)


def _least(program: Program) -> tuple[int, ...]:
    """By item: what it costs at least."""
    return tuple(
        min((kind.costs[item] for kind in program.kinds if kind.sizes[item] is not None), default=0)
        for item in range(program.items)
    )


def _ceiling(program: Program) -> int:
    """More than any packing costs."""
    return (
        1
        + sum(kind.opening * len(kind.hosts) for kind in program.kinds)
        + sum(max(kind.costs[item] for kind in program.kinds) for item in range(program.items))
    )


def settled(problem: Problem, first: Program, bundles: Bundles) -> Bundles:
    """The same packing on those of its hosts where most items already are, as bundles of the second level."""
    second = fewest_moves(problem, 0)
    kind_of = {host: at for at, kind in enumerate(second.kinds) for host in kind.hosts}
    free = {at: list(kind.hosts) for at, kind in enumerate(first.kinds)}
    wishes = sorted(
        (-sum(problem.now[item] == host for item in members(mask)), number, host)
        for number, (at, mask) in enumerate(bundles)
        for host in free[at]
    )
    homes: dict[int, int] = {}
    taken: set[int] = set()
    for _, number, host in wishes:
        if number not in homes and host not in taken:
            homes[number] = host
            taken.add(host)
    return tuple(sorted((kind_of[homes[number]], mask) for number, (_, mask) in enumerate(bundles)))
