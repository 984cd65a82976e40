"""That nothing fits is certified only where trying every placement finds none, virtual processors one by one."""

import json
from fractions import Fraction
from itertools import product
from random import Random
from typing import Any

import pytest

from rarms_iac.model.capacity import Capacity
from rarms_iac.model.plan import Claim
from rarms_iac.model.quantities import Bytes, LogicalProcessors
from rarms_iac.planner.certifying.checker import Wrong, check
from rarms_iac.planner.certifying.claim import problem_data
from rarms_iac.planner.does_not_fit.smaller import alone, certified_impossible
from rarms_iac.planner.placing.first_fit import Bin, Item
from rarms_iac.planner.placing.in_numbers import in_whole_numbers
from rarms_iac.planner.placing.place import place
from tests.effort import LONG
from tests.packings import lies

TRIED = 3_000 if LONG else 250


def a_bin(name: str, logical: int, memory: int = 8, taken: tuple[Claim, ...] = (), kept: Fraction = Fraction(0)) -> Bin:
    processors = LogicalProcessors(logical - kept)
    capacity = Capacity(logical_processors=logical, processors=processors, memory=Bytes(memory))
    return Bin(name=name, capacity=capacity, taken=taken)


def a_claim(processors: int, reserve: int, memory: int = 1) -> Claim:
    return Claim(processors=processors, reserve=reserve, memory=memory)


def a_fleet(seed: int) -> tuple[list[Item], list[Bin]]:
    """Up to six partitions on up to three hosts of up to four logical processors, nearly as much as there is."""
    random = Random(seed)
    bins = []
    for at in range(random.randint(1, 3)):
        taken = (a_claim(1, random.randint(0, 60), 0),) if random.random() < 0.3 else ()
        kept = Fraction(random.choice((0, 0, 10, 25)), 100)
        bins.append(a_bin(f"host{at}", random.randint(1, 4), random.randint(3, 6), taken, kept))
    items = []
    for at in range(random.randint(1, 6)):
        claim = a_claim(random.randint(1, 3), random.randint(20, 75), random.randint(0, 3))
        names = [one.name for one in bins if random.random() < 0.8] or [bins[0].name]
        items.append(Item(name=f"p{at}", claims=dict.fromkeys(names, claim)))
    return items, bins


def can_be_placed(items: list[Item], bins: list[Bin]) -> bool:
    """By trying every placement, and every way to lay virtual processors onto logical ones."""
    for where in product(*(sorted(one.claims) for one in items)):
        if all(
            holds(one, [item.claims[one.name] for item, name in zip(items, where, strict=True) if name == one.name])
            for one in bins
            if one.name in where
        ):
            return True
    return False


def holds(one: Bin, claims: list[Claim]) -> bool:
    everything = [*one.taken, *claims]
    logical = one.capacity.logical_processors
    if any(claim.reserve and claim.processors > logical for claim in everything):
        return False
    if sum(claim.processors * claim.reserve for claim in everything) > 100 * one.capacity.processors:
        return False
    if sum(claim.memory for claim in everything) > one.capacity.memory:
        return False
    sizes = [claim.reserve for claim in everything for _ in range(claim.processors)]
    return lies(sorted(sizes, reverse=True), [100] * logical)


def test_what_is_certified_as_impossible_is_and_nothing_else() -> None:
    impossible = certified = by_processors = 0
    for seed in range(TRIED):
        items, bins = a_fleet(seed)
        placed = can_be_placed(items, bins)

        text = certified_impossible(items, bins)

        impossible += not placed
        if text:
            certificate = json.loads(text)
            check(certificate["problem"], certificate["claim"])
            assert not placed, seed
            certified += 1
            by_processors += not accepted(without_processors(certificate["problem"]), certificate["claim"])
        few = alone(items, bins)
        if few is not None:
            assert not can_be_placed(list(few), bins), seed

    assert certified == impossible > TRIED // 5
    assert by_processors > TRIED // 50


def accepted(problem: Any, claim: Any) -> bool:
    try:
        check(problem, claim)
    except Wrong:
        return False
    return True


def without_processors(problem: Any) -> Any:
    return {**problem, "kinds": [{**kind, "processors": None} for kind in problem["kinds"]]}


