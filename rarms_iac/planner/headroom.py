"""Headroom, the processor time that is not reserved: limit and weight of a partition, with reasons.

A reservation is what was measured and stays what it is. What is left over is handed out by the hypervisor, to all who
asks, by weight: so the policy decides weights, and what one component needs never moves the share of another.
"""

from fractions import Fraction
from typing import assert_never

from rarms_iac.model.host import Host, Mechanism, ProviderKind
from rarms_iac.model.quantities import CpuAmount, LogicalProcessors, in_processors, per_virtual_processor
from rarms_iac.model.system import MOST_WEIGHT, USUAL_WEIGHT, Headroom, weight_of_criticality
from rarms_iac.planner.groups import Group
from rarms_iac.planner.mechanism import mechanism_of

LAST = 1
"""The weight of a partition that gets no headroom but what all others leave."""

OPEN = 100
"""A limit that caps nothing."""


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
    if reserve and mechanism_of(group, host)[0] is Mechanism.QUOTA:
        return reserve, "the mechanism is quota: it gets what it reserves and no more"
    if group.headroom is Headroom.NONE and not group.has_apt and reserve:
        return reserve, "policy.headroom is none, and no APT was measured that a cap could falsify"
    why = "a cap would falsify what was measured" if group.has_apt else "no cap is asked for"
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


def weight_of(group: Group, host: Host) -> tuple[int, str]:
    """Decide the weight of a partition: its own, or the highest of its members'.

    Args:
        group: the partition's members, requests and policy; a member without a weight has the one of the policy.
        host: on Linux no partition has a weight beside the reservation.

    Returns:
        The weight, 1 to 10000, and the reason in words.
    """
    if host.provider is ProviderKind.LINUX:
        return USUAL_WEIGHT, "Linux shares what is not reserved in proportion to the reservations"
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
            whose = " of its most critical member" if len(group.members) > 1 else ""
            why = f"policy.headroom is by_criticality: {USUAL_WEIGHT} times the criticality {group.criticality}{whose}"
            return weight_of_criticality(group.criticality), f"{why}, within {USUAL_WEIGHT} to {MOST_WEIGHT}"
        case Headroom.EQUAL:
            return USUAL_WEIGHT, "policy.headroom is equal: the same for all"
        case Headroom.NONE:
            if group.has_apt:
                return USUAL_WEIGHT, "policy.headroom is none; not less than it was measured with"
            return LAST, "policy.headroom is none, and no APT was measured that a low weight could falsify"
        case _:
            assert_never(group.headroom)
