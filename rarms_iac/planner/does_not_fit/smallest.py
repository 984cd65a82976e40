"""A smallest set of partitions that find no room together: none of them can be left out.

Every set that does find room leaves somebody out of whom each conflicting set has at least one. So a smallest set that
hits all that were left out so far either conflicts, and is a smallest of all; or finds room, and tells of others that
are left out (implicit hitting sets; A. Ignatiev et al., "Smallest MUS extraction with minimal hitting set dualization",
CP 2015).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from rarms_iac.planner.does_not_fit.room import exceeds, memory_of
from rarms_iac.planner.does_not_fit.smaller import alone, hosts_of
from rarms_iac.planner.placing.first_fit import Bin, Item, cost, first_fit
from rarms_iac.planner.placing.in_numbers import gave_up, in_whole_numbers
from rarms_iac.planner.placing.place import EXACT_UP_TO, place

SEARCHES = 60
"""Sets of which it is searched whether they find room; one that was not searched counts as if it did."""

ROUNDS = 30
"""Sets that hit everybody who was left out that are looked at for a smaller one."""

NODES = 3_000
"""Steps in which one such set is looked for."""

Names = frozenset[str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Smallest:
    """Partitions that find no room together, and whether that was shown of just these."""

    items: tuple[Item, ...]
    proven: bool


def smallest(items: Sequence[Item], bins: Sequence[Bin]) -> Smallest:
    """The fewest that were found; everybody where it is not known that fewer do."""
    asked = _Asked(bins=tuple(bins), left=SEARCHES)
    start = _by_sums(items, bins) or alone(items, bins)
    if start is None:
        if len(items) > EXACT_UP_TO or not asked.placed_nowhere(items):
            return Smallest(items=tuple(items), proven=False)
        start = tuple(items)
    least = _none_without_need(start, asked)
    if len(items) <= EXACT_UP_TO:
        least = _smaller(items, least, asked)
    return Smallest(items=tuple(sorted(least, key=lambda one: one.name)), proven=True)


def _by_sums(items: Sequence[Item], bins: Sequence[Bin]) -> tuple[Item, ...] | None:
    found = [some for measure in (cost, memory_of) if (some := exceeds(items, bins, measure)) is not None]
    return min(found, key=len, default=None)


@dataclass(slots=True, kw_only=True)
class _Asked:
    """Answers whether sets find room, each once."""

    bins: tuple[Bin, ...]
    left: int
    _known: dict[Names, bool] = field(default_factory=dict)

    def conflict(self, some: Sequence[Item]) -> bool:
        """Whether it is known that these find no room together."""
        key = frozenset(one.name for one in some)
        if key not in self._known:
            self._known[key] = self._conflict(some)
        return self._known[key]

    def _conflict(self, some: Sequence[Item]) -> bool:
        if _by_sums(some, self.bins) is not None:
            return True
        if first_fit(some, self.bins) is not None:
            return False
        if all(len(one.claims) == 1 for one in some):
            found = place(some, self.bins)
            return found.hosts is None and found.proven
        from rarms_iac.planner.packing.dual import too_heavy
        from rarms_iac.planner.packing.solve import ruled_out

        problem = in_whole_numbers(some, hosts_of(some, self.bins))
        if len(some) > EXACT_UP_TO:
            return too_heavy(problem) is not None
        self.left -= 1
        return self.left >= 0 and ruled_out(problem) is not None and not gave_up(problem)

    def placed_nowhere(self, some: Sequence[Item]) -> bool:
        """Whether the search that places partitions has shown that it cannot place these."""
        found = place(some, self.bins)
        self._known[frozenset(one.name for one in some)] = found.hosts is None and found.proven
        return found.hosts is None and found.proven


def _none_without_need(items: Sequence[Item], asked: _Asked) -> tuple[Item, ...]:
    """Some of those who conflict, of whom none can be left out: the small ones are left out first."""
    left = sorted(items, key=_size)
    for item in tuple(left):
        without = [one for one in left if one is not item]
        if without and asked.conflict(without):
            left = without
    return tuple(left)


def _size(one: Item) -> tuple[int, int, str]:
    return min(map(cost, one.claims.values())), min(map(memory_of, one.claims.values())), one.name


def _smaller(items: Sequence[Item], known: tuple[Item, ...], asked: _Asked) -> tuple[Item, ...]:
    """A smallest set that conflicts, where one was found that is smaller than that one."""
    by_name, ordered = {one.name: one for one in items}, sorted(items, key=_size)
    left_out: list[Names] = []
    for _ in range(ROUNDS):
        hitting = _hitting(left_out, len(known) - 1)
        if hitting is None:
            return known
        some = [by_name[name] for name in sorted(hitting)]
        if some and asked.conflict(some):
            return tuple(some)
        for one in ordered:
            if one.name not in hitting and not asked.conflict([*some, one]):
                some.append(one)
        left_out.append(frozenset(by_name) - {one.name for one in some})
    return known


def _hitting(sets: Sequence[Names], most: int) -> Names | None:
    """A smallest set of at most so many with a member of each; None: there is none, or it takes too long to find."""
    nodes = NODES

    def down(chosen: Names, size: int) -> Names | None:
        nonlocal nodes
        nodes -= 1
        missed = [one for one in sets if not one & chosen]
        if not missed:
            return chosen
        if size == 0 or nodes < 0 or _apart(missed) > size:
            return None
        for name in min(map(sorted, missed), key=lambda names: (len(names), names)):
            found = down(chosen | {name}, size - 1)
            if found is not None:
                return found
        return None

    return next((found for size in range(most + 1) if (found := down(frozenset(), size)) is not None), None)


def _apart(sets: Sequence[Names]) -> int:
    """Some of the sets that have nobody in common: each needs a member of its own."""
    taken: set[str] = set()
    number = 0
    shortest_first = sorted(sets, key=lambda names: (len(names), sorted(names)))
    for one in shortest_first:
        if not one & taken:
            taken |= one
            number += 1
    return number
