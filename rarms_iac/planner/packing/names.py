"""Of packings that are equally good the first by name, so that equal inputs have equal answers whoever found them."""

from collections.abc import Sequence

from rarms_iac.model.capacity import Effort, holds
from rarms_iac.model.claims import Claim
from rarms_iac.planner.packing.values import Bin, Item, Objective, is_move, least_cost

TRIED = 4_000
"""Hosts that are tried for a partition, in all: a count, never a time."""

STEPS = 20_000
"""Steps in which places for virtual processors are searched for, in all."""


def first_by_name(items: Sequence[Item], bins: Sequence[Bin], best: Objective) -> dict[str, str] | None:
    """Find the best packing in which the first partition is on the first host that it can be on, and so on.

    Args:
        items: The partitions, by name.
        bins: The hosts, by name.
        best: The objective of a packing that no other is better than.

    Returns:
        The host of each partition; None where no packing was found in `TRIED` steps.
    """
    least = [0] * (len(items) + 1)  # what the partitions from this number on reserve at least
    for number in reversed(range(len(items))):
        least[number] = least[number + 1] + least_cost(items[number])
    tried = 0
    claims: dict[str, list[Claim]] = {host.name: list(host.foreign_claims) for host in bins}
    capacities = {host.name: host.capacity for host in bins}
    effort = Effort(STEPS)
    host_of: dict[str, str] = {}

    def place_from(number: int, reserved: int, moves: int) -> bool:
        nonlocal tried
        if reserved + least[number] > best[0] or moves > best[1]:
            return False
        if number == len(items):
            return True
        item = items[number]
        for name, claim in sorted(item.claims.items()):
            tried += 1
            if tried > TRIED:
                return False
            claims[name].append(claim)
            if holds(capacities[name], claims[name], effort):
                host_of[item.name] = name
                if place_from(number + 1, reserved + claim.percent, moves + is_move(item, name)):
                    return True
                del host_of[item.name]
            claims[name].pop()
        return False

    return dict(host_of) if place_from(0, 0, 0) else None
