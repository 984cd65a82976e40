"""Plain sizes into equal bins where they are many: the best of several heuristics, and dives on a relaxation."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from random import Random

from rarms_iac.planner.packing.plain.completion import completed
from rarms_iac.planner.packing.plain.cutting import Looks, relaxed
from rarms_iac.planner.packing.plain.demand import Demand, Pattern, bins_of, demand_of
from rarms_iac.planner.packing.plain.diving import Limits, dive
from rarms_iac.planner.packing.plain.filling import best_fit, filled
from rarms_iac.planner.packing.plain.fullest import fullest
from rarms_iac.planner.packing.program import Sizes

_FULLEST = 2_000
"""Items that are put into bins by what fills them best, over all tries."""

_DIVES = 12

_WORK = 400_000
"""Pivots times rows that relaxations of dives take in all."""

_STEPS = 20_000
"""Bins that are tried to complete a packing of few items."""

_FEW = 75


@dataclass(frozen=True, slots=True, kw_only=True)
class Packing:
    """The bin of each item, how many there are, and what no packing is below."""

    bins: tuple[int, ...]
    used: int
    bound: int


def pack_many(items: Sequence[Sizes], room: Sizes, least: int, *, own: bool = False) -> Packing:
    """The fewest bins that are found, or `least`, which is enough; every item fits alone.

    The bound is one where none is below `least`.

    With `own` the linear program is ours, whatever is installed.
    """
    demand = demand_of(items, room)
    quick = list(_at_once(items, demand, least))
    best = min(quick, key=len)
    bound = least
    if len(best) > bound:
        known = sorted({pattern for one in quick for pattern in one})
        start = relaxed(demand, known, bound, Looks(own=own))
        bound = max(bound, start.bound)
        left, random = _WORK, Random(len(items))  # noqa: S311 - the same input, the same dives
        for number in range(_DIVES):
            if len(best) <= bound or left <= 0:
                break
            limits = Limits(work=left, random=random if number else None, own=own)
            found = dive(demand, start, bound, limits)
            left -= found.work
            best = min(best, list(found.patterns), key=len)
    return Packing(bins=bins_of(items, best, demand), used=len(best), bound=bound)


def _at_once(items: Sequence[Sizes], demand: Demand, least: int) -> Iterator[list[Pattern]]:
    """Packings that need no relaxation, until one has no more bins than the least."""
    for make in (best_fit, filled):
        yield (found := make(demand))
        if len(found) <= least:
            return
    if len(demand.room) == 1:
        sizes = [size for size, count in zip(demand.sizes, demand.counts, strict=True) for _ in range(count)]
        where = fullest([size[0] for size in sizes], demand.room[0], max(4, _FULLEST // len(items)), least)
        if where is not None:
            yield _patterns(demand, where)
    if len(items) <= _FEW:
        yield from filter(None, [completed(demand, least, _STEPS)])


def _patterns(demand: Demand, where: Sequence[int]) -> list[Pattern]:
    """The bins of sizes that are written out one by one."""
    numbers = [at for at, count in enumerate(demand.counts) for _ in range(count)]
    bins: dict[int, dict[int, int]] = {}
    for at, bin_ in zip(numbers, where, strict=True):
        inside = bins.setdefault(bin_, {})
        inside[at] = inside.get(at, 0) + 1
    return [tuple(sorted(inside.items())) for inside in bins.values()]
