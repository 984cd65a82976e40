"""Who is told to conflict does, nobody among them without need, and no fewer do: compared with trying everything."""

from fractions import Fraction
from itertools import combinations
from random import Random

import pytest

from rarms_iac.model.capacity import Capacity
from rarms_iac.model.plan import Claim
from rarms_iac.model.quantities import Bytes, LogicalProcessors
from rarms_iac.planner.does_not_fit.smallest import smallest
from rarms_iac.planner.placing.first_fit import Bin, Item
from rarms_iac.planner.placing.place import place
from tests.effort import examples
from tests.unit.planner.does_not_fit.test_certified import a_fleet, can_be_placed


def a_bin(name: str, memory: int = 100) -> Bin:
    capacity = Capacity(logical_processors=2, processors=LogicalProcessors(Fraction(2)), memory=Bytes(memory))
    return Bin(name=name, capacity=capacity)


def an_item(name: str, share: int, *hosts: str, memory: int = 1) -> Item:
    return Item(name=name, claims=dict.fromkeys(hosts, Claim(processors=2, reserve=share, memory=memory)))


def names_of(items: list[Item], bins: list[Bin]) -> list[str]:
    found = smallest(items, bins)
    assert found.proven
    return [one.name for one in found.items]


def test_no_fewer_conflict_than_those_who_are_told() -> None:
    """Up to six partitions on up to three hosts, by virtual processors, sums and memory."""
    looked_at = 0
    for seed in range(examples(120)):
        items, bins = a_fleet(seed)
        if can_be_placed(items, bins):
            continue
        looked_at += 1

        told = smallest(items, bins)

        assert told.proven, seed
        assert not can_be_placed(list(told.items), bins), seed
        fewer = combinations(items, len(told.items) - 1)
        assert all(can_be_placed(list(some), bins) for some in fewer), seed
    assert looked_at > 30


def test_who_may_run_elsewhere_is_left_out() -> None:
    bins = [a_bin("one"), a_bin("two")]
    items = [
        an_item("a1", 70, "one"),
        an_item("a2", 50, "one"),
        an_item("b1", 90, "two"),
        an_item("c1", 10, "one", "two"),
    ]

    assert names_of(items, bins) == ["a1", "a2"]


@pytest.mark.parametrize("many", [13, 28, 60])
def test_among_many_the_few_who_conflict_are_found(many: int) -> None:
    bins = [a_bin("one", memory=1000), a_bin("two", memory=1000)]
    others = [an_item(f"s{at:02}", 1, "one", "two") for at in range(many)]

    assert names_of([*others, an_item("a1", 70, "one"), an_item("a2", 50, "one")], bins) == ["a1", "a2"]


@pytest.mark.parametrize("seed", range(examples(6)))
def test_of_thirty_nobody_is_named_without_need(seed: int) -> None:
    """Sizes near a third on ten hosts, one more than there is room for; and some small ones."""
    random = Random(seed)
    bins = [a_bin(f"host{at}") for at in range(9)]
    hosts = [one.name for one in bins]
    items = [an_item(f"p{at:02}", random.randint(34, 40), *hosts) for at in range(19)]
    items += [an_item(f"s{at:02}", random.randint(1, 5), *hosts) for at in range(11)]

    told = smallest(items, bins)

    assert len(told.items) == 19
    for one in told.items:
        assert place([other for other in told.items if other is not one], bins).hosts is not None
