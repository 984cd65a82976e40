"""What is packed, onto what, and the answer."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from rarms_iac.model.capacity import Capacity, decide_fit
from rarms_iac.model.claims import WHOLE, Claim, Load, load_of
from rarms_iac.model.layout import Placement


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """A partition that needs a host."""

    name: str
    claims: Mapping[str, Claim]  # what it claims on each host that it may run on, by the host's name
    current_host: str = ""  # that it is on; empty: none


@dataclass(frozen=True, slots=True, kw_only=True)
class Bin:
    """A host."""

    name: str
    capacity: Capacity
    foreign_claims: tuple[Claim, ...] = ()  # what is promised there to machines that are not packed


@dataclass(frozen=True, slots=True, kw_only=True)
class Packing:
    """A host for each partition, and how good that is."""

    host_of: Mapping[str, str]  # by the partition's name
    placement: Placement


@dataclass(frozen=True, slots=True, kw_only=True)
class NoPacking:
    """No packing was found."""

    proven: bool  # there is none
    undecided: bool = False  # a host was refused claims of which it is not known that it cannot keep them


def least_cost(item: Item) -> int:
    """Return the partition's least reservation on any host, in per cent of one logical processor.

    Args:
        item: a partition with at least one claim.

    Returns:
        The least over the hosts that it may run on.
    """
    return min(claim.percent for claim in item.claims.values())


def least_memory(item: Item) -> int:
    """Return the memory that the partition claims where it claims least, in bytes.

    Args:
        item: a partition with at least one claim.

    Returns:
        The least over the hosts that it may run on.
    """
    return min(claim.memory for claim in item.claims.values())


def free_in(host: Bin) -> Load:
    """Return the free capacity of a host; negative where others hold more than there is.

    Args:
        host: with what unmanaged machines claim there.

    Returns:
        Per cent of one logical processor, and bytes.
    """
    foreign = load_of(host.foreign_claims)
    whole = int(WHOLE * host.capacity.processors)
    return Load(percent=whole - foreign.percent, memory=host.capacity.memory - foreign.memory)


def free_on(bins: Iterable[Bin]) -> Load:
    """Add up what hosts have left to promise; where too much is promised on one, the others do not make up for it.

    Returns:
        Per cent of one logical processor, and bytes.
    """
    free = [free_in(host) for host in bins]
    return Load(percent=sum(max(0, load.percent) for load in free), memory=sum(max(0, load.memory) for load in free))


def claims_by_host(items: Iterable[Item], bins: Sequence[Bin], host_of: Mapping[str, str]) -> dict[str, list[Claim]]:
    """Return all that each host would have to promise, other machines included.

    Args:
        host_of: the host of each partition, by names.

    Returns:
        By the name of every host, unmanaged machines first.
    """
    claims = {host.name: list(host.foreign_claims) for host in bins}
    for item in items:
        claims[host_of[item.name]].append(item.claims[host_of[item.name]])
    return claims


def hosts_can_hold(items: Sequence[Item], bins: Sequence[Bin], host_of: Mapping[str, str]) -> bool | None:
    """Check that every host that is used can keep its promises; None: of some host it is not known.

    Args:
        host_of: The host of each partition, by names.

    Returns:
        True, False, or None where the search for virtual processors' places gave up on a host and no other refuses.
    """
    claims, used = claims_by_host(items, bins, host_of), set(host_of.values())
    answers = [decide_fit(host.capacity, claims[host.name]) for host in bins if host.name in used]
    if False in answers:
        return False
    return None if None in answers else True


Objective = tuple[int, int]
"""What is made least: the reservation in all, in per cent of one logical processor; then how many partitions move."""


def objective_of(items: Iterable[Item], host_of: Mapping[str, str]) -> Objective:
    """Return the packing's total reservation and the number of partitions that it moves.

    Returns:
        Per cent of one logical processor, and a count.
    """
    reserved = moves = 0
    for item in items:
        host = host_of[item.name]
        reserved += item.claims[host].percent
        moves += is_move(item, host)
    return reserved, moves


def is_move(item: Item, host: str) -> bool:
    """Tell whether the partition would leave the host that it is on.

    Returns:
        False for a partition that is nowhere yet.
    """
    return item.current_host not in ("", host)
