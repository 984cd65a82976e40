"""A start for the solver, and often the end: the best of a few first fits.

Partitions are placed one after another, each on the first host that has room, and none is placed anew. The order of the
partitions and the order in which a partition tries its hosts make the difference; a handful of each is tried.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product
from random import Random

from rarms_iac.model.capacity import packs_by_size
from rarms_iac.model.claims import Claim, Load
from rarms_iac.planner.packing.values import Bin, Item, cost, free_in, least_cost, least_memory, value_of

SHAKEN = 12
"""Orders by a size that chance made a little larger or smaller."""

_Value = tuple[int, int]


def best_first_fit(items: Sequence[Item], bins: Sequence[Bin], bound: _Value | None = None) -> dict[str, str] | None:
    """Find a host for each partition by first fit.

    Args:
        items: The partitions, by name.
        bins: The hosts, by name.
        bound: Reservation and moves that no packing is below: the first packing that meets it is taken. None: the
            first packing of all is.

    Returns:
        The packing with the least reservation and then the fewest moves, of those that were tried; None: no order of
        partitions led to one, which does not say that there is none.
    """
    best: tuple[_Value, dict[str, str]] | None = None
    for order, preference in product(_orders(items, bins), _PREFERENCES):
        hosts = _first_fit(order, bins, preference)
        if hosts is None:
            continue
        value = value_of(items, hosts)
        if best is None or value < best[0]:
            best = value, hosts
        if bound is None or value == bound:
            break
    return None if best is None else {name: best[1][name] for name in sorted(best[1])}


class _Room:
    """What is left of a host while partitions are put onto it."""

    def __init__(self, host: Bin) -> None:
        self.free = free_in(host)
        self._logical_processors = host.capacity.logical_processors
        self._claims = list(host.taken)

    def take(self, claim: Claim) -> bool:
        """Take the claim, where the host has room for it and virtual processors find their places quickly."""
        free = Load(percent=self.free.percent - cost(claim), memory=self.free.memory - claim.memory)
        if free.percent < 0 or free.memory < 0:
            return False
        claims = [*self._claims, claim]
        if not packs_by_size(claims, self._logical_processors):
            return False
        self.free, self._claims = free, claims
        return True


_Preference = Callable[[Item, str, Mapping[str, _Room]], tuple[int, ...]]


def _cheapest(item: Item, host: str, rooms: Mapping[str, _Room]) -> tuple[int, ...]:  # noqa: ARG001  # a preference
    return cost(item.claims[host]), host != item.now


def _staying(item: Item, host: str, rooms: Mapping[str, _Room]) -> tuple[int, ...]:  # noqa: ARG001  # a preference
    return host != item.now, cost(item.claims[host])


def _fullest(item: Item, host: str, rooms: Mapping[str, _Room]) -> tuple[int, ...]:
    return cost(item.claims[host]), host != item.now, rooms[host].free.percent


_PREFERENCES: tuple[_Preference, ...] = (_cheapest, _fullest, _staying)
"""Which host a partition tries first; ties by the host's name."""


def first_fit_of_some(items: Sequence[Item], bins: Sequence[Bin]) -> dict[str, str]:
    """Place the partitions that find room, largest first, each on the fullest host that has room."""
    return _placed(next(_orders(items, bins)), bins, _fullest)


def _first_fit(order: Sequence[Item], bins: Sequence[Bin], preference: _Preference) -> dict[str, str] | None:
    hosts = _placed(order, bins, preference, some=False)
    return hosts if len(hosts) == len(order) else None


def _placed(
    order: Sequence[Item], bins: Sequence[Bin], preference: _Preference, *, some: bool = True
) -> dict[str, str]:
    """Where each finds room; without `some` it ends at the first that finds none."""
    rooms = {host.name: _Room(host) for host in bins}
    hosts: dict[str, str] = {}
    for item in order:
        for name in sorted(item.claims, key=lambda host: (*preference(item, host, rooms), host)):
            if rooms[name].take(item.claims[name]):
                hosts[item.name] = name
                break
        else:
            if not some:
                break
    return hosts


def _orders(items: Sequence[Item], bins: Sequence[Bin]) -> Iterator[list[Item]]:
    """Yield the partitions largest first, by several measures; those that run first, where some do."""
    free = [free_in(host) for host in bins]
    percent = max(1, max((load.percent for load in free), default=1))
    memory = max(1, max((load.memory for load in free), default=1))
    measures: tuple[Callable[[Item], tuple[float, ...]], ...] = (
        lambda item: (-least_cost(item), -least_memory(item)),
        lambda item: (-least_cost(item) / percent - least_memory(item) / memory,),
        lambda item: (len(item.claims), -least_cost(item) / percent - least_memory(item) / memory),
        lambda item: (-least_memory(item), -least_cost(item)),
    )
    orders = [sorted(items, key=measure) for measure in measures]
    random = Random(0)  # noqa: S311  # no secret: the same orders for the same partitions
    for _ in range(SHAKEN):
        weight, spread = random.random(), random.choice((0.1, 0.3, 0.6))
        shares = {
            item.name: (weight * least_cost(item) / percent + (1 - weight) * least_memory(item) / memory)
            * random.uniform(1 - spread, 1 + spread)
            for item in items
        }
        orders.append(sorted(items, key=lambda item: -shares[item.name]))
    if any(item.now for item in items):
        orders += [sorted(order, key=lambda item: not item.now) for order in orders]
    seen: list[list[str]] = []
    for order in orders:
        names = [item.name for item in order]
        if names not in seen:
            seen.append(names)
            yield order
