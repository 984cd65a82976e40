"""Fewest moves, one set of hosts after another: the best there is, and certified, whatever kinds of host there are."""

from benchmarks.packings import instance
from rarms_iac.planner.certifying.checker import check
from rarms_iac.planner.certifying.claim import claim_of, problem_data
from rarms_iac.planner.packing.branch import Limits
from rarms_iac.planner.packing.host_sets import ByHosts, fewest_by_hosts
from rarms_iac.planner.packing.program import fewest_moves, value_of
from rarms_iac.planner.packing.solve import Impossible, Packed, solve
from tests.effort import examples
from tests.packings import does_pack, every_packing, on_several_kinds
from tests.packings import value_of as value_by_definition


def test_small_packings_on_several_kinds_of_host_are_the_best_of_all_and_certified() -> None:
    by_hosts = 0
    for seed in range(examples(60)):
        problem = on_several_kinds(seed)
        every = every_packing(problem)

        found = solve(problem)

        if isinstance(found, Impossible):
            assert not every, seed
            continue
        assert isinstance(found, Packed), seed
        assert does_pack(problem, found.hosts), seed
        assert value_by_definition(problem, found.hosts) == every[0][0] == (found.cost.value, found.moves.value), seed
        assert found.moves.bound == found.moves.value, seed
        claim = claim_of(problem, found)
        assert claim is not None, seed
        check(problem_data(problem), claim)
        by_hosts += isinstance(found.moves.proof, ByHosts)
    assert by_hosts, "some of them are shown by sets of hosts"


def test_sets_of_hosts_are_looked_at_whatever_packing_is_known() -> None:
    """From the worst packing of least cost: the same number of moves, shown by weights of several sets."""
    shown = 0
    for seed in range(examples(40)):
        problem = on_several_kinds(seed)
        every = every_packing(problem)
        if not every or len(set(zip(problem.rooms, problem.opening, strict=True))) == 1:
            continue
        cost = every[0][0][0]
        second = fewest_moves(problem, cost)
        dearest = max(moves for (price, moves), _ in every if price == cost)
        where = next(hosts for value, hosts in every if value == (cost, dearest))
        kind_of = {host: at for at, kind in enumerate(second.kinds) for host in kind.hosts}
        known = tuple(
            sorted((kind_of[host], sum(1 << item for item in range(6) if where[item] == host)) for host in set(where))
        )
        assert value_of(second, known) == dearest, seed

        found = fewest_by_hosts(second, known, Limits())

        assert found is not None, seed
        assert value_of(second, found.bundles) == found.bound == every[0][0][1], seed
        shown += found.proof is not None and len(found.proof.weights) > 1
    assert shown


def test_hosts_that_are_alike_are_not_looked_at_in_sets() -> None:
    problem = instance("uniform", 0).problem
    second = fewest_moves(problem, 9)

    assert fewest_by_hosts(second, (), Limits()) is None


def test_kinds_of_host_are_proved_and_certified() -> None:
    """Thirty items on twelve hosts of two or three kinds; the moves were found by another program first."""
    for seed, moves in ((2, 11), (4, 10)):
        problem = instance("kinds", seed).problem

        found = solve(problem)

        assert isinstance(found, Packed)
        assert (found.moves.value, found.moves.bound) == (moves, moves)
        claim = claim_of(problem, found)
        assert claim is not None
        check(problem_data(problem), claim)
