"""Sizes into equal bins: exact up to 30 items, with a gap beyond."""

from itertools import pairwise
from pathlib import Path
from random import Random

import pytest

from rarms_iac.planner import pack_sizes
from rarms_iac.planner.packing.plain.equal import PackedSizes
from tests.effort import examples
from tests.packings import every_packing


def fits(packed: PackedSizes, sizes: list[int], capacity: int) -> bool:
    return all(
        sum(size for size, at in zip(sizes, packed.bins, strict=True) if at == one) <= capacity
        for one in range(packed.used)
    )


def test_small_lists_take_as_few_bins_as_there_can_be() -> None:
    from rarms_iac.planner.packing.program import Problem

    for seed in range(examples(20)):
        random = Random(seed)
        sizes = [random.randint(1, 10) for _ in range(random.randint(1, 6))]
        ways = Problem(
            sizes=(tuple((size,) for size in sizes),) * 6,
            rooms=((10,),) * 6,
            opening=(1,) * 6,
            costs=((0,) * len(sizes),) * 6,
        )

        packed = pack_sizes(sizes, 10)

        assert fits(packed, sizes, 10)
        assert packed.used == packed.bound == every_packing(ways)[0][0][0]


@pytest.mark.parametrize("bins", [20, 60])
def test_many_sizes_come_with_a_bound_that_holds(bins: int) -> None:
    random = Random(bins)
    sizes = []
    for _ in range(bins):
        first = random.randint(10, 80)
        sizes += [first, 100 - first]

    packed = pack_sizes(sizes, 100)

    assert fits(packed, sizes, 100)
    assert packed.bound <= bins <= packed.used
    assert packed.gap <= 1


def test_vectors_count_in_every_dimension() -> None:
    packed = pack_sizes([(6, 1), (6, 1), (1, 6), (1, 6)], (10, 10))

    assert (packed.used, packed.gap) == (2, 0)
    assert packed.bins[0] != packed.bins[1]


def test_nothing_takes_no_bins_and_what_does_not_fit_is_told() -> None:
    assert pack_sizes([], 10).used == 0
    with pytest.raises(ValueError, match="item 1 of size"):
        pack_sizes([3, 11], 10)


def test_the_example_of_the_page_runs() -> None:
    page = (Path(__file__).parents[5] / "docs" / "packing.md").read_text(encoding="utf-8")
    example = page.split("```python\n")[1].split("```")[0]
    told: dict[str, object] = {}

    exec(example, told)

    assert isinstance(told["packed"], PackedSizes)
    assert isinstance(told["vectors"], PackedSizes)


def test_bins_that_must_be_full_are_filled() -> None:
    """Hundred bins of a thousand, cut into four parts each."""
    random = Random(4)
    sizes = []
    for _ in range(100):
        cuts = [0, *sorted(random.sample(range(1, 1000), 3)), 1000]
        sizes += [high - low for low, high in pairwise(cuts)]

    packed = pack_sizes(sizes, 1000)

    assert fits(packed, sizes, 1000)
    assert packed.bound == 100
    assert packed.gap <= 1
