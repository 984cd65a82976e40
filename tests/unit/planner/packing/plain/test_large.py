"""Many sizes into equal bins: what is claimed holds, and knapsacks, programs and completions are what they say."""

from collections.abc import Sequence
from itertools import product
from random import Random

import pytest

from rarms_iac.planner import PackedSizes, pack_sizes
from rarms_iac.planner.packing.linear.factored import Factored
from rarms_iac.planner.packing.linear.master import restricted
from rarms_iac.planner.packing.linear.simplex import Master
from rarms_iac.planner.packing.plain.completion import completed
from rarms_iac.planner.packing.plain.cutting import Looks, Relaxation, relaxed
from rarms_iac.planner.packing.plain.demand import Demand, demand_of, left_of
from rarms_iac.planner.packing.plain.diving import Limits, dive
from rarms_iac.planner.packing.plain.multiples import best_fill
from rarms_iac.planner.packing.program import Sizes
from tests.effort import examples


def a_demand(random: Random, dimensions: int = 1, room: int = 20) -> Demand:
    items = [tuple(random.randint(1, 9) for _ in range(dimensions)) for _ in range(random.randint(1, 8))]
    return demand_of(items, (room,) * dimensions)


def every_fill(demand: Demand, profits: list[int]) -> int:
    """The most that a bin carries, by trying."""
    ways = product(*(range(count + 1) for count in demand.counts))
    fitting = (way for way in ways if demand.fits(tuple(enumerate(way))))
    return max(sum(count * profit for count, profit in zip(way, profits, strict=True)) for way in fitting)


@pytest.mark.parametrize("nodes", [4_000, 1])
def test_the_best_fill_is_the_best_of_all_or_bounded(nodes: int) -> None:
    for seed in range(examples(100)):
        random = Random(seed)
        demand = a_demand(random, random.randint(1, 3))
        profits = [random.randint(-2, 9) for _ in demand.sizes]

        found = best_fill(demand, profits, 0, nodes=nodes)

        best = max(0, every_fill(demand, profits))
        assert demand.fits(found.pattern)
        assert found.profit == sum(profits[at] * count for at, count in found.pattern)
        assert found.profit <= best
        assert found.most is None or found.most >= best, seed
        if nodes > 1:
            assert found.profit == best, seed


def test_where_rooms_are_large_the_most_is_still_a_bound() -> None:
    for seed in range(examples(20)):
        random = Random(seed)
        demand = demand_of([(random.randint(20_000, 35_000),) for _ in range(90)], (100_003,))
        profits = [size[0] + random.randint(0, 2_000) for size in demand.sizes]
        least = best_fill(demand, profits, 0, nodes=2_000)

        found = best_fill(demand, profits, 110_000, nodes=3)

        assert found.most is not None
        assert found.most >= least.profit


def test_both_linear_programs_have_the_same_value() -> None:
    for seed in range(examples(20)):
        random = Random(seed)
        rows = random.randint(2, 12)
        right = [float(random.randint(1, 5)) for _ in range(rows)]
        programs = (
            Master(right=list(right), penalties=[9.0] * rows),
            Factored(right=list(right), penalties=[9.0] * rows),
        )
        for _ in range(80):
            entries = tuple((row, float(random.randint(1, 3))) for row in sorted(random.sample(range(rows), 2)))
            cost = float(random.randint(1, 9))
            for one in programs:
                one.add(cost, entries)

        dense, factored = (one.solve() for one in programs)

        assert dense == pytest.approx(factored, abs=1e-4), seed
        covered = [0.0] * rows
        for column, part in programs[1].solution().items():
            for row, coefficient in programs[1].entries[column]:
                covered[row] += part * coefficient
        assert all(there <= wanted + 1e-6 for there, wanted in zip(covered, right, strict=True))


def test_a_completion_is_found_where_bins_must_be_full() -> None:
    demand = demand_of([(size,) for size in (490, 255, 255, 450, 300, 250, 400, 340, 260)], (1000,))

    found = completed(demand, 3, 1_000)

    assert found is not None
    assert all(demand.fits(pattern) for pattern in found)
    assert not any(left_of(demand.counts, found))
    assert completed(demand, 2, 1_000) is None


