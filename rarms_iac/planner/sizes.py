"""Sizes of partitions on a host: processors, reserve, limit, weight and memory, rounded up to its provider's grain.

The reservation is the measured one. The hypervisor gives the processor time that is not reserved to all partitions that
ask, by weight. So the policy decides weights and limits, and the need of one component never moves another's share.
"""

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from math import ceil
from typing import assert_never

from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.experiment import ProcessorSource, processor_number
from rarms_iac.model.host import Host, HypervHost, Mechanism, ProviderKind
from rarms_iac.model.layout import Making, PlacedPartition
from rarms_iac.model.quantities import (
    CpuAmount,
    LogicalProcessors,
    ProcessorTime,
    in_processors,
    machine_memory,
    per_virtual_processor,
)
from rarms_iac.model.state import NO_GENERATION, Checkpoints, PartitionSettings, StartAction, Starting, StopAction
from rarms_iac.model.system import (
    MOST_WEIGHT,
    USUAL_WEIGHT,
    Headroom,
    Measured,
    StartMode,
    System,
    weight_of_criticality,
)
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.mechanism import mechanism_of, quota_period_us, shortest_apt_ms
from rarms_iac.planner.reservations import FixedReservations, ReservationSource
from rarms_iac.planner.verdicts import NotMeasured
from rarms_iac.texts.findings import UNUSABLE_RESERVE
from rarms_iac.texts.quantities import count_processors

LAST = 1
"""The weight of a partition that gets no headroom but what all others leave."""

OPEN = 100
"""A limit that caps nothing."""


def limit_of(group: Group, host: Host, processors: int, reserve: int) -> tuple[int, str]:
    """Decide the limit of a partition by the manifest and its headroom policy.

    Args:
        group: the partition's members, requests and policy.
        host: where it would be; shares of a host are of its logical processors.
        reserve: its reservation, in whole per cent of each of them.

    Returns:
        Whole per cent of each virtual processor, never below the reservation, and the reason in words.
    """
    fixed = limit_in_manifest(group, host, processors)
    if fixed is not None:
        if fixed < reserve:
            return reserve, "the fixed limit is below the reservation, so it is raised to the reservation"
        return fixed, "fixed in the manifest"
    if reserve and mechanism_of(group, host)[0] is Mechanism.QUOTA:
        return reserve, "the mechanism is quota, which limits it to its reservation"
    if group.headroom is Headroom.NONE and not group.has_apt and reserve:
        return reserve, "policy.headroom is none, and it has no measured APT that a limit would change"
    why = "a limit would make its measurements invalid" if group.has_apt else "no limit is set"
    return OPEN, f"no limit: {why}"


def limit_in_manifest(group: Group, host: Host, processors: int) -> int | None:
    """Return the limit that the manifest fixes: the partition's own, or the sum of its members' where each has one.

    Args:
        group: the partition's members and requests.
        host: shares of a host are of its logical processors.

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
        host: on Linux no partition has a weight apart from the reservation.

    Returns:
        The weight, 1 to 10000, and the reason in words.
    """
    if host.provider is ProviderKind.LINUX:
        return USUAL_WEIGHT, "Linux shares what is not reserved in proportion to the reservations"
    if group.request.cpu.weight is not None:
        return group.request.cpu.weight, "fixed in the manifest for the partition"
    given, why = _weight_of_policy(group)
    fixed = [(member.cpu.weight, member.name) for member in group.members if member.cpu.weight is not None]
    if len(fixed) == len(group.members) or any(weight > given for weight, _ in fixed):
        weight, name = max(fixed, key=lambda pair: (pair[0], pair[1]))
        return weight, f"fixed in the manifest for {name}"
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
                return USUAL_WEIGHT, "policy.headroom is none; the weight of its measurements"
            return LAST, "policy.headroom is none, and it has no measured APT that a low weight would change"
        case _:
            assert_never(group.headroom)


def size(group: Group, host: Host, reservations: ReservationSource) -> PlacedPartition | Diagnostic:
    """Work out a partition's settings on one host.

    Args:
        host: the host; what else is placed there does not matter.

    Returns:
        The partition with its reserve rounded up to whole per cent of each virtual processor; or the cause why it
            cannot be there even alone: nothing measured, too few virtual processors, or more of them than the
            host has.
    """
    wanted = wanted_reserve(group, host, reservations)
    if isinstance(wanted, NotMeasured):
        return wanted.why
    processors = _processors(group, host, reservations)
    reserve = per_virtual_processor(wanted, processors)
    starting = starting_of(group, host)
    largest = wanted if starting is None else max(wanted, starting.reserve)
    if cause := _cannot_be_alone(group, host, largest, processors):
        return cause
    limit, why_limit = limit_of(group, host, processors, reserve)
    weight, why_weight = weight_of(group, host)
    memory = sum(member.memory for member in group.members) if group.request.memory is None else group.request.memory
    by_itself = group.request.start is StartMode.AUTOMATIC
    return PlacedPartition(
        host=host.name,
        components=tuple(member.name for member in group.members),
        criticality=group.criticality,
        settings=PartitionSettings(
            name=group.name,
            generation=_generation(group, host),
            processors=processors,
            reserve=reserve,
            limit=limit,
            weight=weight,
            memory=memory if host.provider is ProviderKind.LINUX else machine_memory(memory),
            dynamic_memory=False,
            start_action=StartAction.START if by_itself else StartAction.NOTHING,
            stop_action=StopAction.SHUT_DOWN,
            checkpoints=Checkpoints.DISABLED,
            running=by_itself,
            secure_boot=_secure_boot(group, host),
            quota_period_us=_quota_period(group, host, limit, processors),
        ),
        making=_making(group, host),
        why_limit=why_limit,
        why_weight=why_weight,
        mechanism=mechanism_of(group, host)[1] if reserve else "",
    )


