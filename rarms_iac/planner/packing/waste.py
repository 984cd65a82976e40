"""What a packing may waste, where the hosts it pays for have little to spare: then few sets of items can be in it."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from math import prod

from rarms_iac.planner.packing.program import Kind, Mask, Program, Sizes

MOST = 1_500
"""More patterns than these are not listed for a program: the knapsack finds the ones that matter."""

FILLS = 60_000
"""Nearly full sets that are listed at most for one room."""

_STEPS = 400_000

_WAYS = 5_000
"""Ways to pay for hosts that are looked at, at most."""

_LARGEST = 10_000
"""Larger rooms are not looked at closely."""


def without_waste(program: Program) -> Program:
    """The program with its patterns listed, where the hosts that are paid for must be exactly full."""
    if program.patterns is not None:
        return program
    return replace(program, patterns=exact_fills(program)) if full_dimensions(program) else program


def full_dimensions(program: Program) -> tuple[int, ...]:
    """The dimensions in which the hosts that the budget pays for have no room to spare.

    Only where hosts differ in nothing but what is on them now, so that the budget says how many are used.
    """
    first = program.kinds[0]
    if any(kind.room != first.room or kind.charge != first.charge for kind in program.kinds):
        return ()
    return tuple(d for d, most in enumerate(spare(program) or ()) if most == 0)


def spare(program: Program) -> Sizes | None:
    """By dimension: what is left on all used hosts together, at most; None where the budget does not tell."""
    if program.budget is None or not _told(program):
        return None
    first, types = program.kinds[0], _types(program)
    sizes = [size for size in first.sizes if size is not None]
    taken = [sum(size[d] for size in sizes) for d in range(len(first.room))]
    most: list[int] | None = None
    for used in product(*(range(hosts + 1) for hosts in types.values())):
        if sum(count * charge for count, (_, charge) in zip(used, types, strict=True)) != program.budget:
            continue
        left = [
            sum(n * room[d] for n, (room, _) in zip(used, types, strict=True)) - taken[d] for d in range(len(taken))
        ]
        if min(left) >= 0:
            most = left if most is None else list(map(max, most, left))
    return None if most is None else tuple(most)


def _told(program: Program) -> bool:
    """Whether what is paid for hosts tells how much room they have, and what items take does not depend on them."""
    first = program.kinds[0]
    if any(kind.sizes != first.sizes or any(kind.charges) for kind in program.kinds) or None in first.sizes:
        return False
    return prod(hosts + 1 for hosts in _types(program).values()) <= _WAYS


def _types(program: Program) -> dict[tuple[Sizes, int], int]:
    """How many hosts there are of a room and price."""
    types: dict[tuple[Sizes, int], int] = {}
    for kind in program.kinds:
        types[kind.room, kind.charge] = types.get((kind.room, kind.charge), 0) + len(kind.hosts)
    return types


def payable(program: Program, value: int) -> int:
    """The least that a packing can cost, if it is no less than that: hosts of exactly that price have room for all."""
    if program.budget is not None or any(any(kind.costs) for kind in program.kinds):
        return value
    paid = replace(program, kinds=tuple(replace(one, charge=one.opening) for one in program.kinds))
    most = sum(kind.opening * len(kind.hosts) for kind in program.kinds)
    while value < most and _told(paid) and spare(replace(paid, budget=value)) is None:
        value += 1
    return value


def exact_fills(program: Program) -> tuple[Mask, ...] | None:
    """Every set of items that a host can have where some dimension has no room to spare; None: too many to list."""
    most = spare(program)
    return None if most is None else fills(program, program.kinds[0], most, MOST)


def fills(program: Program, kind: Kind, most: Sizes, limit: int = FILLS) -> tuple[Mask, ...] | None:
    """Every set of items for a host of that room that leaves no more than so much; None: too many to list."""
    tight = [d for d, room in enumerate(kind.room) if most[d] < room <= _LARGEST]
    items = sorted(range(program.items), key=lambda item: (_size(kind, item), item), reverse=True)
    sizes = [_size(kind, item) for item in items]
    reach = [(d, most[d], _reachable([size[d] for size in sizes], kind.room[d])) for d in tight]
    found: list[Mask] = []
    steps = _STEPS

    def down(number: int, free: Sizes, mask: Mask, banned: Mask) -> bool:
        """Whether the list may still be complete."""
        nonlocal steps
        steps -= 1
        if steps < 0 or len(found) > limit:
            return False
        if mask and all(free[d] <= left for d, left, _ in reach):
            found.append(mask)
        for at in range(number, len(items)):
            for d, left, sums in reach:
                # What follows must be able to leave no more than may be left.
                least = max(0, free[d] - left)
                if not sums[at] >> least & (2 << free[d] - least) - 1:
                    return True
            item, after = items[at], tuple(map(int.__sub__, free, sizes[at]))
            fits = min(after) >= 0 and not banned >> item & 1
            if fits and not down(at + 1, after, mask | 1 << item, banned | program.conflicts[item]):
                return False
        return True

    if not tight or not down(0, kind.room, 0, 0):
        return None
    return tuple(sorted(found))


def _size(kind: Kind, item: int) -> Sizes:
    size = kind.sizes[item]
    assert size is not None, "what may be wasted is told only where every item may be anywhere"
    return size


def _reachable(sizes: Sequence[int], room: int) -> list[int]:
    """By number: the sums, as bits, that the items from that number on can make."""
    inside = (1 << room + 1) - 1
    sums = [1]
    for size in reversed(sizes):
        sums.append((sums[-1] | sums[-1] << size) & inside)
    return sums[::-1]
