"""Checks of the CPU that the manifest fixes: reserve, limit, weight and virtual processors."""

from collections.abc import Iterator, Sequence
from fractions import Fraction
from math import ceil
from typing import assert_never

from rarms_iac.manifest.checks.violation import (
    Violation,
    allowed_hosts,
    check,
    cpu_settings,
    fixed_reserve,
    hosts_for,
    members,
    on_every,
    partition_check,
    violation,
)
from rarms_iac.model.host import Host, ProviderKind
from rarms_iac.model.quantities import (
    CpuAmount,
    LogicalProcessors,
    ProcessorTime,
    ShareOfHost,
    guaranteed,
    in_processors,
    per_virtual_processor,
)
from rarms_iac.model.system import (
    MOST_WEIGHT,
    USUAL_WEIGHT,
    Component,
    CpuRequest,
    Headroom,
    Measured,
    PartitionRequest,
    RunsOn,
    System,
    weight_of_criticality,
)
from rarms_iac.texts.findings import CLASS_ORDER, NO_EFFECT, OVER_HOST, ROUNDED, UNUSABLE_RESERVE, Finding
from rarms_iac.texts.messages import in_a_row
from rarms_iac.texts.quantities import show_amount, show_processors


@check(NO_EFFECT)
def weight_on_linux(system: System) -> Iterator[Violation]:
    """Find fixed weights of what may run on a Linux host: its only weight is the reserve."""
    for section, name, cpu, hosts in cpu_settings(system):
        found = [host.name for host in hosts if host.provider is ProviderKind.LINUX]
        if cpu.weight is not None and found:
            yield violation(
                (section, name, "cpu", "weight"),
                '"{name}" may run on {hosts}, a Linux host. On Linux, the reserve is also the weight.',
                "Remove `weight`. For more processor time, raise the reserve.",
                weight=cpu.weight,
                hosts=tuple(found),
                name=name,
            )


@check(UNUSABLE_RESERVE)
def reserve_over_limit(system: System) -> Iterator[Violation]:
    """Find components and partitions whose limit is below their reserve on every possible host."""
    for section, name, cpu, hosts in cpu_settings(system):
        reserve, limit = cpu.reserve, cpu.limit
        if reserve is None or limit is None or isinstance(reserve, Measured):
            continue
        if _is_above(reserve, limit, hosts):
            yield violation(
                (section, name, "cpu", "limit"),
                '"{name}" reserves {reserve}, but its limit is {limit}. The rest of the reserve cannot be used.',
                "Raise the limit, lower the reserve, or remove the limit.",
                related=(((section, name, "cpu", "reserve"), False, "the reserve"),),
                reserve=show_amount(reserve),
                limit=show_amount(limit),
                name=name,
            )


def _is_above(reserve: CpuAmount, limit: CpuAmount, hosts: list[Host]) -> bool:
    if isinstance(reserve, ShareOfHost) and isinstance(limit, ShareOfHost):
        return reserve.percent > limit.percent
    if isinstance(reserve, ProcessorTime) and isinstance(limit, ProcessorTime):
        return reserve.processors > limit.processors
    return on_every(
        hosts,
        lambda host: in_processors(reserve, host.logical_processors) > in_processors(limit, host.logical_processors),
    )


@check(OVER_HOST)
def reserve_over_host(system: System) -> Iterator[Violation]:
    """Yield fixed reserves above what every possible host has less `keep_for_host`."""
    capacity = {
        host.name: host.logical_processors - in_processors(host.keep_for_host.processor, host.logical_processors)
        for host in system.hosts.values()
    }
    for section, name, cpu, hosts in cpu_settings(system):
        reserve = cpu.reserve
        if reserve is None or isinstance(reserve, Measured):
            continue
        if hosts and all(_exceeds(reserve, capacity[host.name], host) for host in hosts):
            largest = max(hosts, key=lambda host: (capacity[host.name], host.name))
            if capacity[largest.name] < 0:
                continue  # RARMS061 says so at the hosts
            yield violation(
                (section, name, "cpu", "reserve"),
                '"{name}" reserves {reserve}, but "{host}" has {capacity:lp} of its {host_lp} LP for '
                "partitions{_rank}.",
                "Lower the reserve, keep less for the host, or allow a larger host.",
                reserve=show_amount(reserve),
                host=largest.name,
                capacity=capacity[largest.name],
                host_lp=largest.logical_processors,
                name=name,
                _rank=", more than any other host it may run on" if len(hosts) > 1 else "",
            )


