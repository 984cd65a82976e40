"""What no packing can be below, by sums alone."""

from collections.abc import Iterable, Sequence
from itertools import accumulate

from rarms_iac.planner.packing.values import Bin, Item, Objective, free_in, least_cost, least_memory


def exceeds_capacity(items: Sequence[Item], bins: Sequence[Bin]) -> bool:
    """Say whether all hosts together are too small for the least that the partitions claim.

    Args:
        items: the partitions, each with at least one claim.
        bins: all hosts.

    Returns:
        True: there is no packing, in processors or in memory. False says nothing.
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
        bins: all hosts.

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
