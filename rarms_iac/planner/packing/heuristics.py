"""Packings without proof, quickly: items one by one, in many orders, each where it costs least and fits tightest."""

from dataclasses import dataclass
from random import Random

from rarms_iac.planner.packing.program import Bundles, Mask, Program, charge_of, value_of


@dataclass(slots=True)
class _Open:
    kind: int
    free: list[int]
    items: Mask
    banned: Mask


def quick_packing(program: Program, target: int, tries: int) -> Bundles | None:
    """The best of so many greedy packings, None where none was found; one that costs `target` ends the search."""
    order = sorted(range(program.items), key=lambda item: (-_largest(program, item), item))
    random = Random(program.items)  # noqa: S311 - the same input gives the same orders
    best: Bundles | None = None
    value = 0
    for number in range(tries):
        found = _greedy(program, order if not number else _shaken(order, random), tight=number % 3 != 2)
        if found is None or (program.budget is not None and charge_of(program, found) != program.budget):
            continue
        cost = value_of(program, found)
        if best is None or cost < value:
            best, value = found, cost
        if value <= target:
            break
    return best


def _largest(program: Program, item: int) -> float:
    """The part of the smallest host that the item takes."""
    shares = [
        max((takes / max(1, room) for takes, room in zip(size, kind.room, strict=True)), default=0.0)
        for kind in program.kinds
        if (size := kind.sizes[item]) is not None
    ]
    return max(shares, default=0.0) + sum(shares) / 1e6


def _shaken(order: list[int], random: Random) -> list[int]:
    """The same order, disturbed: neighbours change places more often than distant items."""
    reach = random.choice((2.0, 4.0, 8.0))
    return [item for _, item in sorted((at + random.random() * reach, item) for at, item in enumerate(order))]


def _greedy(program: Program, order: list[int], *, tight: bool) -> Bundles | None:
    left = [len(kind.hosts) for kind in program.kinds]
    opened: list[_Open] = []
    for item in order:
        chosen = _choose(program, item, opened, left, tight=tight)
        if chosen is None:
            return None
        if chosen.items == 0:
            opened.append(chosen)
            left[chosen.kind] -= 1
        size = program.kinds[chosen.kind].sizes[item]
        assert size is not None
        chosen.free = [there - takes for there, takes in zip(chosen.free, size, strict=True)]
        chosen.items |= 1 << item
        chosen.banned |= program.conflicts[item]
    return tuple(sorted((one.kind, one.items) for one in opened))


def _choose(program: Program, item: int, opened: list[_Open], left: list[int], *, tight: bool) -> _Open | None:
    best: tuple[float, float] | None = None
    chosen: _Open | None = None
    new = (_Open(at, list(kind.room), 0, 0) for at, kind in enumerate(program.kinds) if left[at])
    for host in (*opened, *new):
        if not _takes(program, host, item):
            continue
        kind = program.kinds[host.kind]
        cost = float(kind.costs[item] + (kind.opening + kind.charge if not host.items else 0))
        size = kind.sizes[item]
        assert size is not None
        slack = sum(
            (there - takes) / max(1, room) for there, takes, room in zip(host.free, size, kind.room, strict=True)
        )
        rank = (cost, slack if tight else 0.0)
        if best is None or rank < best:
            best, chosen = rank, host
    return chosen


def _takes(program: Program, host: _Open, item: int) -> bool:
    size = program.kinds[host.kind].sizes[item]
    return (
        size is not None
        and not host.banned >> item & 1
        and all(takes <= there for takes, there in zip(size, host.free, strict=True))
        and (program.fits is None or program.fits(host.kind, host.items | 1 << item))
    )
