"""A packing is the best of all, says how sure that is, and is found without the solver where sums are enough."""

import subprocess
import sys
from dataclasses import replace
from fractions import Fraction
from itertools import product
from random import Random

import pytest

from rarms_iac.model.capacity import Capacity, decide_packing, fits
from rarms_iac.model.claims import Claim, CoreSharing
from rarms_iac.model.quantities import Bytes, LogicalProcessors
from rarms_iac.planner.packing import pack as packing_module
from rarms_iac.planner.packing.assignment import Assignment, find_by_repacking
from rarms_iac.planner.packing.highs import Nodes, minimise
from rarms_iac.planner.packing.pack import pack
from rarms_iac.planner.packing.values import Bin, Item, NoPacking, Packing, hosts_can_hold, objective_of

Value = tuple[int, int, tuple[str, ...]]


def a_bin(name: str, processors: int, memory: int = 1000, taken: tuple[Claim, ...] = ()) -> Bin:
    capacity = Capacity(
        logical_processors=processors, processors=LogicalProcessors(Fraction(processors)), memory=Bytes(memory)
    )
    return Bin(name=name, capacity=capacity, foreign_claims=taken)


def a_claim(random: Random) -> Claim:
    return Claim(processors=random.randint(1, 2), reserve=random.randint(0, 70), memory=random.randint(0, 400))


def a_problem(seed: int) -> tuple[list[Item], list[Bin]]:
    """Up to six partitions on up to three hosts: equal or not, narrow or not, some pinned, some running."""
    random = Random(seed)
    names = [f"host{at}" for at in range(random.randint(1, 3))]
    taken = tuple(a_claim(random) for _ in range(random.randint(0, 1)))
    bins = [a_bin(name, random.choice((1, 2, 2, 4)), taken=taken) for name in names]
    if random.random() < 0.5:
        bins = [replace(bins[0], name=name) for name in names]
    items = []
    for at in range(random.randint(1, 6)):
        same = a_claim(random)
        allowed = sorted(random.sample(names, random.randint(1, len(names))))
        claims = {name: same if random.random() < 0.7 else a_claim(random) for name in allowed}
        items.append(Item(name=f"part{at}", claims=claims, current_host=random.choice(("", "host0", "host1"))))
    return items, bins


def every_packing(items: list[Item], bins: list[Bin]) -> list[Value]:
    """All that there are, by their definition: reservation, moves and hosts."""
    found = []
    for hosts in product(*(item.claims for item in items)):
        claims = {host.name: list(host.foreign_claims) for host in bins}
        for item, name in zip(items, hosts, strict=True):
            claims[name].append(item.claims[name])
        if all(fits(host.capacity, claims[host.name]) for host in bins if host.name in hosts):
            host_of = {item.name: name for item, name in zip(items, hosts, strict=True)}
            found.append((*objective_of(items, host_of), hosts))
    return found


@pytest.mark.needs("highspy")
def test_small_packings_are_optimal_and_first() -> None:
    solved = 0
    for seed in range(400):
        items, bins = a_problem(seed)
        every = every_packing(items, bins)

        packing = pack(items, bins)

        solved += bool(every)
        if isinstance(packing, NoPacking):
            assert packing.proven
            assert not every, seed
        else:
            assert packing.placement.proven
            objective = packing.placement.reserved, packing.placement.moves
            assert (*objective, tuple(packing.host_of.values())) == min(every), seed
    assert 100 < solved < 390, "some have a packing, and some have none"


def a_tight_fleet(seed: int, hosts: int = 6) -> tuple[list[Item], list[Bin]]:
    """Hosts that are cut into four partitions each, in processors and memory, with three points to spare."""
    random = Random(seed)
    items = []
    for at in range(hosts):
        cuts = [[0, *sorted(random.sample(range(1, 97), 3)), 97] for _ in range(2)]
        for piece in range(4):
            reserve, memory = (cut[piece + 1] - cut[piece] for cut in cuts)
            claim = Claim(processors=4, reserve=reserve, memory=10 * memory)
            items.append(Item(name=f"part{at}{piece}", claims={f"host{number}": claim for number in range(hosts)}))
    random.shuffle(items)
    return items, [a_bin(f"host{at}", 4) for at in range(hosts)]