def test_a_relaxation_is_below_every_packing() -> None:
    for seed in range(examples(40)):
        random = Random(seed)
        items = [(random.randint(20, 70),) for _ in range(12)]

        found = relaxed(demand_of(items, (100,)), [], 1, Looks())

        assert found.bound <= pack_sizes([size for (size,) in items], 100).used


def fits(packed: PackedSizes, items: Sequence[Sizes], room: Sizes) -> bool:
    used: dict[int, list[int]] = {}
    for size, bin_ in zip(items, packed.bins, strict=True):
        used[bin_] = [there + takes for there, takes in zip(used.get(bin_, [0] * len(room)), size, strict=True)]
    return len(used) == packed.used and all(max(map(int.__sub__, one, room)) <= 0 for one in used.values())


def test_hundreds_of_uniform_sizes_take_as_few_bins_as_there_can_be() -> None:
    random = Random("u250")
    sizes = [random.randint(20, 100) for _ in range(250)]

    packed = pack_sizes(sizes, 150)

    assert fits(packed, [(size,) for size in sizes], (150,))
    assert packed.gap == 0
    assert packed == pack_sizes(sizes, 150)


def test_triplets_are_found_that_fill_every_bin() -> None:
    random = Random(120)
    sizes = []
    for _ in range(30):
        large = random.randint(380, 490)
        small = random.randint(250, (1000 - large) // 2)
        sizes += [large, small, 1000 - large - small]

    packed = pack_sizes(sizes, 1000)

    assert fits(packed, [(size,) for size in sizes], (1000,))
    assert (packed.used, packed.bound) == (30, 30)


def test_many_vectors_come_with_a_bound_that_holds() -> None:
    random = Random(3)
    items = [(random.randint(200, 800), random.randint(200, 800)) for _ in range(60)]

    packed = pack_sizes(items, (1000, 1000))

    assert fits(packed, items, (1000, 1000))
    assert packed.gap == 0


@pytest.mark.needs("highspy")
def test_another_solver_gives_the_same_values_and_only_bounds_that_hold() -> None:
    for seed in range(examples(5)):
        random = Random(seed)
        items = [(random.randint(20, 100),) for _ in range(90)]
        demand = demand_of(items, (150,))

        theirs, ours = relaxed(demand, [], 1, Looks()), relaxed(demand, [], 1, Looks(own=True))

        used = pack_sizes([size for (size,) in items], 150, own=True).used
        assert max(theirs.bound, ours.bound) <= used
        assert theirs.value == pytest.approx(ours.value, abs=0.02)
        assert theirs == relaxed(demand, [], 1, Looks())
    program = restricted([2.0, 3.0], [9.0, 9.0], own=False)
    assert type(program).__module__.endswith("highs")
    column = program.add(1.0, ((0, 1.0), (1, 1.0)))
    assert program.solve() == pytest.approx(11.0)
    assert program.duals() == pytest.approx([-8.0, 9.0])
    assert program.solution() == {column: pytest.approx(2.0)}


def test_our_own_is_asked_whatever_is_installed_where_that_is_wanted() -> None:
    assert isinstance(restricted([2.0], [9.0], own=True), Factored)
    random = Random(8)
    sizes = [random.randint(200, 350) for _ in range(60)]

    packed = pack_sizes(sizes, 1000, own=True)

    assert fits(packed, [(size,) for size in sizes], (1000,))
    assert packed.gap == 0


def test_sizes_of_nothing_and_large_units_are_sizes_too() -> None:
    items = [0] * 10 + [30_000_000] * 40

    packed = pack_sizes(items, 100_000_000)

    assert fits(packed, [(size,) for size in items], (100_000_000,))
    assert (packed.used, packed.gap) == (14, 0)


def test_a_dive_may_take_everything_at_once() -> None:
    demand = demand_of([(60,), (40,), (40,)], (100,))
    whole = (((0, 1), (1, 1)), 1.0), (((1, 1),), 1.0)
    start = Relaxation(bound=1, value=2.0, weights=(1, 1), parts=whole, pool=(), work=0)

    found = dive(demand, start, 1, Limits(work=100_000, random=None, own=True))

    assert len(found.patterns) == 2
    assert not any(left_of(demand.counts, found.patterns))
