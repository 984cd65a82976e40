"""All patterns of a packing that leaves no room: where every used host must be exactly full, few sets of items are."""

from collections.abc import Sequence
from dataclasses import replace

from rarms_iac.planner.packing.program import Kind, Mask, Program, Sizes

MOST = 1_500
"""More patterns than these are not listed: the knapsack finds the ones that matter."""

_STEPS = 400_000


def without_waste(program: Program) -> Program:
    """The program with its patterns listed, where the hosts that are paid for must be exactly full."""
    if program.patterns is not None:
        return program
    full = full_dimensions(program)
    return replace(program, patterns=exact_fills(program, full)) if full else program


def full_dimensions(program: Program) -> tuple[int, ...]:
    """The dimensions in which the hosts that the budget pays for have no room to spare.

    Only where hosts differ in nothing but what is on them now, so that the budget says how many are used.
    """
    first = program.kinds[0]
    if program.budget is None or not first.charge or any(not _same(kind, first) for kind in program.kinds):
        return ()
    if any(size is None for size in first.sizes):
        return ()
    used, odd = divmod(program.budget, first.charge)
    taken = [sum(size[d] for size in first.sizes if size is not None) for d in range(len(first.room))]
    return tuple(d for d, room in enumerate(first.room) if not odd and taken[d] == used * room)


def _same(kind: Kind, other: Kind) -> bool:
    return (
        kind.room == other.room
        and kind.sizes == other.sizes
        and kind.charge == other.charge
        and not any(kind.charges)
        and not any(other.charges)
    )


def exact_fills(program: Program, full: Sequence[int], most: int = MOST) -> tuple[Mask, ...] | None:
    """Every set of items that fills a host exactly in these dimensions; None where they are too many to list."""
    kind = program.kinds[0]
    items = sorted(range(program.items), key=lambda item: (_size(kind, item), item), reverse=True)
    sizes = [_size(kind, item) for item in items]
    reach = {d: _reachable([size[d] for size in sizes], kind.room[d]) for d in full}
    found: list[Mask] = []
    steps = _STEPS

    def down(number: int, free: Sizes, mask: Mask, banned: Mask) -> bool:
        """Whether the list may still be complete."""
        nonlocal steps
        steps -= 1
        if steps < 0 or len(found) > most:
            return False
        if all(not free[d] for d in full):
            found.append(mask)  # items of size nothing in these dimensions would follow; there are none
            return True
        if number == len(items) or any(not reach[d][number] >> free[d] & 1 for d in full):
            return True
        item, size = items[number], sizes[number]
        after = tuple(map(int.__sub__, free, size))
        fits = min(after) >= 0 and not banned >> item & 1
        if fits and not down(number + 1, after, mask | 1 << item, banned | program.conflicts[item]):
            return False
        return down(number + 1, free, mask, banned)

    if any(not size[d] for size in sizes for d in full) or not down(0, kind.room, 0, 0):
        return None
    return tuple(sorted(found))


def _size(kind: Kind, item: int) -> Sizes:
    size = kind.sizes[item]
    assert size is not None, "full dimensions are told only where every item may be anywhere"
    return size


def _reachable(sizes: Sequence[int], room: int) -> list[int]:
    """By number: the sums, as bits, that the items from that number on can make."""
    inside = (1 << room + 1) - 1
    sums = [1]
    for size in reversed(sizes):
        sums.append((sums[-1] | sums[-1] << size) & inside)
    return sums[::-1]