def _exceeds(reserve: CpuAmount, capacity: Fraction, host: Host) -> bool:
    match reserve:
        case ShareOfHost(percent=share):
            return share * host.logical_processors > 100 * capacity
        case ProcessorTime(processors=time):
            return time > capacity
        case _:
            assert_never(reserve)


@check(Finding.warning("RARMS063", "A fixed reserve is more than the component's threads can use"))
def reserve_beyond_parallelism(system: System) -> Iterator[Violation]:
    """Yield fixed reserves that are more LPs than the component has threads."""
    for component in system.components.values():
        threads = None if component.simulation is None else component.simulation.threads
        if threads is None or component.runs_on is RunsOn.HOST or (component.processors or threads + 1) <= threads:
            continue
        reserves = [
            reserve
            for host in allowed_hosts(system, component)
            if (reserve := fixed_reserve(component.cpu, host)) is not None
        ]
        if reserves and min(reserves) > threads:
            yield violation(
                ("components", component.name, "cpu", "reserve"),
                '"{component}" reserves {reserve:lp}, but {threads:thread} can use at most {threads} LP. The '
                "rest cannot be used.",
                f"Write `processors: {threads}`, with a reserve of at most {show_processors(threads)}.",
                reserve=min(reserves),
                threads=threads,
            )


@check(UNUSABLE_RESERVE)
def reserve_over_processors(system: System) -> Iterator[Violation]:
    """Yield fixed reserves that are more LPs than `processors` allows, a whole LP each."""
    for section, name, cpu, hosts in cpu_settings(system):
        owner = system.components[name] if section == "components" else system.partitions[name]
        count = owner.processors
        # A share of fewer logical processors is less: the smallest host decides.
        smallest = min(hosts, key=lambda host: host.logical_processors, default=None)
        reserve = fixed_reserve(cpu, smallest) if smallest else None
        if count is not None and reserve is not None and reserve > count:
            yield violation(
                (section, name, "cpu", "reserve"),
                '"{name}" reserves {reserve:lp}, but {processors:virtual processor} can use at most {processors} LP.',
                f"Write `processors: {ceil(reserve)}`, or reserve at most {show_processors(count)}.",
                reserve=reserve,
                processors=count,
                name=name,
            )


@check(OVER_HOST)
def more_processors_than_host(system: System) -> Iterator[Violation]:
    """Find `processors` above the LPs of every possible host."""
    for section, name, processors, hosts in _virtual_processors(system):
        most = max((host.logical_processors for host in hosts), default=processors)
        if processors > most:
            yield violation(
                (section, name, "processors"),
                (
                    '"{name}" has {processors} virtual processors, but its allowed hosts have at most {most_lp} LP. '
                    "No host could guarantee its reservation."
                ),
                f"Write `processors: {most}` or fewer, or allow a larger host.",
                processors=processors,
                most_lp=most,
                name=name,
            )


def _virtual_processors(system: System) -> Iterator[tuple[str, str, int, list[Host]]]:
    """Yield section, name, `processors` and possible hosts of what fixes `processors`."""
    for component in system.components.values():
        if component.processors is not None:
            yield "components", component.name, component.processors, allowed_hosts(system, component)
    for partition in system.partitions.values():
        if partition.processors is not None:
            hosts = hosts_for(system, members(system, partition))
            yield "partitions", partition.name, partition.processors, hosts


