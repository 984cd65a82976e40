"""A packing made better by parts: what a few of its hosts hold is packed anew, exactly, while the rest stays."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

from rarms_iac.planner.packing.branch import Limits, Search
from rarms_iac.planner.packing.columns import Effort
from rarms_iac.planner.packing.nodes import everything, without
from rarms_iac.planner.packing.program import (
    Bundles,
    Mask,
    Program,
    charge_of,
    pattern_cost,
    value_of,
)
from rarms_iac.planner.packing.waste import without_waste

TOGETHER = (3, 4, 5)
"""Hosts that are packed anew at once: few first, more where that helps no further."""

TRIES = 80
PATTERNS = 4_000
"""Knapsacks in all, after which nothing more is tried."""

_SMALL = Limits(
    cover=8_000,
    cover_below=400,
    nodes=6,
    dives=3,
    first_dive=12,
    dive=6,
    patterns=600,
    effort=Effort(pattern_nodes=20_000),
)


def improved(program: Program, bundles: Bundles, target: int, tries: int = TRIES) -> Bundles:
    """A packing that costs no more; a target reached or so many tries end it."""
    best, left, spent, fruitless = bundles, tries, 0, set[Bundles]()
    while left > 0 and value_of(program, best) > target:
        for some in _neighbours(program, best):
            if some in fruitless:
                continue
            left -= 1 if spent < PATTERNS else left
            better, patterns = _anew(program, best, some)
            spent += patterns
            if better is not None:
                best = better
                break
            fruitless.add(some)
            if left <= 0:
                break
        else:
            break
    return best


def _neighbours(program: Program, bundles: Bundles) -> Iterator[Bundles]:
    """Some of the bundles at a time, those that cost most first."""
    ranked = sorted(bundles, key=lambda one: (-pattern_cost(program.kinds[one[0]], one[1]), one))
    for number in TOGETHER:
        for some in sorted(combinations(range(len(ranked)), min(number, len(ranked))), key=lambda at: (sum(at), at)):
            yield tuple(sorted(ranked[at] for at in some))


def _anew(program: Program, bundles: Bundles, some: Bundles) -> tuple[Bundles | None, int]:
    """The packing with these bundles' items packed anew on the hosts that the others leave, if that is better.

    And how many knapsacks that took.
    """
    rest = tuple(one for one in bundles if one not in some)
    view = everything(program)
    for kind, mask in rest:
        ours = view.ours(mask)
        assert ours is not None
        view = without(view, kind, ours)
    kinds = tuple(kind for kind in view.program.kinds if kind.hosts)
    numbers = [at for at, kind in enumerate(view.program.kinds) if kind.hosts]
    fits = view.program.fits
    small = replace(
        view.program,
        kinds=kinds,
        fits=(lambda at, items: fits(numbers[at], items)) if fits else None,
        budget=None if program.budget is None else program.budget - charge_of(program, rest),
    )
    known = tuple(sorted((numbers.index(kind), _ours(view.ours(mask))) for kind, mask in some))
    before = value_of(small, known)
    search = Search(without_waste(small), known, _SMALL, ceiling=before + 1)
    found = search.run()
    assert found.bundles is not None
    if value_of(small, found.bundles) >= before:
        return None, search.patterns
    whole = ((numbers[kind], view.whole(mask)) for kind, mask in found.bundles)
    return tuple(sorted((*rest, *whole))), search.patterns


def _ours(mask: Mask | None) -> Mask:
    assert mask is not None, "a bundle is not torn by taking others away"
    return mask
