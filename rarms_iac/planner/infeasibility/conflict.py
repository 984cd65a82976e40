"""A smallest set of partitions that cannot share the hosts that they may run on, found by leaving others out."""

from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import accumulate

from rarms_iac.model.wording import natural_order
from rarms_iac.planner.infeasibility.budget import NODES_FOR_A_CONFLICT, SearchBudget
from rarms_iac.planner.packing.pack import can_pack, without_hopeless_claims
from rarms_iac.planner.packing.values import Bin, Item, free_in, least_cost, least_memory

_SMALLER_CONFLICT = "a smaller set of partitions that conflict"


class Lack(Enum):
    """What the hosts of a conflict do not have."""

    PROCESSORS = "processors"  # in sum
    MEMORY = "memory"  # in sum
    PLACEMENT = "placement"  # the sums are enough, and there is no way to place the partitions


@dataclass(frozen=True, slots=True, kw_only=True)
class Conflict:
    """Partitions that do not fit together on the hosts that any of them may run on."""

    items: Sequence[Item]  # by name
    bins: Sequence[Bin]
    lacking: Lack
    proven: bool = True  # otherwise it is only that nothing was found
    smallest: bool = True  # otherwise the search for a smaller one ended at its limit


def conflicts(items: Sequence[Item], bins: Sequence[Bin], budget: SearchBudget, *, proven: bool) -> Sequence[Conflict]:
    """Find who conflicts, by processors and by memory where each of the two is too little.

    Args:
        items: Partitions of which no packing was found.
        proven: Whether there is none.

    Returns:
        One or two conflicts. Without any one of its partitions the rest of each would fit, where it is `smallest`.
    """
    return conflicts_by_sums(items, bins) or [_by_packing(items, bins, budget, proven=proven)]


def evident_conflicts(items: Sequence[Item], bins: Sequence[Bin]) -> Sequence[Conflict]:
    """Find who conflicts where no search is needed to see it, and so no solver.

    Args:
        items: Partitions with at least one claim each.

    Returns:
        Partitions that no host can hold, each alone; else who needs too much in sum; else, where no partition has a
        choice, who finds no place for virtual processors. Empty: nothing is evident, which proves no layout.
    """
    placeable, bins = without_hopeless_claims(items, bins)
    hopeless = {item.name for item in placeable if not item.claims}
    if hopeless:
        return [_alone(item, bins) for item in _by_name(items) if item.name in hopeless]
    found = conflicts_by_sums(placeable, bins)
    if found or any(len(item.claims) > 1 for item in placeable) or can_pack(placeable, bins) is not False:
        return found
    return [_by_packing(placeable, bins, conflict_budget(), proven=True)]


def conflict_budget() -> SearchBudget:
    """Return the budget of the search for a smallest conflict."""
    return SearchBudget.of(NODES_FOR_A_CONFLICT)


def _alone(item: Item, bins: Sequence[Bin]) -> Conflict:
    hosts = _hosts_of([item], bins)
    memory = all(item.claims[host.name].memory > free_in(host).memory for host in hosts)
    return Conflict(items=[item], bins=hosts, lacking=Lack.MEMORY if memory else Lack.PROCESSORS)


def conflicts_by_sums(items: Sequence[Item], bins: Sequence[Bin]) -> Sequence[Conflict]:
    """Find who needs more processors or memory in sum than the hosts have; empty: the sums do not show it.

    Args:
        items: Partitions with at least one claim each.
    """
    processors = _fewest_beyond(items, bins, least_cost, lambda host: free_in(host).percent)
    memory = _fewest_beyond(items, bins, least_memory, lambda host: free_in(host).memory)
    return [
        Conflict(items=_by_name(fewest), bins=_hosts_of(fewest, bins), lacking=lacking)
        for lacking, fewest in ((Lack.PROCESSORS, processors), (Lack.MEMORY, memory))
        if fewest
    ]


def _by_name(items: Sequence[Item]) -> Sequence[Item]:
    return sorted(items, key=lambda item: natural_order(item.name))


def _hosts_of(items: Sequence[Item], bins: Sequence[Bin]) -> Sequence[Bin]:
    """Return the hosts that any of the partitions may run on."""
    names = {name for item in items for name in item.claims}
    return [host for host in bins if host.name in names]


def _groups(items: Sequence[Item]) -> Iterator[Sequence[Item]]:
    """Partitions that must find room among few hosts, the fewest hosts first; all of them last."""
    few = sorted({tuple(sorted(item.claims)) for item in items}, key=lambda names: (len(names), names))
    for names in few:
        group = [item for item in items if item.claims.keys() <= set(names)]
        if len(group) < len(items):
            yield group
    yield items


def _fewest_beyond(
    items: Sequence[Item], bins: Sequence[Bin], need: Callable[[Item], int], room: Callable[[Bin], int]
) -> Sequence[Item]:
    """Return the fewest of a group that need more than its hosts have in sum; empty: no group does."""
    found: list[Sequence[Item]] = []
    for group in _groups(items):
        ordered = sorted(group, key=lambda item: (-need(item), natural_order(item.name)))
        fitting = bisect_right(
            [*accumulate(map(need, ordered))], sum(max(0, room(host)) for host in _hosts_of(group, bins))
        )
        if fitting < len(group):
            found.append(ordered[: fitting + 1])
    return min(found, key=lambda fewest: (len(fewest), [item.name for item in fewest]), default=())


def _by_packing(items: Sequence[Item], bins: Sequence[Bin], budget: SearchBudget, *, proven: bool) -> Conflict:
    """Leave out the small ones first, by halves, quarters and so on, as long as those that stay still conflict."""
    smallest = True

    def conflict(remaining: Sequence[Item]) -> bool:
        nonlocal smallest
        if not remaining:
            return False
        may_ask = budget.takes(_SMALLER_CONFLICT, sum(len(item.claims) for item in remaining))
        fits = can_pack(remaining, _hosts_of(remaining, bins), nodes=budget.nodes) if may_ask else None
        smallest = smallest and fits is not None
        return fits is False

    start = next((group for group in _groups(items) if len(group) < len(items) and conflict(group)), items)
    if start is items and not proven:
        return Conflict(
            items=_by_name(items), bins=_hosts_of(items, bins), proven=False, smallest=False, lacking=Lack.PLACEMENT
        )
    remaining = sorted(start, key=lambda item: (least_cost(item), least_memory(item), natural_order(item.name)))
    step = len(remaining)
    while step > 1:
        step = -(-step // 2)
        at = 0
        while at < len(remaining):
            without = remaining[:at] + remaining[at + step :]
            if conflict(without):
                remaining = without
            else:
                at += step
    if not smallest:
        budget.unfinished[_SMALLER_CONFLICT] = None
    return Conflict(
        items=_by_name(remaining), bins=_hosts_of(remaining, bins), smallest=smallest, lacking=Lack.PLACEMENT
    )