def test_no_certificate_shows_that_what_can_be_placed_cannot() -> None:
    """Proofs of other problems, of the same without an item, and made-up ones: all are rejected where it is false."""
    rejected = 0
    proofs: list[Any] = [None]
    for seed in range(TRIED):
        items, bins = a_fleet(seed)
        if (text := certified_impossible(items, bins)) and (proof := json.loads(text)["claim"]["impossible"]):
            proofs.append(proof)
        for some in (items, items[1:]):
            if not some or not can_be_placed(some, bins):
                continue
            data = problem_data(in_whole_numbers(some, bins))
            for claimed in (*proofs[-8:], *made_up(len(some), len(bins), Random(seed))):
                with pytest.raises(Wrong):
                    check(data, {"impossible": resized(claimed, len(some), len(bins))})
                rejected += 1

    assert rejected > 5 * TRIED


def made_up(items: int, hosts: int, random: Random) -> list[Any]:
    def a_proof() -> Any:
        return {
            "items": [random.randint(0, 3) for _ in range(items)],
            "excess": [random.randint(0, 6) for _ in range(hosts)],
            "rates": [random.randint(-1, 1), random.randint(1, 2)],
            "tried": random.random() < 0.5,
        }

    return [a_proof() for _ in range(4)]


def resized(proof: Any, items: int, hosts: int) -> Any:
    """The same weights, for as many items and hosts as there are."""
    if proof is None:
        return None
    weights, excess = [*proof["items"], *proof["items"]], [*proof["excess"]] * 3
    return {**proof, "items": (weights * items)[:items], "excess": excess[:hosts]}


def test_virtual_processors_that_are_more_than_half_are_certified_by_their_number() -> None:
    bins = [a_bin("onboard", 2)]
    items = [Item(name=name, claims={"onboard": a_claim(1, 60)}) for name in ("arm", "base", "camera")]

    certificate = json.loads(certified_impossible(items, bins))

    assert certificate["partitions"] == ["arm", "base", "camera"]
    assert certificate["claim"] == {"impossible": None}
    check(certificate["problem"], certificate["claim"])


@pytest.mark.parametrize(("logical", "hosts"), [(2, 1), (2, 2), (3, 2)])
def test_where_only_virtual_processors_find_no_room_it_is_certified(logical: int, hosts: int) -> None:
    """A logical processor takes 40 % twice and not three times, though the sums of all hosts would do."""
    bins = [a_bin(f"host{at}", logical, 64) for at in range(hosts)]
    names = [one.name for one in bins]
    items = [Item(name=f"p{at}", claims=dict.fromkeys(names, a_claim(1, 40))) for at in range(2 * hosts * logical + 1)]
    assert sum(40 for _ in items) <= 100 * hosts * logical

    certificate = json.loads(certified_impossible(items, bins))

    check(certificate["problem"], certificate["claim"])
    with pytest.raises(Wrong):
        check(without_processors(certificate["problem"]), certificate["claim"])


def test_more_than_thirty_that_exceed_half_a_host_each_are_certified() -> None:
    bins = [a_bin(f"host{at:02}", 2, 10) for at in range(40)]
    small = [
        Item(name=f"small{at:02}", claims=dict.fromkeys([one.name for one in bins], a_claim(1, 1, 1)), now="")
        for at in range(30)
    ]
    large = [
        Item(name=f"large{at:02}", claims=dict.fromkeys([one.name for one in bins], a_claim(1, 5, 6)))
        for at in range(41)
    ]

    few = alone([*large, *small], bins)

    assert few == tuple(large)
    certificate = json.loads(certified_impossible(few, bins))
    assert certificate["partitions"] == [one.name for one in large]
    check(certificate["problem"], certificate["claim"])


def test_of_many_partitions_those_that_share_a_host_of_their_own_are_found() -> None:
    """Forty that could be anywhere, and three that must be on one host and find no logical processors there."""
    bins = [a_bin(f"host{at:02}", 2, 1_000) for at in range(20)]
    anywhere = [
        Item(name=f"any{at:02}", claims=dict.fromkeys([one.name for one in bins], a_claim(2, 10))) for at in range(40)
    ]
    here = [Item(name=f"here{at}", claims={"host07": a_claim(1, 60)}) for at in range(3)]
    assert place([*anywhere, *here], bins).hosts is None

    few = alone([*anywhere, *here], bins)

    assert few == tuple(here)
    certificate = json.loads(certified_impossible(few, bins))
    assert (certificate["partitions"], certificate["hosts"]) == (["here0", "here1", "here2"], ["host07"])
    check(certificate["problem"], certificate["claim"])