@partition_check(Finding.error("RARMS094", "A partition and its only component have different CPU settings"))
def different_cpu(system: System, partition: PartitionRequest) -> Iterator[Violation]:
    """Yield a reserve, limit or weight that a partition and its only component fix differently."""
    components = members(system, partition)
    if len(components) != 1:
        return
    component = components[0]
    for key in ("reserve", "limit", "weight"):
        wanted, other = getattr(partition.cpu, key), getattr(component.cpu, key)
        if wanted is not None and other is not None and wanted != other:
            yield violation(
                ("partitions", partition.name, "cpu", key),
                'The partition "{partition}" and its only component "{component}" have different values of {key}.',
                "Remove one of the two values.",
                related=((("components", component.name, "cpu", key), False, "the component's"),),
                component=component.name,
                key=key,
            )


@check(Finding.note("RARMS130", "A fixed limit or weight slows a component with an APT"))
def held_back(system: System) -> Iterator[Violation]:
    """Find components with an APT, and their partitions, that have a limit or a weight below the usual 100."""
    for section, name, cpu, hosts in cpu_settings(system):
        components, processors = _users(system, section, name)
        with_apt = [component.name for component in components if component.apt]
        if not with_apt:
            continue
        subject = f'"{name}" has an APT' if section == "components" else f'"{name}" contains {with_apt[0]} with an APT'
        if cpu.limit is not None and _caps(cpu.limit, processors, components, hosts):
            yield violation(
                (section, name, "cpu", "limit"),
                (
                    "{_subject} and a limit of {limit}, less than its virtual processors could use. It answers "
                    "later than without the limit. Measurements without the limit are not valid."
                ),
                "rarms keeps the limit. Remove `limit` if you do not need it.",
                component=with_apt[0],
                limit=show_amount(cpu.limit),
                _subject=subject,
            )
        if cpu.weight is not None and cpu.weight < USUAL_WEIGHT:
            yield violation(
                (section, name, "cpu", "weight"),
                (
                    "{_subject} and the weight {weight}, less than the usual {usual_weight}. It gets less "
                    "unreserved time than others. Measurements do not show this effect."
                ),
                "rarms keeps the weight. Remove `weight` if you do not need it.",
                component=with_apt[0],
                weight=cpu.weight,
                _subject=subject,
                usual_weight=USUAL_WEIGHT,
            )


def _users(system: System, section: str, name: str) -> tuple[Sequence[Component], int | None]:
    """Return the components that the setting counts for, and the processors that the manifest fixes for them."""
    if section == "components":
        return [system.components[name]], None
    partition = system.partitions[name]
    return members(system, partition), partition.processors


def _caps(limit: CpuAmount, processors: int | None, components: Sequence[Component], hosts: list[Host]) -> bool:
    def is_below(host: Host) -> bool:
        usable = processors or max(component.processors or host.logical_processors for component in components)
        return in_processors(limit, host.logical_processors) < usable

    return on_every(hosts, is_below)


@check(CLASS_ORDER)
def criticalities_alike(system: System) -> Iterator[Violation]:
    """Find different criticalities that end in the same, highest weight."""
    if system.policy.headroom is not Headroom.BY_CRITICALITY:
        return
    fixed = {name for partition in system.partitions.values() if partition.cpu.weight for name in partition.components}
    alike = [
        component
        for component in system.components.values()
        if component.runs_on is RunsOn.PARTITION and component.cpu.weight is None and component.name not in fixed
        if weight_of_criticality(component.criticality) == MOST_WEIGHT
    ]
    if len({component.criticality for component in alike}) < 2:
        return
    first, *others = sorted(alike, key=lambda component: (-component.criticality, component.name))
    said = in_a_row([f"{component.name} ({component.criticality})" for component in (first, *others)])
    yield violation(
        ("components", first.name, "criticality"),
        "{_said} all get the maximum weight of {weight}: a weight is {usual_weight} times the criticality.",
        f"Write criticalities of at most {MOST_WEIGHT // USUAL_WEIGHT} in the same order, or fix the weights: "
        "`cpu: { weight: 5000 }`.",
        related=tuple((("components", other.name, "criticality"), False, "alike") for other in others),
        components=tuple(component.name for component in (first, *others)),
        weight=MOST_WEIGHT,
        _said=said,
        usual_weight=USUAL_WEIGHT,
    )


