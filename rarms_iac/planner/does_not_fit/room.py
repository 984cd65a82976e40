"""Whether partitions find room, asked many times over: how good the placement is does not matter."""

from collections.abc import Callable, Iterator, Sequence

from rarms_iac.model.plan import Claim
from rarms_iac.planner.does_not_fit.smaller import by_hosts, hosts_of
from rarms_iac.planner.placing.first_fit import Bin, Item, cost, first_fit, free_in
from rarms_iac.planner.placing.in_numbers import in_whole_numbers
from rarms_iac.planner.placing.place import EXACT_UP_TO, place

SEARCHED_UP_TO = 16
"""Partitions of which it is searched whether there is room; of more, greedy packings have to find it."""


def memory_of(claim: Claim) -> int:
    """In bytes."""
    return claim.memory


def has_room(items: Sequence[Item], bins: Sequence[Bin]) -> bool:
    """Whether a placement was found by a short search; that there is none is not proved."""
    if exceeds(items, bins, cost) or exceeds(items, bins, memory_of):
        return False
    if first_fit(items, bins) is not None:
        return True
    if all(len(one.claims) == 1 for one in items):
        return place(items, bins).hosts is not None
    if len(items) > EXACT_UP_TO:
        return False
    from rarms_iac.planner.packing.branch import Limits
    from rarms_iac.planner.packing.solve import Settings, finds_room

    limits = Limits(nodes=20, dives=4, first_dive=20, dive=4, patterns=400, cover=20_000, cover_below=2_000)
    return finds_room(in_whole_numbers(items, bins), Settings(limits=limits), searching=len(items) <= SEARCHED_UP_TO)


def exceeds(items: Sequence[Item], bins: Sequence[Bin], measure: Callable[[Claim], int]) -> tuple[Item, ...] | None:
    """The fewest whose least claims are more than all hosts that they may run on have; None: there are none."""
    found: list[tuple[Item, ...]] = []
    for group in (tuple(items), *by_hosts(items)):
        hosts = hosts_of(group, bins)
        room = sum(max(0, _room(one, measure)) for one in hosts)
        found += _largest_beyond(group, room, measure)
    return min(found, key=lambda some: (len(some), [one.name for one in some]), default=None)


def _room(one: Bin, measure: Callable[[Claim], int]) -> int:
    free = free_in(one)
    return free.memory if measure is memory_of else free.percent


def _largest_beyond(items: Sequence[Item], room: int, measure: Callable[[Claim], int]) -> Iterator[tuple[Item, ...]]:
    least = sorted(((-min(map(measure, one.claims.values())), one.name, one) for one in items), key=lambda one: one[:2])
    total = 0
    for number, (amount, _, _) in enumerate(least, 1):
        total -= amount
        if total > room:
            yield tuple(one for _, _, one in least[:number])
            return