@pytest.mark.needs("highspy")
@pytest.mark.parametrize("seed", range(3))
def test_tight_packings_are_found(seed: int) -> None:
    items, bins = a_tight_fleet(seed)

    packing = pack(items, bins)

    assert isinstance(packing, Packing)
    assert packing.placement.proven
    assert hosts_can_hold(items, bins, packing.host_of)
    assert packing == pack(items[::-1], bins[::-1]), "order does not matter"


@pytest.mark.needs("highspy")
def test_a_budget_may_count_iterations_too() -> None:
    items, bins = a_tight_fleet(0, hosts=12)
    program, budget = Assignment(sorted(items, key=lambda item: item.name), bins), Nodes(1_000, iterations_each=100)

    minimise([0] * len(program.pairs), program.rows, nodes=1, budget=budget)

    assert budget.remaining < 980, "one node, and thousands of iterations"


@pytest.mark.needs("highspy")
def test_few_hosts_are_repacked_at_a_time() -> None:
    items, bins = a_tight_fleet(1, hosts=4)
    items.sort(key=lambda item: item.name)

    hosts = find_by_repacking(items, bins, Nodes(1_000))

    assert hosts is not None
    assert hosts.keys() == {item.name for item in items}
    assert hosts_can_hold(items, bins, hosts)


def test_first_fit_without_solver_proves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packing_module, "is_installed", lambda: False)
    cheap, dear = (Claim(processors=1, reserve=reserve, memory=1) for reserve in (60, 70))
    items = [Item(name=name, claims={"host0": cheap, "host1": dear}) for name in ("a", "b")]

    packing = pack(items, [a_bin("host0", 1), a_bin("host1", 1)])

    assert isinstance(packing, Packing)
    assert (packing.placement.reserved, packing.placement.reserved_bound, packing.placement.proven) == (130, 120, False)
    assert pack(*a_tight_fleet(0)) == NoPacking(proven=False)


def test_solver_is_not_imported_at_the_bound() -> None:
    script = (
        "import sys; from tests.unit.planner.packing.test_pack import a_bin, Item, Claim, pack;"
        "claim = Claim(processors=1, reserve=40, memory=1);"
        "pack([Item(name=name, claims={'one': claim, 'two': claim}, current_host='two') for name in 'abc'],"
        " [a_bin('one', 1), a_bin('two', 2)]);"
        "print('highspy' in sys.modules)"
    )

    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)

    assert done.stdout.strip() == "False"


@pytest.mark.needs("highspy")
def test_unproven_says_its_distance() -> None:
    random = Random(3)
    bins = [a_bin(f"host{at}", 2 + at % 3) for at in range(5)]
    items = [
        Item(
            name=f"part{at:02}",
            claims={
                host.name: Claim(processors=2, reserve=random.randint(10, 60), memory=random.randint(50, 300))
                for host in bins
            },
        )
        for at in range(14)
    ]

    packing = pack(items, bins, node_budget=1)

    assert isinstance(packing, Packing)
    assert packing.placement.reserved_bound <= packing.placement.reserved
    best = pack(items, bins)
    assert isinstance(best, Packing)
    assert best.placement.proven
    assert packing.placement.reserved_bound <= best.placement.reserved <= packing.placement.reserved


CELL = Capacity(logical_processors=8, processors=LogicalProcessors(Fraction(8)), memory=Bytes(32 << 30))


def test_very_many_partitions_are_packed() -> None:
    bins = [a_bin("left", 64), a_bin("right", 64)]
    claims = {host.name: Claim(processors=1, reserve=1, memory=0) for host in bins}

    packing = pack([Item(name=f"p{number:04}", claims=claims) for number in range(1_200)], bins)

    assert isinstance(packing, Packing)
    assert packing.placement.proven
    assert set(packing.host_of.values()) == {"left"}


