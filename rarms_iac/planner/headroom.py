"""Headroom, the processor time that nobody reserved: limit and weight of a partition, with reasons.

A reservation is what was measured and stays what it is. What is left over is handed out by the hypervisor, to whoever
asks, by weight: so the policy decides weights, and what one component needs never moves the share of another.
"""

from fractions import Fraction
from typing import assert_never

from rarms_iac.model.host import Host, LinuxHost, Mechanism, ProviderKind
from rarms_iac.model.indexes import index_named
from rarms_iac.model.quantities import CpuAmount, LogicalProcessors, Unit, in_processors, per_virtual_processor
from rarms_iac.model.system import AtMost, Headroom
from rarms_iac.planner.groups import Group, Rank

WEIGHT = 100
"""The weight that components are measured with: in service, a lower one could falsify that."""

MAX_WEIGHT = 10_000
LAST = 1
"""The weight of a partition that gets no headroom but what all others leave."""

LEAST_QUOTA_US = 1_000
LONGEST_PERIOD_US, SHORTEST_PERIOD_US = 100_000, 1_000
"""The kernel takes no smaller quota than 1 ms; we take no period outside 1 to 100 ms, its own default."""

OPEN = 100
"""A limit that caps nothing."""


def weight_of_rank(rank: Rank) -> int:
    """Give a rank its weight: one hundred a rank, so that weights have the order of criticalities.

    Args:
        rank: as `ranks_of` returns it.

    Returns:
        100 to 10000. Beyond a hundred criticalities the steps are smaller; beyond 9901 all weights are equal.
    """
    step = min(WEIGHT, (MAX_WEIGHT - WEIGHT) // max(1, rank.of - 1))
    return min(MAX_WEIGHT, WEIGHT + step * (rank.place - 1))


def limit_of(group: Group, host: Host, processors: int, reserve: int) -> tuple[int, str]:
    """Decide the limit of a partition by the manifest and its headroom policy.

    Args:
        group: the partition's members, requests and policy.
        host: where it would be; shares of a host are of its logical processors.
        processors: its virtual processors.
        reserve: its reservation, in whole per cent of each of them.

    Returns:
        Whole per cent of each virtual processor, never below the reservation, and the reason in words.
    """
    fixed = limit_in_manifest(group, host, processors)
    if fixed is not None:
        if fixed < reserve:
            return reserve, "the manifest fixes less than is reserved: a limit below the reservation would break it"
        return fixed, "the manifest fixes it"
    if reserve and mechanism_of(group, host) is Mechanism.QUOTA:
        return reserve, "the mechanism is quota: it gets what it reserves and no more"
    if group.headroom is Headroom.NONE and not group.has_apt and reserve:
        return reserve, "policy.headroom is none, and no APT was measured that a cap could falsify"
    why = "a cap would falsify what was measured" if group.has_apt else "nobody asks for a cap"
    return OPEN, f"left open: {why}"


def limit_in_manifest(group: Group, host: Host, processors: int) -> int | None:
    """Return the limit that the manifest fixes: the partition's own, or the sum of its members' where each has one.

    Args:
        group: the partition's members and requests.
        host: shares of a host are of its logical processors.
        processors: the partition's virtual processors.

    Returns:
        Whole per cent of each virtual processor, at most 100, rounded up; None: the manifest fixes none.
    """
    own = group.request.cpu.limit
    amounts: list[CpuAmount | None] = [own] if own is not None else [member.cpu.limit for member in group.members]
    total = Fraction(0)
    for amount in amounts:
        if amount is None:
            return None
        total += in_processors(amount, host.logical_processors)
    return min(OPEN, per_virtual_processor(LogicalProcessors(total), processors))


def mechanism_of(group: Group, host: Host) -> Mechanism:
    """Return how a Linux host keeps the reservation of a partition.

    Args:
        group: its own request counts first.
        host: where it would be; of another provider, it has nothing to choose.

    Returns:
        Never `automatic`: that is a share, with which processors that are idle serve everybody.
    """
    usual = host.settings.mechanism if isinstance(host.settings, LinuxHost) else Mechanism.SHARE
    chosen = group.request.mechanism or usual
    return Mechanism.QUOTA if chosen is Mechanism.QUOTA and host.provider is ProviderKind.LINUX else Mechanism.SHARE


def shortest_apt_ms(group: Group) -> float | None:
    """Find the shortest response time that a partition promises.

    Args:
        group: its members' thresholds count.

    Returns:
        Milliseconds; None: it promises none.
    """
    return min(
        (
            float(threshold.value)
            for member in group.members
            for name, threshold in member.apt.items()
            if isinstance(threshold, AtMost) and index_named(name).unit is Unit.TIME
        ),
        default=None,
    )


def quota_period_us(apt_ms: float | None, quota_percent: int) -> int:
    """Return how often a quota is counted anew: ten times within a threshold, within what the kernel takes.

    With the kernel's own 100 ms, a response time is a staircase: who used up the quota waits for the next period.

    Args:
        apt_ms: the shortest response time that is promised; None: none is.
        quota_percent: of one logical processor, above 0.

    Returns:
        Microseconds, 1,000 to 100,000; more where the quota would be less than the kernel's 1,000.
    """
    wanted = LONGEST_PERIOD_US if apt_ms is None else round(apt_ms * 100)
    period = min(max(wanted, SHORTEST_PERIOD_US), LONGEST_PERIOD_US)
    return max(period, -(-LEAST_QUOTA_US * 100 // max(1, quota_percent)))


def weight_of(group: Group, host: Host) -> tuple[int, str]:
    """Decide the weight of a partition: its own, or the highest of its members'.

    Args:
        group: the partition's members, requests and policy; a member without a weight has the one of the policy.
        host: on Linux nobody has a weight beside the reservation.

    Returns:
        The weight, 1 to 10000, and the reason in words.
    """
    if host.provider is ProviderKind.LINUX:
        return WEIGHT, "Linux shares what nobody reserved in proportion to the reservations"
    if group.request.cpu.weight is not None:
        return group.request.cpu.weight, "the manifest fixes it for the partition"
    given, why = _weight_of_policy(group)
    fixed = [(member.cpu.weight, member.name) for member in group.members if member.cpu.weight is not None]
    if len(fixed) == len(group.members) or any(weight > given for weight, _ in fixed):
        weight, name = max(fixed, key=lambda pair: (pair[0], pair[1]))
        return weight, f"the manifest fixes it for {name}"
    return given, why


def _weight_of_policy(group: Group) -> tuple[int, str]:
    match group.headroom:
        case Headroom.BY_CRITICALITY:
            rank = group.rank
            if rank.of == 1:
                return WEIGHT, "policy.headroom is by_criticality, and all are equally critical"
            return weight_of_rank(rank), (
                f"policy.headroom is by_criticality: criticality {rank.place} of {rank.of}, the least first"
            )
        case Headroom.EQUAL:
            return WEIGHT, "policy.headroom is equal: the same for everybody"
        case Headroom.NONE:
            if group.has_apt:
                return WEIGHT, "policy.headroom is none; not less than it was measured with"
            return LAST, "policy.headroom is none, and no APT was measured that a low weight could falsify"
        case _:
            assert_never(group.headroom)