def size_without_reserve(group: Group, host: Host) -> PlacedPartition | Diagnostic:
    """Work out what else a partition gets on a host, where its reservation is not known yet.

    Returns:
        As `size`, with nothing reserved.
    """
    nothing = ProcessorTime(LogicalProcessors(Fraction(0)))
    cpu = replace(group.request.cpu, reserve=nothing)
    return size(replace(group, request=replace(group.request, cpu=cpu)), host, FixedReservations())


def _cannot_be_alone(group: Group, host: Host, wanted: LogicalProcessors, processors: int) -> Diagnostic | None:
    """Return the reason why a partition of so many LPs and virtual processors does not fit an empty host."""
    reserve, width = per_virtual_processor(wanted, processors), count_processors(processors, host)
    if reserve > 100:
        return UNUSABLE_RESERVE.at(
            None,
            "{partition} reserves {needs:lp}, but has only {_width}. It needs at least {_least}.",
            "Give the partition or the component more `processors`, or lower the reserve.",
            address=f"partition/{group.name}",
            partition=group.name,
            needs=wanted,
            processors=processors,
            _width=width,
            _least=-(-wanted.numerator // wanted.denominator),
        )
    if reserve and processors > host.logical_processors:
        return UNUSABLE_RESERVE.at(
            None,
            "{partition} needs {_width}; {host} has {has_lp}.",
            "Lower `processors`, or allow a larger host.",
            address=f"partition/{group.name}",
            partition=group.name,
            host=host.name,
            processors=processors,
            has_lp=host.logical_processors,
            _width=width,
        )
    return None


def wanted_reserve(group: Group, host: Host, reservations: ReservationSource) -> LogicalProcessors | NotMeasured:
    """Return a partition's wanted reservation on a host, before it is rounded."""
    own = group.request.cpu.reserve
    if not (isinstance(own, Measured) or own is None):
        return in_processors(own, host.logical_processors)
    answer = reservations.look_up(group.members, host)
    return answer if isinstance(answer, NotMeasured) else answer.reservation


def _processors(group: Group, host: Host, reservations: ReservationSource) -> int:
    """Return the manifest's number, else the measured one, else the host's."""
    found = processor_number(group.members, group.request.processors, host.logical_processors)
    if found.source is ProcessorSource.MANIFEST:
        return found.number
    answer = reservations.look_up(group.members, host)
    return found.number if isinstance(answer, NotMeasured) else answer.processors or found.number


def _quota_period(group: Group, host: Host, limit: int, processors: int) -> int:
    """Return the period of a Linux quota; every limit below the whole host is a quota."""
    if host.provider is not ProviderKind.LINUX or (limit == OPEN and processors >= host.logical_processors):
        return 0
    return quota_period_us(shortest_apt_ms(group), limit * processors)


def _generation(group: Group, host: Host) -> int:
    if host.provider is ProviderKind.LINUX:
        return NO_GENERATION
    own = group.request.hyperv.generation
    if own is not None:
        return own
    return host.settings.generation if isinstance(host.settings, HypervHost) else 2


def _making(group: Group, host: Host) -> Making:
    usual = host.settings if isinstance(host.settings, HypervHost) else HypervHost()
    own = group.request.hyperv
    return Making(
        image=own.image or usual.image or "",
        switch=own.switch or usual.switch or "",
        vm_path=own.vm_path or usual.vm_path or "",
    )


def _secure_boot(group: Group, host: Host) -> str:
    usual = host.settings.secure_boot if isinstance(host.settings, HypervHost) else None
    return (group.request.hyperv.secure_boot or usual or "") if _generation(group, host) == 2 else ""


def starting_of(group: Group, host: Host) -> Starting | None:
    """Return what a partition reserves while it starts: its own, or the sum of its members' for the longest time.

    Args:
        host: Shares of a host are of its logical processors.

    Returns:
        None where neither the partition nor a member says it.
    """
    own = group.request.cpu.starting
    requests = [own] if own is not None else [each.cpu.starting for each in group.members if each.cpu.starting]
    if not requests:
        return None
    total = sum((in_processors(each.reserve, host.logical_processors) for each in requests), Fraction(0))
    return Starting(reserve=LogicalProcessors(total), time_ms=max(ceil(each.time) for each in requests))


def starting_partitions(system: System, host: Host) -> Mapping[str, Starting]:
    """Return by partition what it reserves on a host while it starts; those that start with no more are left out."""
    found = {group.name: starting_of(group, host) for group in groups_of(system)}
    return {name: starting for name, starting in found.items() if starting is not None}
