"""A smallest set of partitions that cannot share the hosts that they may run on, found by leaving others out."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from rarms_iac.planner.packing.pack import packs
from rarms_iac.planner.packing.values import Bin, Item, free_in, least_cost, least_memory

ASKED = 80
"""Sets that are packed to find a smallest one: a count, so that equal inputs have equal answers."""

UNKNOWN = 5
"""A set of which it is not known whether it fits counts one for so many partitions on hosts: that took long."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Conflict:
    """Partitions that do not fit together on the hosts that any of them may run on."""

    items: tuple[Item, ...]  # by name
    bins: tuple[Bin, ...]
    proven: bool  # otherwise it is only that nothing was found
    lacking: str  # what is too little in sum: processors or memory; empty: neither, but no way to place them is left


def conflicts(items: Sequence[Item], bins: Sequence[Bin], *, proven: bool) -> tuple[Conflict, ...]:
    """Find who conflicts, by processors and by memory where each of the two is too little.

    Args:
        items: Partitions of which no packing was found.
        bins: All hosts.
        proven: Whether there is none.

    Returns:
        One or two conflicts; of none can a partition be left out, unless `ASKED` ends the search before.
    """
    by_sums = {
        "processors": _fewest_beyond(items, bins, least_cost, lambda host: free_in(host).percent),
        "memory": _fewest_beyond(items, bins, least_memory, lambda host: free_in(host).memory),
    }
    found = [_conflict(some, bins, proven=True, lacking=what) for what, some in by_sums.items() if some]
    return tuple(found) or (_by_packing(items, bins, proven=proven),)


def _conflict(items: Sequence[Item], bins: Sequence[Bin], *, proven: bool, lacking: str) -> Conflict:
    ordered = tuple(sorted(items, key=lambda item: item.name))
    return Conflict(items=ordered, bins=_hosts_of(items, bins), proven=proven, lacking=lacking)


def _hosts_of(items: Sequence[Item], bins: Sequence[Bin]) -> tuple[Bin, ...]:
    """The hosts that any of the partitions may run on."""
    names = {name for item in items for name in item.claims}
    return tuple(host for host in bins if host.name in names)


def _groups(items: Sequence[Item]) -> Iterator[Sequence[Item]]:
    """Partitions that must find room among few hosts, the fewest hosts first; all of them last."""
    few = sorted({tuple(sorted(item.claims)) for item in items}, key=lambda names: (len(names), names))
    for names in few:
        some = [item for item in items if item.claims.keys() <= set(names)]
        if len(some) < len(items):
            yield some
    yield items


def _fewest_beyond(
    items: Sequence[Item], bins: Sequence[Bin], need: Callable[[Item], int], room: Callable[[Bin], int]
) -> Sequence[Item]:
    """The fewest of a group that need more than its hosts have in sum; empty: no group does."""
    found: list[list[Item]] = []
    for group in _groups(items):
        whole = sum(max(0, room(host)) for host in _hosts_of(group, bins))
        total, some = 0, []
        for item in sorted(group, key=lambda item: (-need(item), item.name)):
            total += need(item)
            some.append(item)
            if total > whole:
                found.append(some)
                break
    return min(found, key=lambda some: (len(some), [item.name for item in some]), default=())


def _by_packing(items: Sequence[Item], bins: Sequence[Bin], *, proven: bool) -> Conflict:
    """Leave out the small ones first, by halves, quarters and so on, as long as those that stay still conflict."""
    asked = 0

    def conflict(some: Sequence[Item]) -> bool:
        nonlocal asked
        if asked >= ASKED or not some:
            return False
        fits = packs(some, _hosts_of(some, bins))
        asked += 1 if fits is not None else 1 + sum(len(item.claims) for item in some) // UNKNOWN
        return fits is False

    start = next((group for group in _groups(items) if len(group) < len(items) and conflict(group)), items)
    if start is items and not proven:
        return _conflict(items, bins, proven=False, lacking="")
    kept = sorted(start, key=lambda item: (least_cost(item), least_memory(item), item.name))
    step = len(kept)
    while step > 1:
        step = -(-step // 2)
        at = 0
        while at < len(kept):
            without = kept[:at] + kept[at + step :]
            if conflict(without):
                kept = without
            else:
                at += step
    return _conflict(kept, bins, proven=True, lacking="")
