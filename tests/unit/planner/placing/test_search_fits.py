"""What is placed by the quick way passes the check of whoever orders the steps."""

from dataclasses import replace
from fractions import Fraction

import pytest

from rarms_iac.model.capacity import Capacity, fits, packed
from rarms_iac.model.plan import Claim
from rarms_iac.model.quantities import Bytes, LogicalProcessors
from rarms_iac.planner.placing.first_fit import Bin, Item
from rarms_iac.planner.placing.place import place

CELL = Capacity(logical_processors=8, processors=LogicalProcessors(Fraction(8)), memory=Bytes(32 << 30))
CELLS = [Bin(name=f"cell-{number:02}", capacity=CELL, taken=()) for number in range(50)]


def an_item(number: int) -> Item:
    claim = Claim(processors=2, reserve=4 * (1 + number % 5), memory=(256 + number % 4 * 64) << 20)
    return Item(name=f"component-{number:04}", claims={one.name: claim for one in CELLS}, now="")


def test_a_large_fleet_is_placed_so_that_every_host_fits() -> None:
    items = [an_item(number) for number in range(1000)]

    hosts = place(items, CELLS).hosts

    assert hosts is not None
    assert set(hosts) == {item.name for item in items}
    for cell in CELLS:
        assert fits(CELL, [item.claims[cell.name] for item in items if hosts[item.name] == cell.name])


TRIPLES = (46, 34, 32, 40, 30, 40, 39, 32, 32, 37, 40, 30, 28, 36, 38, 28, 32, 38, 31, 28, 32, 31, 36, 31, 29, 29, 27)
"""With 26, 41 and 27 more they fill ten processors exactly, and the search for that gives up."""


@pytest.mark.parametrize("hosts", [1, 2])
def test_where_the_search_gives_up_nothing_is_proven(hosts: int) -> None:
    ten = Capacity(logical_processors=10, processors=LogicalProcessors(Fraction(10)), memory=Bytes(0))
    bins = [Bin(name="one", capacity=ten), Bin(name="two", capacity=replace(ten, logical_processors=0))][:hosts]
    claims = [Claim(processors=1, reserve=size, memory=0) for size in (*TRIPLES, 26, 41, 27)]
    assert packed(claims, 10) is None
    items = [
        Item(name=f"part-{at:02}", claims={one.name: claim for one in bins}, now="") for at, claim in enumerate(claims)
    ]

    found = place(items, bins)

    assert (found.hosts, found.proven) == (None, False)


def test_searching_for_places_ends_however_many_questions_there_are() -> None:
    """Two of three triples a processor on two hosts, two virtual processors each: the whole has a limit of its own."""
    eight = Capacity(logical_processors=8, processors=LogicalProcessors(Fraction(8)), memory=Bytes(0))
    bins = [Bin(name=name, capacity=eight) for name in ("one", "two")]
    sizes = (39, 25, 39, 39, 31, 33, 28, 29, 33, 25, 34, 30, 37, 35, 27, 34, 37, 31, 32, 25, 35, 37, 25, 36)
    items = [
        Item(name=f"part-{at:02}", claims={one.name: Claim(processors=2, reserve=size, memory=0) for one in bins})
        for at, size in enumerate(sizes)
    ]

    found = place(items, bins)

    assert found.hosts is not None or not found.proven