@check(CLASS_ORDER)
def fixed_weight_out_of_order(system: System) -> Iterator[Violation]:
    """Find fixed weights that put a more critical component below a less critical one."""
    if system.policy.headroom is not Headroom.BY_CRITICALITY:
        return
    fixed = _fixed_weights(system)
    shared = {name for each in system.partitions.values() if len(each.components) > 1 for name in each.components}
    weights = {
        name: fixed[name][0] if name in fixed else weight_of_criticality(component.criticality)
        for name, component in system.components.items()
        if component.runs_on is RunsOn.PARTITION and name not in shared
        if any(host.provider is not ProviderKind.LINUX for host in allowed_hosts(system, component))
    }
    for name, (weight, path) in fixed.items():
        if name not in weights:
            continue
        criticality = system.components[name].criticality
        others = {other: system.components[other].criticality for other in weights}
        above = [other for other in others if others[other] < criticality and weights[other] > weight]
        below = [other for other in others if others[other] > criticality and weights[other] < weight]
        below = [other for other in below if other not in fixed]  # else it is reported there
        if above or below:
            than, compared = ("Less", "a higher") if above else ("More", "a lower")
            said = in_a_row([f"{other} {weights[other]}" for other in above or below])
            yield violation(
                path,
                (
                    '"{component}" (criticality {criticality}) has the fixed weight {weight}. {_than} critical '
                    "components have {_compared} weight: {_said}."
                ),
                f"Remove `weight`. {name} then gets the weight {weight_of_criticality(criticality)}.",
                component=name,
                criticality=criticality,
                weight=weight,
                others=tuple(above or below),
                _than=than,
                _compared=compared,
                _said=said,
            )


def _fixed_weights(system: System) -> dict[str, tuple[int, tuple[str, ...]]]:
    """Return each component's fixed weight, its own or that of the partition for it alone, and its place."""
    fixed: dict[str, tuple[int, tuple[str, ...]]] = {
        name: (component.cpu.weight, ("components", name, "cpu", "weight"))
        for name, component in system.components.items()
        if component.cpu.weight is not None
    }
    for name, partition in system.partitions.items():
        if partition.cpu.weight is not None and len(partition.components) < 2:
            for component in members(system, partition):
                fixed[component.name] = (partition.cpu.weight, ("partitions", name, "cpu", "weight"))
    return fixed


@check(ROUNDED)
def reserve_rounded_up(system: System) -> Iterator[Violation]:
    """Find wide components whose reserve grows much by rounding to whole per cent of each processor."""
    for section, name, cpu, hosts in cpu_settings(system):
        components, fixed = _users(system, section, name)
        unlike = {host.logical_processors: host for host in reversed(hosts)}.values()
        given = [_rounded(cpu, host, fixed, components) for host in unlike]
        if not given or not all(much for *_, much in given):
            continue
        host = hosts[0]
        wanted, rounded, _ = _rounded(cpu, host, fixed, components)
        yield violation(
            (section, name, "cpu", "reserve"),
            (
                '"{name}" reserves {reserve}, but gets {given} on "{host}": reserves are whole per cent of each '
                "virtual processor."
            ),
            "Use fewer `processors` to reduce the rounding.",
            name=name,
            reserve=show_processors(wanted),
            given=show_processors(rounded),
            host=host.name,
        )


def _rounded(
    cpu: CpuRequest, host: Host, fixed: int | None, components: Sequence[Component]
) -> tuple[LogicalProcessors, LogicalProcessors, bool]:
    """Return the reservation there, the given amount, and whether that is more than a tenth above."""
    wanted = fixed_reserve(cpu, host) or LogicalProcessors(Fraction(0))
    processors = fixed or max((member.processors or host.logical_processors for member in components), default=1)
    given = guaranteed(per_virtual_processor(wanted, processors), processors)
    return wanted, given, given > wanted * Fraction(11, 10)
