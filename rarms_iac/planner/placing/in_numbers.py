"""Partitions and hosts as the whole numbers that packings are made of."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import gcd

from rarms_iac.model.capacity import WHOLE, Effort, holds
from rarms_iac.model.plan import Claim
from rarms_iac.planner.packing.program import Problem, Processors, Sizes
from rarms_iac.planner.placing.first_fit import Bin, Item, cost, free_in

STEPS = 100_000
"""Steps in which places for virtual processors are searched for, in all questions of a packing together."""


def in_whole_numbers(items: Sequence[Item], bins: Sequence[Bin]) -> Problem:
    """The same in whole numbers: per cent of processors, memory, virtual processors of more than half a logical one.

    Whether virtual processors find their logical ones is asked beyond that, but where all are as wide as their hosts.
    """
    numbers = {one.name: at for at, one in enumerate(bins)}
    sizes = [[_size(item, one) for item in items] for one in bins]
    rooms = [_room(one) for one in bins]
    for at, room in enumerate(rooms):
        if min(room) < 0 or _overcommitted(bins[at]):  # others hold more than there is
            sizes[at] = [None] * len(items)
    costs = [[cost(item.claims[one.name]) if one.name in item.claims else 0 for item in items] for one in bins]
    alike: dict[object, int] = {}
    kinds = [
        alike.setdefault((one.capacity, one.taken, tuple(item.claims.get(one.name) for item in items)), at)
        for at, one in enumerate(bins)
    ]
    narrow = [not _as_wide(items, one) for one in bins]
    units = [_unit(sizes, d) for d in range(3)]
    rows = [tuple(None if size is None else _in(size, units) for size in row) for row in sizes]
    return Problem(
        sizes=tuple(rows),
        rooms=tuple(_in(tuple(max(0, there) for there in room), units) for room in rooms),
        opening=(0,) * len(bins),
        costs=tuple(map(tuple, costs)),
        now=tuple(numbers.get(item.now) for item in items),
        fits=_Fitting(items=items, bins=bins, kinds=kinds) if any(narrow) else None,
        alike=tuple(kinds),
        processors=tuple(_processors(items, one) if much else None for one, much in zip(bins, narrow, strict=True)),
    )


def _size(item: Item, one: Bin) -> Sizes | None:
    claim = item.claims.get(one.name)
    if claim is None or _too_wide(claim, one):
        return None
    return cost(claim), claim.memory, claim.processors if 2 * claim.reserve > WHOLE else 0


def _room(one: Bin) -> Sizes:
    free = free_in(one)
    halves = sum(claim.processors for claim in one.taken if 2 * claim.reserve > WHOLE)
    return free.percent, free.memory, one.capacity.logical_processors - halves


def _too_wide(claim: Claim, one: Bin) -> bool:
    """Whether the reserve is guaranteed to nobody, for more virtual processors than the host has logical ones."""
    return bool(claim.reserve) and claim.processors > one.capacity.logical_processors


def _overcommitted(one: Bin) -> bool:
    return any(_too_wide(claim, one) for claim in one.taken)


def _processors(items: Sequence[Item], one: Bin) -> Processors:
    def virtual(claim: Claim | None) -> tuple[int, int]:
        return (claim.processors, claim.reserve) if claim is not None and claim.reserve else (0, 0)

    return Processors(
        logical=one.capacity.logical_processors,
        virtual=tuple(virtual(item.claims.get(one.name)) for item in items),
        others=tuple(map(virtual, one.taken)),
    )


def _as_wide(items: Sequence[Item], one: Bin) -> bool:
    claims = [*one.taken, *(item.claims[one.name] for item in items if one.name in item.claims)]
    return all(not claim.reserve or claim.processors == one.capacity.logical_processors for claim in claims)


def _unit(sizes: Sequence[Sequence[Sizes | None]], dimension: int) -> int:
    """What all sizes are multiples of."""
    return gcd(*(size[dimension] for row in sizes for size in row if size is not None)) or 1


def _in(size: Sizes, units: Sequence[int]) -> Sizes:
    return tuple(one // unit for one, unit in zip(size, units, strict=True))


@dataclass(slots=True, kw_only=True)
class _Fitting:
    """Answers whether a host can keep some of the partitions, each question once."""

    items: Sequence[Item]
    bins: Sequence[Bin]
    kinds: Sequence[int]
    effort: Effort = field(default_factory=lambda: Effort(STEPS))  # of all questions together
    gave_up: bool = False  # whether an answer was no because it is not known
    _known: dict[tuple[int, tuple[int, ...]], bool] = field(default_factory=dict)

    def __call__(self, host: int, some: Sequence[int]) -> bool:
        """As `Problem.fits` says."""
        what = (self.kinds[host], tuple(some))
        if what not in self._known:
            one = self.bins[host]
            claims = [*one.taken, *(self.items[at].claims[one.name] for at in some)]
            held = holds(one.capacity, claims, self.effort)
            self.gave_up = self.gave_up or held is None
            self._known[what] = held is True
        return self._known[what]


def gave_up(problem: Problem) -> bool:
    """Whether, so far, a host was taken not to keep what it may keep: what was ruled out by that is not proved."""
    return isinstance(problem.fits, _Fitting) and problem.fits.gave_up
