"""A start for the solver, and often the end: the best of a few first fits.

Partitions are placed one after another, each on the first host that has room, and none is moved later. The order of the
partitions and the order in which a partition tries its hosts make the difference; a few dozen ways are tried. Bounds by
sums alone tell when none can be better.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import accumulate, chain, islice, product
from random import Random

from rarms_iac.model.capacity import CheckedCapacity, packs_by_first_fit
from rarms_iac.model.claims import Claim, Load
from rarms_iac.planner.packing.values import (
    Bin,
    Item,
    Objective,
    free_in,
    is_move,
    least_cost,
    least_memory,
    objective_of,
)

FEW_WAYS = 12
"""Ways (an order of the partitions, and one of each partition's hosts) that a quick question tries: all sizes once."""

RANDOM_ORDERS = 12
"""Orders by a size that chance made a little larger or smaller."""


def best_first_fit(
    items: Sequence[Item], bins: Sequence[Bin], bound: Objective | None = None, *, ways: int | None = None
) -> dict[str, str] | None:
    """Find a host for each partition by first fit.

    Args:
        bound: What no packing is below: the first packing that meets it is taken. None: the first packing of all is.
        ways: How many ways are tried; None: all, about fifty, or twice as many where partitions run already.

    Returns:
        The host of each partition in the best packing of those that were tried; None: no order of partitions led to
        one, which does not say that there is none.
    """
    best: tuple[Objective, dict[str, str]] | None = None
    tries = ((order, preference) for order in _orders(items, bins) for preference in _PREFERENCES)
    for order, preference in islice(tries, ways):
        host_of = _first_fit(order, bins, preference, skips=False)
        if len(host_of) < len(items):
            continue
        objective = objective_of(items, host_of)
        if best is None or objective < best[0]:
            best = objective, host_of
        if bound is None or objective == bound:
            break
    return None if best is None else {name: best[1][name] for name in sorted(best[1])}


def partial_first_fit(items: Sequence[Item], bins: Sequence[Bin]) -> dict[str, str]:
    """Find a host for the partitions that find room, so that those left over reserve as little as possible.

    Returns:
        The host of each partition that found one.
    """
    ways = product(_orders(items, bins), _PREFERENCES)
    return min(
        (_first_fit(order, bins, preference, skips=True) for order, preference in ways),
        key=lambda host_of: sum(least_cost(item) for item in items if item.name not in host_of),
    )


class _RemainingCapacity:
    """The rest of a host while partitions are put onto it."""

    def __init__(self, host: Bin) -> None:
        self.free = free_in(host)
        self._capacity = host.capacity
        self._claims = list(host.foreign_claims)
        self._refused: set[tuple[int, int]] = set()  # processors and reserve of claims that found no places as it is

    def take(self, claim: Claim) -> bool:
        """Take the claim, where the host has room for it and virtual processors find their places quickly."""
        free = Load(percent=self.free.percent - claim.percent, memory=self.free.memory - claim.memory)
        if free.percent < 0 or free.memory < 0:
            return False
        claims, places = [*self._claims, claim], (claim.processors, claim.reserve)
        if places in self._refused or not packs_by_first_fit(claims, self._capacity):
            self._refused.add(places)
            return False
        if isinstance(self._capacity, CheckedCapacity) and not self._capacity.admits(claims):
            return False
        self.free, self._claims, self._refused = free, claims, set()
        return True


_Preference = Callable[[Item, str, Mapping[str, _RemainingCapacity]], tuple[int, ...]]
"""By which a partition sorts its hosts; ties by the host's name."""


def _cheapest(item: Item, host: str, remaining: Mapping[str, _RemainingCapacity]) -> tuple[int, ...]:  # noqa: ARG001  # a preference
    return item.claims[host].percent, is_move(item, host)


def _current(item: Item, host: str, remaining: Mapping[str, _RemainingCapacity]) -> tuple[int, ...]:  # noqa: ARG001  # a preference
    return is_move(item, host), item.claims[host].percent


def _fullest(item: Item, host: str, remaining: Mapping[str, _RemainingCapacity]) -> tuple[int, ...]:
    return item.claims[host].percent, is_move(item, host), remaining[host].free.percent


_PREFERENCES: tuple[_Preference, ...] = (_cheapest, _fullest, _current)


def _first_fit(order: Sequence[Item], bins: Sequence[Bin], preference: _Preference, *, skips: bool) -> dict[str, str]:
    """Return the host of each partition; one that finds no room is skipped, or is the end."""
    remaining = {host.name: _RemainingCapacity(host) for host in bins}
    host_of: dict[str, str] = {}
    for item in order:
        for name in sorted(item.claims, key=lambda host: (*preference(item, host, remaining), host)):
            if remaining[name].take(item.claims[name]):
                host_of[item.name] = name
                break
        else:
            if not skips:
                break
    return host_of


def _orders(items: Sequence[Item], bins: Sequence[Bin]) -> Iterator[list[Item]]:
    """Yield the partitions largest first, by several measures; then those that run first, where some do."""
    seen: set[tuple[str, ...]] = set()
    orders = _by_size(items, bins)
    if any(item.current_host for item in items):
        orders = chain(
            orders, (sorted(order, key=lambda item: not item.current_host) for order in _by_size(items, bins))
        )
    for order in orders:
        names = tuple(item.name for item in order)
        if names not in seen:
            seen.add(names)
            yield order


def _by_size(items: Sequence[Item], bins: Sequence[Bin]) -> Iterator[list[Item]]:
    free = [free_in(host) for host in bins]
    percent = max(1, max((load.percent for load in free), default=1))
    memory = max(1, max((load.memory for load in free), default=1))
    sizes = {item.name: (least_cost(item), least_memory(item)) for item in items}
    both = {name: -cost / percent - ram / memory for name, (cost, ram) in sizes.items()}
    yield sorted(items, key=lambda item: (-sizes[item.name][0], -sizes[item.name][1]))
    yield sorted(items, key=lambda item: both[item.name])
    yield sorted(items, key=lambda item: (len(item.claims), both[item.name]))
    yield sorted(items, key=lambda item: (-sizes[item.name][1], -sizes[item.name][0]))
    random = Random(0)  # noqa: S311  # no secret: the same orders for the same partitions
    for _ in range(RANDOM_ORDERS):
        weight, spread = random.random(), random.choice((0.1, 0.3, 0.6))
        shares = {
            name: (weight * cost / percent + (1 - weight) * ram / memory) * random.uniform(1 - spread, 1 + spread)
            for name, (cost, ram) in sizes.items()
        }
        yield sorted(items, key=lambda item: -shares[item.name])  # sorted before the next round


def exceeds_capacity(items: Sequence[Item], bins: Sequence[Bin]) -> bool:
    """Say whether all hosts together are too small for the least that the partitions claim.

    Args:
        items: the partitions, each with at least one claim.

    Returns:
        True: no packing, in processors or in memory. False says nothing.
    """
    free = [free_in(host) for host in bins]
    percent, memory = sum(max(0, load.percent) for load in free), sum(max(0, load.memory) for load in free)
    return sum(map(least_cost, items)) > percent or sum(map(least_memory, items)) > memory


def lower_bound(items: Sequence[Item], bins: Sequence[Bin]) -> Objective:
    """Return the reservation with each partition where it reserves least, and the moves that nothing avoids.

    A host keeps at most so many of the partitions that are on it as it has room for with the smallest first, in
    processors and in memory; all others that run have to move.

    Args:
        items: the partitions, each with at least one claim.

    Returns:
        No packing has less of either; a packing that meets both is optimal.
    """
    running = [item for item in items if item.current_host]
    moves = len(running)
    for host in bins:
        staying = [item for item in running if item.current_host == host.name and host.name in item.claims]
        claims = [item.claims[host.name] for item in staying]
        free = free_in(host)
        moves -= min(
            _number_that_fits((claim.percent for claim in claims), free.percent),
            _number_that_fits((claim.memory for claim in claims), free.memory),
        )
    return sum(map(least_cost, items)), moves


def _number_that_fits(sizes: Iterable[int], room: int) -> int:
    return sum(total <= room for total in accumulate(sorted(sizes)))
