"""More than thirty partitions: what is placed fits, bounds are bounds, and nearly full parks are packed too."""

from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise, product
from random import Random

from rarms_iac.model.capacity import Capacity
from rarms_iac.model.plan import Claim
from rarms_iac.model.quantities import Bytes, LogicalProcessors
from rarms_iac.planner.placing.first_fit import Bin, Item, all_fit, cost, first_fit
from rarms_iac.planner.placing.many import improve
from rarms_iac.planner.placing.park import Park
from rarms_iac.planner.placing.place import place
from rarms_iac.planner.placing.staying import staying
from tests.effort import examples

MIB = 1 << 20


def a_bin(number: int, lanes: int = 8) -> Bin:
    capacity = Capacity(
        logical_processors=lanes,
        processors=LogicalProcessors(Fraction(lanes)),
        memory=Bytes(1_000 * MIB),
    )
    return Bin(name=f"host-{number:02}", capacity=capacity)


def an_item(name: str, claim: Claim, hosts: Sequence[Bin], now: str = "") -> Item:
    return Item(name=name, claims={one.name: claim for one in hosts}, now=now)


def cut(random: Random, whole: int, parts: int) -> list[int]:
    cuts = [0, *sorted(random.sample(range(1, whole), parts - 1)), whole]
    return [high - low for low, high in pairwise(cuts)]


def full(hosts: int, each: int, percent: int, seed: int) -> tuple[list[Item], list[Bin]]:
    """Hosts that so many per cent of were cut into partitions, which then lost their place."""
    random = Random(seed)
    bins = [a_bin(at) for at in range(hosts)]
    items = []
    for _ in bins:
        for reserve, memory in zip(cut(random, percent, each), cut(random, 10 * percent, each), strict=True):
            claim = Claim(processors=8, reserve=reserve, memory=memory * MIB)
            items.append(an_item(f"part-{random.random():.9f}", claim, bins))
    return items, bins


def test_a_nearly_full_park_is_packed_where_first_fit_finds_no_way() -> None:
    items, bins = full(hosts=10, each=4, percent=99, seed=1)
    assert first_fit(sorted(items, key=lambda one: one.name), bins) is None

    found = place(items, bins)

    assert found.hosts is not None
    assert all_fit(items, bins, found.hosts)
    assert found.proven
    assert place(items[::-1], bins[::-1]) == found


def test_as_many_stay_as_can() -> None:
    random = Random(9)
    items, bins = full(hosts=12, each=8, percent=80, seed=2)
    items = [an_item(one.name, next(iter(one.claims.values())), bins, random.choice(bins).name) for one in items]

    found = place(items, bins)

    assert found.hosts is not None
    assert all_fit(items, bins, found.hosts)
    assert found.bound[1] <= found.value[1] <= found.bound[1] + 2
    assert found.value[1] == sum(found.hosts[one.name] != one.now for one in items)
    assert found.bound[1] > 0


def test_few_that_are_free_are_placed_exactly_beside_many_that_stay() -> None:
    items, bins = full(hosts=10, each=4, percent=70, seed=3)
    stay = [Item(name=one.name, claims={bins[at // 4].name: one.claims["host-00"]}) for at, one in enumerate(items)]
    new = [an_item(f"new-{at}", Claim(processors=8, reserve=28, memory=64 * MIB), bins) for at in range(5)]

    found = place([*stay, *new], bins)

    assert found.hosts is not None
    assert all_fit([*stay, *new], bins, found.hosts)
    assert found.proven
    assert found.value == found.bound
    assert list(found.hosts) == sorted(found.hosts)


def test_what_cannot_be_beside_what_stays_is_told() -> None:
    items, bins = full(hosts=10, each=4, percent=90, seed=3)
    stay = [Item(name=one.name, claims={bins[at // 4].name: one.claims["host-00"]}) for at, one in enumerate(items)]
    new = an_item("new", Claim(processors=8, reserve=11, memory=64 * MIB), bins)

    found = place([*stay, new], bins)

    assert (found.hosts, found.proven) == (None, True)


def small(seed: int) -> tuple[list[Item], list[Bin]]:
    random = Random(seed)
    bins = [a_bin(at, lanes=2) for at in range(2)]
    items = []
    for at in range(random.randint(2, 6)):
        claims = {
            one.name: Claim(processors=2, reserve=random.randint(5, 60), memory=random.randint(50, 500) * MIB)
            for one in random.sample(bins, random.randint(1, 2))
        }
        items.append(Item(name=f"part-{at}", claims=claims, now=random.choice(("", "host-00", "host-01"))))
    return items, bins


def test_no_placement_moves_fewer_than_the_bound() -> None:
    tried = 0
    for seed in range(examples(100)):
        items, bins = small(seed)
        bound = staying(items, bins)
        for hosts in product([one.name for one in bins], repeat=len(items)):
            where = {item.name: host for item, host in zip(items, hosts, strict=True)}
            if any(where[one.name] not in one.claims for one in items) or not all_fit(items, bins, where):
                continue
            tried += 1
            moves = sum(one.now not in ("", where[one.name]) for one in items)
            cheapest = all(cost(one.claims[where[one.name]]) == min(map(cost, one.claims.values())) for one in items)
            assert moves >= bound.moves_at_all, seed
            assert not cheapest or moves >= bound.moves, seed
    assert tried > 100


def test_exchanges_lower_the_reservation() -> None:
    """Each of two is where the other would cost less, and there is room for one at a time."""
    bins = [a_bin(at, lanes=1) for at in range(2)]
    here, there = "host-00", "host-01"
    light, heavy = (Claim(processors=1, reserve=reserve, memory=600 * MIB) for reserve in (40, 70))
    one = Item(name="one", claims={here: heavy, there: light})
    other = Item(name="other", claims={here: light, there: heavy})
    park = Park([one, other], bins)
    park.put(one, here)
    park.put(other, there)

    improve(park)

    assert park.where == {"one": there, "other": here}
    assert park.value() == (0, 80, 0)
