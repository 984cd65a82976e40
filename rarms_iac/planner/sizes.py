"""Sizes of partitions on a host: processors, reserve, limit, weight and memory, rounded up to its provider's grain."""

from dataclasses import replace
from fractions import Fraction

from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import Host, HypervHost, ProviderKind
from rarms_iac.model.layout import Making, PlacedPartition
from rarms_iac.model.processor_number import ProcessorSource, processor_number
from rarms_iac.model.quantities import (
    LogicalProcessors,
    ProcessorTime,
    in_processors,
    machine_memory,
    per_virtual_processor,
)
from rarms_iac.model.shared_findings import UNUSABLE_RESERVE
from rarms_iac.model.state import NO_GENERATION, Checkpoints, PartitionSettings, StartAction, StopAction
from rarms_iac.model.system import Measured, StartMode
from rarms_iac.model.wording import counted
from rarms_iac.planner.groups import Group
from rarms_iac.planner.headroom import OPEN, limit_of, weight_of
from rarms_iac.planner.measured_together import NotMeasured
from rarms_iac.planner.mechanism import mechanism_of, quota_period_us, shortest_apt_ms
from rarms_iac.planner.reservations import FixedReservations, ReservationSource


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
    if cause := _cannot_be_alone(group, host, wanted, processors):
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
    """Why a partition that wants so many LPs, with so many virtual processors, does not fit an empty host."""
    reserve, width = per_virtual_processor(wanted, processors), counted(processors, host.processor_word)
    if reserve > 100:
        return UNUSABLE_RESERVE.at(
            None,
            "{partition} reserves {needs:lp}, and {_width} cannot use that: it needs at least {_least}.",
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
            "The {_width} of {partition} are more than the {has_lp} of {host}.",
            "Lower `processors`, or name a larger host.",
            address=f"partition/{group.name}",
            partition=group.name,
            host=host.name,
            processors=processors,
            has_lp=host.logical_processors,
            _width=width,
        )
    return None


def wanted_reserve(group: Group, host: Host, reservations: ReservationSource) -> LogicalProcessors | NotMeasured:
    """Return what a partition is to have reserved on a host, before it is rounded."""
    own = group.request.cpu.reserve
    if not (isinstance(own, Measured) or own is None):
        return in_processors(own, host.logical_processors)
    answer = reservations.look_up(group.members, host)
    return answer if isinstance(answer, NotMeasured) else answer.reservation


def _processors(group: Group, host: Host, reservations: ReservationSource) -> int:
    """Return what the manifest fixes, else what was measured, else the host's."""
    found = processor_number(group.members, group.request.processors, host.logical_processors)
    if found.source is ProcessorSource.MANIFEST:
        return found.number
    answer = reservations.look_up(group.members, host)
    return found.number if isinstance(answer, NotMeasured) else answer.processors or found.number


def _quota_period(group: Group, host: Host, limit: int, processors: int) -> int | None:
    """On Linux every limit below the whole host is a quota."""
    if host.provider is not ProviderKind.LINUX or (limit == OPEN and processors >= host.logical_processors):
        return None
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
        secure_boot=_secure_boot(group, host),
        switch=own.switch or usual.switch or "",
        vm_path=own.vm_path or usual.vm_path or "",
    )


def _secure_boot(group: Group, host: Host) -> str | None:
    usual = host.settings.secure_boot if isinstance(host.settings, HypervHost) else None
    return (group.request.hyperv.secure_boot or usual) if _generation(group, host) == 2 else None
