"""The best packing of items onto hosts: least cost, then fewest moves, each with its proof where there is one."""

from dataclasses import dataclass, field

from rarms_iac.planner.packing.branch import PENALTY, Limits, Outcome, Proof, Search
from rarms_iac.planner.packing.columns import SCALE, Effort, Weights, relax
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
from rarms_iac.planner.packing.waste import payable, without_waste

SEARCHED_UP_TO, RELAXED_UP_TO = 30, 100
"""Items of which it is searched whether there is a packing, and of which the relaxation is asked."""

RELAXING = Effort(pattern_nodes=5_000, rounds=200)

TRIES = 60
"""Greedy packings that are tried before anything is proved."""

TRIES_OF_MOVES = 15
"""Of the second level: few greedy packings cost the budget."""


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
    tries_of_moves: int = TRIES_OF_MOVES


def solve(problem: Problem, settings: Settings | None = None) -> Result:
    """Pack, at least cost first and then with the fewest moves; the same problem always has the same answer."""
    how = settings or Settings()
    first = cheapest(problem)
    simple = by_volume(first)
    least = payable(first, simple.bound)
    start = _any(first, least, how)
    if isinstance(start, Impossible | GaveUp):
        return start
    if value_of(first, start) == least:  # nothing to search
        level = Level(value=least, bound=least, proof=Proof(weights=simple.weights))
        return _with_moves(problem, first, start, level, how)
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
        answer = _any(first, by_volume(first).bound, how)
        return answer if isinstance(answer, Impossible) else None
    if problem.items > RELAXED_UP_TO or quick_packing(first, by_volume(first).bound, how.tries) is not None:
        return None
    relaxed = relax(feasible(first), (), 1, PENALTY, RELAXING)
    return Impossible(proof=Proof(weights=relaxed.weights)) if relaxed is not None and relaxed.bound else None


def finds_room(problem: Problem, settings: Settings | None = None, *, searching: bool = True) -> bool:
    """Whether a packing was found, whatever it costs, as `solve` begins; without searching, by greedy ones alone."""
    first, how = cheapest(problem), settings or Settings()
    least = by_volume(first).bound
    if not searching:
        return quick_packing(first, least, how.tries) is not None
    return not isinstance(_any(first, least, how), Impossible | GaveUp)


def _any(first: Program, least: int, how: Settings) -> Bundles | Impossible | GaveUp:
    """A packing to start from, whatever it costs; or that there is none."""
    start = quick_packing(first, least, how.tries)
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
    quick = quick_packing(second, 0, how.tries_of_moves)
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Simple:
    """What no packing costs less than, and the weights that show it but for what hosts of that price have room for."""

    bound: int
    weights: Weights


def by_volume(program: Program) -> Simple:
    """What items cost where that is least, with their share of a host, by the dimension in which that is most."""
    scale = SCALE if any(kind.opening for kind in program.kinds) else 1
    dimensions = range(len(program.kinds[0].room)) if program.kinds else ()
    told = [Weights(items=_shares(program, d, scale), scale=scale) for d in dimensions]
    best = max(told, key=lambda one: sum(one.items), default=Weights(items=(0,) * program.items, scale=scale))
    return Simple(bound=-(-sum(best.items) // scale), weights=best)


def _shares(program: Program, dimension: int, scale: int) -> tuple[int, ...]:
    """By item; rounded down, so that no set that fits a host weighs more than the host costs."""
    by_item = (
        [
            scale * kind.costs[item] + scale * kind.opening * size[dimension] // max(1, kind.room[dimension])
            for kind in program.kinds
            if (size := kind.sizes[item]) is not None
        ]
        for item in range(program.items)
    )
    return tuple(min(shares, default=0) for shares in by_item)


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
