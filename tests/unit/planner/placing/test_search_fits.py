"""What is placed by the quick way passes the check of whoever orders the steps."""

from fractions import Fraction

from rarms_iac.model.capacity import Capacity, fits
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
