"""Small packings that every packing can be tried of, and the best of all by trying."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from random import Random

from rarms_iac.planner.packing.program import Assignment, Problem, Processors, Sizes

Value = tuple[int, int]
"""Cost, moves."""


def a_packing(seed: int) -> Problem:
    """Up to six items on up to three hosts, in up to three dimensions, some apart, hosts of one or several kinds."""
    random = Random(seed)
    items, hosts, dimensions = random.randint(1, 6), random.randint(1, 3), random.randint(1, 3)
    rooms = [tuple(random.randint(6, 12) for _ in range(dimensions)) for _ in range(random.randint(1, hosts))]
    kind = [random.randrange(len(rooms)) for _ in range(hosts)]
    sizes: list[list[Sizes | None]] = [
        [tuple(random.randint(0, 7) for _ in range(dimensions)) for _ in range(items)] for _ in rooms
    ]
    if random.random() < 0.7:
        sizes = [sizes[0]] * len(rooms)
    if random.random() < 0.3:
        sizes = [[None if random.random() < 0.2 else size for size in row] for row in sizes]
    costs = [[random.randint(0, 3) for _ in range(items)] for _ in rooms]
    opening = [random.randint(0, 4) for _ in rooms]
    if random.random() < 0.5:
        costs = [[0] * items for _ in rooms]
    pairs = [(one, other) for other in range(items) for one in range(other)]
    apart = frozenset(pair for pair in pairs if random.random() < 0.15)
    now = tuple(random.choice((None, *range(hosts))) for _ in range(items)) if random.random() < 0.7 else ()
    return Problem(
        sizes=tuple(tuple(sizes[at]) for at in kind),
        rooms=tuple(rooms[at] for at in kind),
        opening=tuple(opening[at] for at in kind),
        costs=tuple(tuple(costs[at]) for at in kind),
        conflicts=apart,
        now=now,
    )


def on_several_kinds(seed: int) -> Problem:
    """Six items on four hosts of up to three kinds; for odd seeds the hosts are as dear as they are large."""
    random = Random(seed)
    dimensions = random.randint(1, 2)
    kinds = [(10, 5), (16, 8), (24, 12)] if seed % 2 else [(10, 3), (13, 3), (24, 7)]
    chosen = [kinds[random.randrange(len(kinds))] for _ in range(4)]
    sizes = tuple(tuple(random.randint(1, 9) for _ in range(dimensions)) for _ in range(6))
    return Problem(
        sizes=(sizes,) * 4,
        rooms=tuple((room,) * dimensions for room, _ in chosen),
        opening=tuple(price for _, price in chosen),
        costs=((0,) * 6,) * 4,
        now=tuple(random.choice((None, 0, 0, 1, 2, 3)) for _ in range(6)),
        conflicts=frozenset({(0, 1)} if random.random() < 0.2 else ()),
    )


def with_processors(seed: int) -> Problem:
    """Items of virtual processors too, each of which must find a logical one of the host that has so much left."""
    problem, random = a_packing(seed), Random(seed)
    virtual = tuple((random.randint(0, 2), random.randint(20, 70)) for _ in range(problem.items))
    others = ((1, random.randint(10, 50)),) if random.random() < 0.3 else ()
    there = [Processors(logical=number, virtual=virtual, others=others) for number in (1, 2, 3)]
    kinds = [random.randrange(len(there)) for _ in problem.rooms]

    def fits(host: int, some: Sequence[int]) -> bool:
        claims = [*others, *(virtual[item] for item in some)]
        return lies([size for count, size in claims for _ in range(count)], [100] * there[kinds[host]].logical)

    return replace(problem, processors=tuple(there[kind] for kind in kinds), alike=tuple(kinds), fits=fits)


def lies(sizes: Sequence[int], free: Sequence[int]) -> bool:
    """Whether each of the sizes finds a place whole, by trying every way."""
    return not sizes or any(
        left >= sizes[0] and lies(sizes[1:], [*free[:at], left - sizes[0], *free[at + 1 :]])
        for at, left in enumerate(free)
    )


def does_pack(problem: Problem, where: Assignment) -> bool:
    """Whether it fits, by its definition."""
    for host, room in enumerate(problem.rooms):
        there = [item for item, at in enumerate(where) if at == host]
        sizes = [size for item in there if (size := problem.sizes[host][item]) is not None]
        if len(sizes) < len(there) or any(sum(size[d] for size in sizes) > most for d, most in enumerate(room)):
            return False
        if problem.fits is not None and not problem.fits(host, there):
            return False
    return not any(where[one] == where[other] for one, other in problem.conflicts)


def value_of(problem: Problem, where: Assignment) -> Value:
    """What it costs and moves, by its definition."""
    cost = sum(problem.opening[host] for host in set(where))
    cost += sum(problem.costs[host][item] for item, host in enumerate(where))
    return cost, sum(
        was not in (None, host) for was, host in zip(problem.now, where, strict=True)
    ) if problem.now else 0


def every_packing(problem: Problem) -> list[tuple[Value, Assignment]]:
    """All packings there are, the best first."""
    ways = product(range(len(problem.rooms)), repeat=problem.items)
    return sorted((value_of(problem, where), where) for where in ways if does_pack(problem, where))
