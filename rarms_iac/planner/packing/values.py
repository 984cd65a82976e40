"""What is packed, onto what, and the answer."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from rarms_iac.model.capacity import Capacity, holds
from rarms_iac.model.claims import WHOLE, Claim, Load, load_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """A partition that needs a host."""

    name: str
    claims: Mapping[str, Claim]  # what it claims on each host that it may run on, by the host's name
    now: str = ""  # the host that it is on; empty: none


@dataclass(frozen=True, slots=True, kw_only=True)
class Bin:
    """A host."""

    name: str
    capacity: Capacity
    taken: tuple[Claim, ...] = ()  # what is promised there to machines that are not packed


@dataclass(frozen=True, slots=True, kw_only=True)
class Packing:
    """A host for each partition, with what no packing is below."""

    hosts: Mapping[str, str]  # partition -> host, by the partition's name
    reserved: int  # in all, in per cent of one logical processor
    reserved_bound: int  # no packing reserves less
    moves: int
    moves_bound: int  # no packing that reserves at most as much moves fewer

    @property
    def proven(self) -> bool:
        """Whether no packing is better."""
        return (self.reserved, self.moves) == (self.reserved_bound, self.moves_bound)


@dataclass(frozen=True, slots=True, kw_only=True)
class NoPacking:
    """No packing was found."""

    proven: bool  # there is none


def cost(claim: Claim) -> int:
    """Return the reservation in per cent of one logical processor."""
    return claim.processors * claim.reserve


def least_cost(item: Item) -> int:
    """Return what the partition reserves where it reserves least, in per cent of one logical processor."""
    return min(cost(claim) for claim in item.claims.values())


def least_memory(item: Item) -> int:
    """Return the memory that the partition claims where it claims least, in bytes."""
    return min(claim.memory for claim in item.claims.values())


def free_in(host: Bin) -> Load:
    """Return what a host has left to promise; negative where others hold more than there is."""
    taken = load_of(host.taken)
    whole = int(WHOLE * host.capacity.processors)
    return Load(percent=whole - taken.percent, memory=host.capacity.memory - taken.memory)


def claims_by_host(items: Iterable[Item], bins: Sequence[Bin], hosts: Mapping[str, str]) -> dict[str, list[Claim]]:
    """Return all that each host would have to promise, other machines included."""
    claims = {host.name: list(host.taken) for host in bins}
    for item in items:
        claims[hosts[item.name]].append(item.claims[hosts[item.name]])
    return claims


def all_hold(items: Sequence[Item], bins: Sequence[Bin], hosts: Mapping[str, str]) -> bool | None:
    """Check that every host that is used can keep its promises; None: of some host it is not known."""
    claims, used = claims_by_host(items, bins, hosts), set(hosts.values())
    answers = [holds(host.capacity, claims[host.name]) for host in bins if host.name in used]
    if False in answers:
        return False
    return None if None in answers else True


def value_of(items: Iterable[Item], hosts: Mapping[str, str]) -> tuple[int, int]:
    """Return what the packing reserves in all, in per cent of one logical processor, and how many partitions move."""
    reserved = moves = 0
    for item in items:
        host = hosts[item.name]
        reserved += cost(item.claims[host])
        moves += bool(item.now) and item.now != host
    return reserved, moves
