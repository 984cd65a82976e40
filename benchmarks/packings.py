"""Packings to be solved, by named family, each from a seed; with a layout that runs now and is nearly as wanted.

What runs was packed by best fit, when every size was up to three units less: so the instances are the same whatever the
planner does.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from operator import truediv
from random import Random

from rarms_iac.planner.packing.program import Problem, Sizes

ITEMS = 30
HOSTS = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class Instance:
    """Items and hosts, with what runs now."""

    family: str
    seed: int
    problem: Problem
    least: int | None = None  # cost, where it is known by construction


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn:
    """What a family draws: sizes, and of hosts the rooms and costs."""

    sizes: Sequence[Sizes]
    rooms: Sequence[Sizes]
    opening: Sequence[int] = ()  # empty: 1 each
    conflicts: frozenset[tuple[int, int]] = frozenset()
    least: int | None = None


def _one(sizes: Sequence[int], room: int, **more: int | None) -> Drawn:
    return Drawn(sizes=[(size,) for size in sizes], rooms=[(room,)] * HOSTS, least=more.get("least"))


def uniform(random: Random) -> Drawn:
    high = random.choice((45, 60))
    return _one([random.randint(5, high) for _ in range(ITEMS)], 100)


def thirds(random: Random) -> Drawn:
    return _one([random.randint(230, 360) for _ in range(ITEMS)], 1000)


def _triplets(random: Random) -> list[int]:
    sizes = []
    for _ in range(ITEMS // 3):
        large = random.randint(380, 490)
        small = random.randint(250, (1000 - large) // 2)
        sizes += [large, small, 1000 - large - small]
    random.shuffle(sizes)
    return sizes


def triplets(random: Random) -> Drawn:
    """Three items fill a host exactly, and no other number can."""
    return _one(_triplets(random), 1000, least=ITEMS // 3)


def shifted(random: Random) -> Drawn:
    """Triplets with one unit more in all: one host more, and nothing but exact arithmetic sees it."""
    sizes = _triplets(random)
    sizes[random.randrange(ITEMS)] += 1
    return _one(sizes, 1000, least=ITEMS // 3 + 1)


def _cut(random: Random, room: int, parts: int) -> list[int]:
    cuts = [0, *sorted(random.sample(range(1, room), parts - 1)), room]
    return [high - low for low, high in pairwise(cuts)]


def zero_waste(random: Random, dimensions: int = 1, bins: int = 8) -> Drawn:
    """Hosts of 200 units cut into three or four items each: nothing is left over."""
    sizes: list[Sizes] = []
    for number in range(bins):
        parts = ITEMS // bins + (number < ITEMS % bins)
        sizes += zip(*(_cut(random, 200, parts) for _ in range(dimensions)), strict=True)
    random.shuffle(sizes)
    return Drawn(sizes=sizes, rooms=[(200,) * dimensions] * HOSTS, least=bins)


def vectors(random: Random) -> Drawn:
    """Per cent of two processors, and MiB."""
    sizes = [(random.randint(10, 90), random.randint(200, 1800)) for _ in range(ITEMS)]
    return Drawn(sizes=sizes, rooms=[(200, 4096)] * HOSTS)


def vectors_of_three(random: Random) -> Drawn:
    sizes = [(random.randint(10, 90), random.randint(200, 1800), random.randint(5, 45)) for _ in range(ITEMS)]
    return Drawn(sizes=sizes, rooms=[(200, 4096, 100)] * HOSTS)


def vectors_without_waste(random: Random) -> Drawn:
    return zero_waste(random, dimensions=2, bins=9)


def conflicts(random: Random) -> Drawn:
    """Every tenth pair must be apart."""
    sizes = [(random.randint(10, 80),) for _ in range(ITEMS)]
    pairs = [(one, other) for other in range(ITEMS) for one in range(other)]
    apart = random.sample(pairs, len(pairs) // 10)
    return Drawn(sizes=sizes, rooms=[(200,)] * HOSTS, conflicts=frozenset(apart))


def kinds(random: Random) -> Drawn:
    """Two or three kinds of host, each as dear as it is large: those in use are nearly full."""
    return _on_kinds(random, (((100, 5), (160, 8)), ((100, 5), (160, 8), (240, 12))))


def kinds_with_slack(random: Random) -> Drawn:
    """Two or three kinds of host of few prices, the larger ones cheaper for what they have: there is room to spare."""
    return _on_kinds(random, (((100, 3), (160, 4)), ((100, 3), (160, 4), (240, 5))))


def _on_kinds(random: Random, choices: Sequence[Sequence[tuple[int, int]]]) -> Drawn:
    some = random.choice(choices)
    sizes = [(random.randint(8, 75),) for _ in range(ITEMS)]
    hosts = [some[at % len(some)] for at in range(HOSTS)]
    return Drawn(sizes=sizes, rooms=[(room,) for room, _ in hosts], opening=[price for _, price in hosts])


def tight(random: Random) -> Drawn:
    """Vectors, six or seven items a bin, and less than two in a hundred to spare: the hard ones, told apart."""
    bins, room = 4, 1000
    sizes: list[Sizes] = []
    for number in range(bins):
        parts = 6 + number % 2
        sizes += zip(*(_cut(random, room - random.randint(2, 18), parts) for _ in range(2)), strict=True)
    random.shuffle(sizes)
    return Drawn(sizes=sizes, rooms=[(room, room)] * HOSTS, least=bins)


FAMILIES: Mapping[str, Callable[[Random], Drawn]] = {
    "uniform": uniform,
    "thirds": thirds,
    "triplets": triplets,
    "shifted": shifted,
    "zero waste": zero_waste,
    "2-D": vectors,
    "3-D": vectors_of_three,
    "2-D zero waste": vectors_without_waste,
    "conflicts": conflicts,
    "kinds": kinds,
    "kinds with slack": kinds_with_slack,
}
HARD: Mapping[str, Callable[[Random], Drawn]] = {"tight 2-D": tight}


def instance(family: str, seed: int) -> Instance:
    """One of a family; what ran before had up to three units less of each item."""
    random = Random(f"{family} {seed}")
    drawn = {**FAMILIES, **HARD}[family](random)
    smaller = [tuple(max(1, one - random.randint(0, 3)) for one in size) for size in drawn.sizes]
    hosts = len(drawn.rooms)
    problem = Problem(
        sizes=(tuple(drawn.sizes),) * hosts,
        rooms=tuple(drawn.rooms),
        opening=tuple(drawn.opening) or (1,) * hosts,
        costs=((0,) * len(drawn.sizes),) * hosts,
        conflicts=drawn.conflicts,
        now=best_fit(smaller, drawn.rooms, drawn.conflicts),
    )
    return Instance(family=family, seed=seed, problem=problem, least=drawn.least)


def best_fit(
    sizes: Sequence[Sizes], rooms: Sequence[Sizes], conflicts: frozenset[tuple[int, int]]
) -> tuple[int | None, ...]:
    """The largest first, each where least is left; the next host where none of those in use has room."""
    where: list[int | None] = [None] * len(sizes)
    free = [list(room) for room in rooms]
    used = 0
    for item in sorted(range(len(sizes)), key=lambda one: (-sum(map(truediv, sizes[one], rooms[0])), one)):
        there = [host for host in range(used) if _takes(item, host, sizes, free, where, conflicts)]
        best = min(there, key=lambda host: sum(map(truediv, free[host], rooms[host])), default=None)
        if best is None and used < len(rooms):
            best, used = used, used + 1
        if best is not None:
            where[item] = best
            free[best] = [left - takes for left, takes in zip(free[best], sizes[item], strict=True)]
    return tuple(where)


def _takes(
    item: int,
    host: int,
    sizes: Sequence[Sizes],
    free: Sequence[Sequence[int]],
    where: Sequence[int | None],
    conflicts: frozenset[tuple[int, int]],
) -> bool:
    return all(takes <= left for takes, left in zip(sizes[item], free[host], strict=True)) and not any(
        at == host and (min(item, other), max(item, other)) in conflicts for other, at in enumerate(where)
    )
