"""A packing fits, loses nobody, and is the best there is, on both levels; and the same problem has the same answer."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.packings import FAMILIES, instance
from rarms_iac.planner.certifying.checker import check
from rarms_iac.planner.certifying.claim import claim_of, problem_data
from rarms_iac.planner.packing.branch import Limits
from rarms_iac.planner.packing.columns import Weights
from rarms_iac.planner.packing.cover import covered
from rarms_iac.planner.packing.program import cheapest
from rarms_iac.planner.packing.solve import GaveUp, Impossible, Packed, Settings, by_volume, solve
from tests.effort import LONG, examples
from tests.packings import a_packing, does_pack, every_packing, on_several_kinds, value_of

SMALL = range(examples(150))


def test_small_packings_are_the_best_of_all_and_certified() -> None:
    impossible = 0
    for seed in SMALL:
        problem = a_packing(seed)
        every = every_packing(problem)

        found = solve(problem)

        assert not isinstance(found, GaveUp), seed
        claim = claim_of(problem, found)
        assert claim is not None, seed
        check(problem_data(problem), claim)
        match found:
            case Packed(hosts=hosts):
                assert does_pack(problem, hosts), seed
                assert value_of(problem, hosts) == every[0][0] == (found.cost.value, found.moves.value), seed
                assert (found.cost.bound, found.moves.bound) == every[0][0], seed
            case _:
                assert isinstance(found, Impossible), seed
                assert not every, seed
                impossible += 1
    assert impossible, "some of them have no packing"


def test_what_fits_beyond_sizes_is_asked() -> None:
    """No more than two items on the first host, whatever their sizes."""
    for seed in SMALL[::4]:
        problem = replace(a_packing(seed), fits=at_most_two_on_the_first, alike=tuple(range(3)))
        every = every_packing(problem)

        found = solve(problem)

        if isinstance(found, Packed):
            assert does_pack(problem, found.hosts), seed
            assert (found.cost.value, found.moves.value) == every[0][0], seed
        else:
            assert not every, seed


def test_what_volume_says_is_never_more_than_the_least_cost() -> None:
    met = 0
    for seed in SMALL[::2]:
        problem = a_packing(seed) if seed % 4 else on_several_kinds(seed)
        every = every_packing(problem)
        if every:
            bound = by_volume(cheapest(problem)).bound
            assert bound <= every[0][0][0], seed
            met += bound == every[0][0][0]
    assert met


def at_most_two_on_the_first(host: int, items: object) -> bool:
    assert isinstance(items, list)
    return host != 0 or len(items) <= 2


QUICK = Settings(limits=Limits(nodes=6, dives=3, first_dive=12, patterns=400))
SURE = {"uniform", "thirds", "triplets", "shifted", "2-D", "2-D zero waste", "conflicts"}
"""Families of which so little effort proves the first level of the instance tried here."""


@pytest.mark.parametrize("family", sorted(FAMILIES))
def test_an_instance_of_every_family_is_packed_and_what_is_claimed_holds(family: str) -> None:
    one = instance(family, 2)
    problem = one.problem

    found = solve(problem, QUICK)

    assert isinstance(found, Packed)
    assert does_pack(problem, found.hosts)
    assert value_of(problem, found.hosts) == (found.cost.value, found.moves.value)
    assert one.least is None or found.cost.value >= one.least
    assert found.cost.bound <= found.cost.value
    assert found.moves.bound <= found.moves.value
    assert family not in SURE or found.cost.bound == found.cost.value
    claim = claim_of(problem, found)
    if claim is not None:
        check(problem_data(problem), claim)


def test_what_is_claimed_holds_where_patterns_of_some_hosts_are_too_many_to_list() -> None:
    problem = instance("uniform", 9).problem

    found = solve(problem)

    assert isinstance(found, Packed)
    assert (found.moves.value, found.moves.bound) == (6, 6)
    claim = claim_of(problem, found)
    assert claim is not None
    check(problem_data(problem), claim)


def test_the_same_problem_has_the_same_answer_whatever_hashes_are() -> None:
    script = (
        "from benchmarks.packings import instance; from rarms_iac.planner.packing.solve import solve;"
        f"print({{str((solve(instance('conflicts', 1).problem), solve(instance('uniform', 1).problem)))"
        f" for _ in range({34 if LONG else 1})}})"
    )
    root = Path(__file__).parents[4]
    said = {
        subprocess.run(
            [sys.executable, "-c", script],
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": str(root), "SYSTEMROOT": "C:\\windows"},
            cwd=root,
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("0", "1", "2")
    }

    assert len(said) == 1  # a set of one answer, whatever the run and the seed
    assert next(iter(said)).count("Packed(") == 2


def test_a_cover_of_patterns_finds_the_best_whatever_the_weights() -> None:
    """With no weights at all every pattern may be of use, and trying all of them is exact."""
    for seed in SMALL[::3]:
        problem = a_packing(seed)
        every = every_packing(problem)
        program = cheapest(problem)

        found = covered(program, Weights(items=(0,) * problem.items, scale=1), 0, 60, 2_000_000)

        assert found.lowest == (every[0][0][0] if every else 60), seed
        assert (found.bundles is None) == (not every), seed