def test_large_fleet_is_packed_within_hosts() -> None:
    cells = [Bin(name=f"cell-{number:02}", capacity=CELL) for number in range(50)]
    items = []
    for number in range(1000):
        claim = Claim(processors=2, reserve=4 * (1 + number % 5), memory=(256 + number % 4 * 64) << 20)
        items.append(Item(name=f"component-{number:04}", claims={cell.name: claim for cell in cells}))

    packing = pack(items, cells)

    assert isinstance(packing, Packing)
    assert set(packing.host_of) == {item.name for item in items}
    assert hosts_can_hold(items, cells, packing.host_of)


TRIPLES = (46, 34, 32, 40, 30, 40, 39, 32, 32, 37, 40, 30, 28, 36, 38, 28, 32, 38, 31, 28, 32, 31, 36, 31, 29, 29, 27)
"""With 26, 41 and 27 more they fill ten processors exactly, and the search for that gives up."""


@pytest.mark.parametrize("hosts", [1, pytest.param(2, marks=pytest.mark.needs("highspy"))])
def test_abandoned_search_proves_nothing(hosts: int) -> None:
    bins = [a_bin("one", 10), replace(a_bin("two", 10), capacity=replace(a_bin("two", 0).capacity))][:hosts]
    claims = [Claim(processors=1, reserve=size, memory=0) for size in (*TRIPLES, 26, 41, 27)]
    assert decide_packing(claims, a_bin("one", 10).capacity) is None
    items = [Item(name=f"part-{at:02}", claims={host.name: claim for host in bins}) for at, claim in enumerate(claims)]

    assert pack(items, bins) == NoPacking(proven=False, undecided=True)


def test_rows_forbid_nothing_possible() -> None:
    held = 0
    for seed in range(400):
        random = Random(seed)
        host = a_bin("host", random.choice((1, 2, 4)), memory=10_000)
        host = replace(
            host, capacity=replace(host.capacity, sharing=CoreSharing(threads=random.choice((1, 2)), used=1))
        )
        reserves = random.choices((15, 20, 30, 45, 50, 55, 70, 80, 85), k=random.randint(1, 6))
        claims = [Claim(processors=random.randint(1, 2), reserve=reserve, memory=1) for reserve in reserves]
        items = [Item(name=f"part{at}", claims={"host": claim}) for at, claim in enumerate(claims)]
        program = Assignment(items, [host])

        if hosts_can_hold(items, [host], {item.name: "host" for item in items}):
            held += 1
            assert all(row.low <= sum(row.coefficients.values()) <= row.high for row in program.rows), seed
    assert 50 < held < 250, held


@pytest.mark.needs("highspy")
def test_rows_prove_processors_exceeding_cores() -> None:
    items = [
        Item(name=f"part{at:02}", claims=dict.fromkeys(("one", "two"), Claim(processors=1, reserve=reserve, memory=1)))
        for at, reserve in enumerate((70, 70, 70, 70, 70, 45, 45, 45, 45, 45, 45, 45))
    ]
    program = Assignment(items, [a_bin("one", 4), a_bin("two", 4)])

    assert sum(claim.percent for item in items for claim in list(item.claims.values())[:1]) <= 800, "sums are enough"
    assert minimise([0] * len(program.pairs), program.rows, nodes=1000).bound is None


@pytest.mark.needs("highspy")
def test_unplaceable_processors_are_proven() -> None:
    claim = Claim(processors=1, reserve=40, memory=1)
    bins = [a_bin("one", 2), a_bin("two", 2)]
    items = [Item(name=f"part{at}", claims={"one": claim, "two": claim}) for at in range(9)]

    assert pack(items, bins) == NoPacking(proven=True)
    assert isinstance(pack(items[:8], bins), Packing)
