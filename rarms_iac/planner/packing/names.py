"""Of packings that are equally good the first by name, so that equal inputs have equal answers whoever found them."""

from collections.abc import Sequence

from rarms_iac.model.capacity import Effort, holds
from rarms_iac.model.claims import Claim
from rarms_iac.planner.packing.values import Bin, Item, cost, least_cost

TRIED = 4_000
"""Hosts that are tried for a partition, in all: a count, never a time."""

STEPS = 20_000
"""Steps in which places for virtual processors are searched for, in all."""


def first_by_name(items: Sequence[Item], bins: Sequence[Bin], value: tuple[int, int]) -> dict[str, str] | None:
    """Find the packing of this value in which the first partition is on the first host that it can be on, and so on.

    Args:
        items: The partitions, by name.
        bins: The hosts, by name.
        value: Reservation and moves of a packing that nothing is better than.

    Returns:
        The packing; None where it was not found in `TRIED` steps.
    """
    least = [0] * (len(items) + 1)
    for number in reversed(range(len(items))):
        least[number] = least[number + 1] + least_cost(items[number])
    tried = 0
    claims: dict[str, list[Claim]] = {host.name: list(host.taken) for host in bins}
    capacities = {host.name: host.capacity for host in bins}
    effort = Effort(STEPS)
    hosts: dict[str, str] = {}

    def down(number: int, reserved: int, moves: int) -> bool:
        nonlocal tried
        if reserved + least[number] > value[0] or moves > value[1]:
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
                hosts[item.name] = name
                if down(number + 1, reserved + cost(claim), moves + (item.now not in ("", name))):
                    return True
                del hosts[item.name]
            claims[name].pop()
        return False

    return dict(hosts) if down(0, 0, 0) else None
