"""Bounds hold where items that take almost nothing are worth almost as much for it as large ones."""

from random import Random

from rarms_iac.planner.packing.patterns import best_pattern
from rarms_iac.planner.packing.plain.demand import Demand
from rarms_iac.planner.packing.plain.multiples import best_fill
from rarms_iac.planner.packing.plain.surrogate import Surrogate, carried
from rarms_iac.planner.packing.program import Kind, Program
from rarms_iac.planner.packing.worth import by_worth
from tests.effort import examples


def test_the_order_is_exact() -> None:
    profits, takes = [1_000_005, 1_001, 0, 7, 2_002], [1_000, 1, 0, 0, 2]

    assert by_worth(range(5), profits, takes) == [3, 1, 4, 0, 2]


def test_a_bin_of_many_small_ones_is_not_overlooked() -> None:
    demand = Demand(sizes=((100_000,), (1,), (99_999,)), counts=(1, 100_000, 1), room=(100_000,))

    assert best_fill(demand, [100_000_050, 1_001, 1], 100_000_060).profit == 100_100_000


def test_sizes_that_take_nothing_of_what_is_counted_are_carried_beside_a_bin_that_is_full() -> None:
    demand = Demand(sizes=((100, 1), (1, 0)), counts=(1, 1), room=(100_000, 1))
    full = Surrogate(takes=(1, 0), room=1)

    assert carried(full, demand, [5_000, 1], [0, 1]) == 5_001


def test_no_better_set_is_there_where_none_is_found() -> None:
    random = Random(1)
    for number in range(examples(300)):
        kind, profits = nearly_proportional(random)
        program = Program(items=len(profits), kinds=(kind,), conflicts=(0,) * len(profits))
        best = most_by_trying(kind, profits)

        found, complete = best_pattern(program, 0, profits, 50_000, best - 1)

        assert not complete or (found is not None and found.profit == best), number


def nearly_proportional(random: Random) -> tuple[Kind, list[int]]:
    """Sizes large and tiny, and profits that follow them to three in ten thousand."""
    room = tuple(random.choice([1_000, 3_200, 20_000, 65_536]) for _ in range(random.choice([1, 2])))
    sizes = [
        tuple(random.randint(0, max(1, there // 1_000)) if tiny else random.randint(1, there // 2) for there in room)
        for tiny in (random.random() < 0.5 for _ in range(random.randint(4, 8)))
    ]
    parts = [sum(1e6 * one / there for one, there in zip(size, room, strict=True)) / len(room) for size in sizes]
    profits = [max(1, round(part * (1 + random.uniform(-3e-4, 3e-4)))) for part in parts]
    return Kind(hosts=(0,), room=room, sizes=tuple(sizes), opening=0, costs=(0,) * len(sizes)), profits


def most_by_trying(kind: Kind, profits: list[int]) -> int:
    best = 0
    for mask in range(1 << len(profits)):
        chosen = [item for item in range(len(profits)) if mask >> item & 1]
        sizes = [size for item in chosen if (size := kind.sizes[item])]
        if all(sum(size[d] for size in sizes) <= there for d, there in enumerate(kind.room)):
            best = max(best, sum(profits[item] for item in chosen))
    return best
