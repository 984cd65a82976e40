"""What is ruled out has no packing: by trying all of small ones, and by the checker of large ones."""

from collections.abc import Callable, Sequence
from random import Random

import pytest

from rarms_iac.planner.certifying.checker import check
from rarms_iac.planner.certifying.claim import claim_of, problem_data
from rarms_iac.planner.packing.dual import too_heavy
from rarms_iac.planner.packing.program import Problem, Sizes
from rarms_iac.planner.packing.solve import ruled_out
from tests.effort import LONG
from tests.packings import a_packing, every_packing, with_processors

TRIED = 2_000 if LONG else 150


@pytest.mark.parametrize("make", [a_packing, with_processors])
def test_what_is_ruled_out_cannot_be_packed_and_what_cannot_is(make: Callable[[int], Problem]) -> None:
    heavy = 0
    for seed in range(TRIED):
        problem = make(seed)
        cannot = not every_packing(problem)
        too_much = too_heavy(problem) is not None
        heavy += too_much

        assert (ruled_out(problem) is not None) is cannot
        assert cannot or not too_much

    assert heavy > TRIED // 50


def equal_hosts(sizes: Sequence[Sizes], room: Sizes, hosts: int) -> Problem:
    return Problem(
        sizes=(tuple(sizes),) * hosts,
        rooms=(room,) * hosts,
        opening=(0,) * hosts,
        costs=((0,) * len(sizes),) * hosts,
        now=(None,) * len(sizes),
    )


def accepted(problem: Problem) -> bool:
    found = ruled_out(problem)
    claim = None if found is None else claim_of(problem, found)
    if claim is None:
        return False
    check(problem_data(problem), claim)
    return True


def test_of_many_items_those_that_are_too_heavy_are_few() -> None:
    """Twenty-one of more than half a host on twenty hosts, and sixty small ones that are nothing to that."""
    problem = equal_hosts([(51,)] * 21 + [(1,)] * 60, (100,), 20)

    weights = too_heavy(problem)

    assert weights is not None
    assert [item for item, weight in enumerate(weights) if weight] == list(range(21))
    assert accepted(problem)


def test_of_many_items_the_relaxation_rules_out_what_no_function_of_one_measure_does() -> None:
    random = Random(0)
    low, high = 20, 50
    sizes = [(random.randint(low, high), random.randint(low, high)) for _ in range(32)]
    hosts = -(-max(sum(size[d] for size in sizes) for d in range(2)) // 100)
    problem = equal_hosts(sizes, (100, 100), hosts)

    assert too_heavy(problem) is None
    assert accepted(problem)
    assert not accepted(equal_hosts(sizes, (100, 100), hosts + 3))
