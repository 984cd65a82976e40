"""Who gets what nobody reserved: limit and weight of a partition, with the reasons (DESIGN section 3).

A reservation is what was measured and stays what it is. What is left over is handed out by the hypervisor, to whoever
asks, by weight: so the policy decides weights, and what one component needs never moves the share of another.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import assert_never

from rarms_iac.model.quantities import CpuAmount, LogicalProcessors, in_processors, per_virtual_processor
from rarms_iac.model.system import Component, Headroom, Host, PartitionRequest

WEIGHT = 100
"""What was measured with: a lower weight could falsify it."""

MAX_WEIGHT = 10_000
LAST = 1
"""The weight of who is handed nothing: it has what everybody else leaves."""

OPEN = 100
"""A limit that caps nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rank:
    """Where a criticality stands among all those of the manifest: 1 is the least."""

    place: int = 1
    of: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Share:
    """What a partition may take of what is left over, and why."""

    limit: int  # per cent of each of its virtual processors
    weight: int
    why_limit: str
    why_weight: str


def ranks_of(components: Iterable[Component]) -> Mapping[int, Rank]:
    """Rank the criticalities of the manifest.

    Args:
        components: all that run in partitions, whatever partitions these are: combining some must not move another's
            weight.

    Returns:
        A rank for each criticality; 1 is the least critical.
    """
    values = sorted({component.criticality for component in components})
    return {value: Rank(place=at, of=len(values)) for at, value in enumerate(values, 1)}


def weight_of_rank(rank: Rank) -> int:
    """Give a rank its weight: one hundred a rank, so that weights have the order of criticalities.

    Args:
        rank: as `ranks_of` returns it.

    Returns:
        100 to 10000. Beyond a hundred criticalities the steps are smaller; beyond 9901 all weights are equal.
    """
    step = min(WEIGHT, (MAX_WEIGHT - WEIGHT) // max(1, rank.of - 1))
    return min(MAX_WEIGHT, WEIGHT + step * (rank.place - 1))


@dataclass(frozen=True, slots=True, kw_only=True)
class PartitionShare:
    """A partition as the policy looks at it."""

    members: tuple[Component, ...]
    request: PartitionRequest
    headroom: Headroom
    rank: Rank  # of its criticality

    @property
    def is_promised(self) -> bool:
        """Whether a member has an APT, so that neither a cap nor a low weight may falsify what was measured."""
        return any(member.apt for member in self.members)


def share_of(asking: PartitionShare, host: Host, processors: int, reserve: int) -> Share:
    """Decide limit and weight of a partition by the manifest and its headroom policy.

    Args:
        asking: the partition's members, requests and policy.
        host: where it would be; shares of a host are of its logical processors.
        processors: its virtual processors.
        reserve: its reservation, in whole per cent of each of them.

    Returns:
        Limit (never below the reservation) and weight, each with the reason in words.
    """
    limit, why_limit = _limit(asking, host, processors, reserve)
    weight, why_weight = _weight(asking)
    return Share(limit=limit, weight=weight, why_limit=why_limit, why_weight=why_weight)


def _limit(asking: PartitionShare, host: Host, processors: int, reserve: int) -> tuple[int, str]:
    said = said_limit(asking, host, processors)
    if said is not None:
        if said < reserve:
            return reserve, "the manifest fixes less than is reserved: a limit below the reservation would break it"
        return said, "the manifest fixes it"
    if asking.headroom is Headroom.NONE and not asking.is_promised and reserve:
        return reserve, "policy.headroom is none, and no APT was measured that a cap could falsify"
    why = "a cap would falsify what was measured" if asking.is_promised else "nobody asks for a cap"
    return OPEN, f"left open: {why}"


def said_limit(asking: PartitionShare, host: Host, processors: int) -> int | None:
    """Return the limit that the manifest fixes: the partition's own, or the sum of its members' where each has one.

    Args:
        asking: the partition's members and requests.
        host: shares of a host are of its logical processors.
        processors: the partition's virtual processors.

    Returns:
        Whole per cent of each virtual processor, at most 100, rounded up; None: the manifest fixes none.
    """
    own = asking.request.cpu.limit
    amounts: list[CpuAmount | None] = [own] if own is not None else [member.cpu.limit for member in asking.members]
    total = Fraction(0)
    for amount in amounts:
        if amount is None:
            return None
        total += in_processors(amount, host.logical_processors)
    return min(OPEN, per_virtual_processor(LogicalProcessors(total), processors))


def _weight(asking: PartitionShare) -> tuple[int, str]:
    """Its own, or the highest of its members'; a member that says nothing wants what the policy gives."""
    if asking.request.cpu.weight is not None:
        return asking.request.cpu.weight, "the manifest fixes it for the partition"
    given, why = _given(asking)
    said = [(member.cpu.weight, member.name) for member in asking.members if member.cpu.weight is not None]
    if len(said) == len(asking.members) or any(weight > given for weight, _ in said):
        weight, name = max(said, key=lambda pair: (pair[0], pair[1]))
        return weight, f"the manifest fixes it for {name}"
    return given, why


def _given(asking: PartitionShare) -> tuple[int, str]:
    match asking.headroom:
        case Headroom.BY_CRITICALITY:
            rank = asking.rank
            if rank.of == 1:
                return WEIGHT, "policy.headroom is by_criticality, and all are equally critical"
            return weight_of_rank(rank), (
                f"policy.headroom is by_criticality: criticality {rank.place} of {rank.of}, the least first"
            )
        case Headroom.EQUAL:
            return WEIGHT, "policy.headroom is equal: the same for everybody"
        case Headroom.NONE:
            if asking.is_promised:
                return WEIGHT, "policy.headroom is none; not less than it was measured with"
            return LAST, "policy.headroom is none, and no APT was measured that a low weight could falsify"
        case _:
            assert_never(asking.headroom)
