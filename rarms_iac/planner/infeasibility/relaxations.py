"""What can be changed: reserves, APTs, memory and logical processors of hosts, and who shares a partition."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import combinations
from math import ceil, floor
from typing import Any, TypeVar

from rarms_iac.model.experiment import ProcessorSource
from rarms_iac.model.host import Host
from rarms_iac.model.indexes import find_index
from rarms_iac.model.layout import RelaxedLevel
from rarms_iac.model.quantities import CpuAmount, LogicalProcessors, Percent, ProcessorTime, ShareOfHost, guaranteed
from rarms_iac.model.state import HostFacts
from rarms_iac.model.system import AtLeast, Component, CpuRequest, Measured, PartitionRequest, Threshold
from rarms_iac.planner.combining.candidates import compound_of
from rarms_iac.planner.combining.oracle import coi_as_measured, total
from rarms_iac.planner.groups import Group, may_share
from rarms_iac.planner.infeasibility.edits import Edit, Edits, RelaxationRange, Variant
from rarms_iac.planner.packing.values import free_in
from rarms_iac.planner.problem import Problem, by_name
from rarms_iac.planner.reservations import MeasuredReservations, depends_on_a_log, names_of
from rarms_iac.planner.verdicts import MeasuredTogether
from rarms_iac.statistics.curves import holds, tightest_threshold
from rarms_iac.texts.indexes import show_threshold, show_value
from rarms_iac.texts.messages import in_a_row, natural_order
from rarms_iac.texts.quantities import show_amount, show_lp_percent, show_processors, write_bytes

MORE_PROCESSORS = 8
_MIB = 2**20
Known = TypeVar("Known", Host, HostFacts)


def reserve_relaxations(group: Group) -> Iterator[RelaxationRange]:
    """Yield the reserves that the manifest fixes for a partition: its own, or its members', the least critical first.

    Yields:
        A relaxation for each fixed reserve, in steps as the amount is written: per cent of a host, or hundredths of an
            LP.
    """
    own = group.request.cpu.reserve is not None and group.request.cpu.reserve is not Measured.MEASURED
    for entry in (group.request,) if own else reversed(group.members):
        reserve = entry.cpu.reserve
        if reserve is not None and not isinstance(reserve, Measured):
            yield _reserve_relaxation(group, entry, reserve)


def _reserve_relaxation(group: Group, entry: Component | PartitionRequest, before: CpuAmount) -> RelaxationRange:
    """Lower a reserve in steps of the unit as written: whole per cent of the host, or hundredths of an LP."""
    field, title = ("components", "") if isinstance(entry, Component) else ("partitions", "partition ")

    def edits_at(step: int) -> Edits:
        amount: CpuAmount = ProcessorTime(LogicalProcessors(Fraction(step, 100)))
        if isinstance(before, ShareOfHost):
            amount = ShareOfHost(Percent(Fraction(step)))
        after = replace(entry, cpu=replace(entry.cpu, reserve=amount))
        message = f"{title}{entry.name} reserves {show_amount(amount)} instead of {show_amount(before)}"
        return (Edit(message, lambda variant: variant.with_entries(field, {entry.name: after})),)

    most = before.percent if isinstance(before, ShareOfHost) else 100 * before.processors
    return RelaxationRange(partitions=(group.name,), amounts=range(1, ceil(most)), edits_at=edits_at)


def apt_relaxations(group: Group, problem: Problem) -> Iterator[RelaxationRange]:
    """Yield the APTs of a partition together, down to the lowest CR that was measured; none where its reserve is fixed.

    Yields:
        At most one relaxation; its amounts are CRs below the one that the APTs need now.
    """
    if measured := _measured(group, problem):
        log, least = measured
        edits_at = partial(_relaxed, group, log)
        reserves = [reserve for reserve in range(1, least) if edits_at(reserve)]
        yield RelaxationRange(partitions=(group.name,), amounts=reserves, edits_at=edits_at)


def is_lowest_measured(group: Group, problem: Problem) -> bool:
    """Tell whether a partition's APTs hold at the lowest CR of its data log, so that less may be enough."""
    measured = _measured(group, problem)
    return measured is not None and 1 < measured[1] <= min(measured[0].measured, default=0)


def _measured(group: Group, problem: Problem) -> tuple[MeasuredTogether, int] | None:
    """Return the source of a partition's reserve, and the CR that its APTs need.

    None means that it is fixed or not known.
    """
    source, claims = problem.reservations, problem.claims[group.name]
    if claims and isinstance(source, MeasuredReservations) and depends_on_a_log(group):
        host = problem.system.hosts[next(iter(claims))]
        log = source.log(group.members, host)
        if isinstance(log, MeasuredTogether) and log.least is not None:
            return log, log.least
    return None


def _relaxed(group: Group, log: MeasuredTogether, reserve: int) -> Edits:
    """Return the APTs that have to change for this CR to do, as little as possible.

    There are none where a curve says nothing.
    """
    edits = []
    for member in group.members:
        for index, threshold in member.apt.items():
            curve = log.curves(member.name, index)
            if holds(curve, threshold, reserve):
                continue
            met = tightest_threshold(curve, reserve)
            if met is None or _is_too_little(threshold, met):
                return ()
            edits.append(_relaxed_apt(member, index, met))
    return tuple(edits)


def _is_too_little(asked: Threshold, met: Threshold) -> bool:
    """Return whether less than half of a minimum is met: no performance to offer."""
    return isinstance(asked, AtLeast) and 2 * met.value < asked.value


def _relaxed_apt(component: Component, name: str, threshold: Threshold) -> Edit:
    """Write as `vision: mean_response_time at most 131 ms instead of 100 ms`, in the manifest's words."""
    index = find_index(name)
    assert index is not None, "an APT names indexes that there are"

    def apply(variant: Variant) -> Variant:
        before = variant.system.components[component.name]
        return variant.with_entries("components", {before.name: replace(before, apt={**before.apt, name: threshold})})

    before = show_value(index, component.apt[name].value)
    level = RelaxedLevel(component=component.name, index=name, level=show_value(index, threshold.value))
    return Edit(f"{component.name}: {name} {show_threshold(index, threshold)} instead of {before}", apply, level)


def narrowing_relaxations(group: Group, problem: Problem) -> Iterator[RelaxationRange]:
    """Give fewer virtual processors to a component that was measured alone and does not use all.

    Yields:
        At most one relaxation, of a single amount; whether the component is as fast then has to be measured.
    """
    measured = _measured(group, problem)
    if measured is None or len(group.members) > 1 or group.request.processors is not None:
        return
    (log, least), (member,) = measured, group.members
    usable = log.used
    if usable is None or usable >= log.processors or log.processors_from is not ProcessorSource.MANIFEST:
        return
    amount = ProcessorTime(guaranteed(least, usable))
    after = replace(member, processors=usable, cpu=replace(member.cpu, reserve=amount))
    message = (
        f"`processors: {usable}` for {member.name}, which uses {usable} of its {log.processors}: about "
        f"{show_amount(amount)} instead of {show_processors(guaranteed(least, log.processors))}"
    )
    edits = (Edit(message, lambda variant: variant.with_entries("components", {member.name: after})),)
    yield RelaxationRange(partitions=(group.name,), amounts=range(1), edits_at=lambda _: edits, to_be_measured=True)


def memory_relaxations(problem: Problem) -> Iterator[RelaxationRange]:
    """Give a host more memory, at most as much as all who may run there claim.

    Yields:
        A relaxation for each host, its amounts in MiB.
    """
    for host in problem.bins:
        claimed = sum(item.claims[host.name].memory for item in problem.items if host.name in item.claims)
        missing = -(-(claimed - free_in(host).memory) // _MIB)
        yield RelaxationRange(amounts=range(missing, 0, -1), edits_at=partial(_more_memory, host.name))


def _more_memory(host: str, mib: int) -> Edits:
    message = f"{write_bytes(mib * _MIB)} more memory on {host}"
    return (Edit(message, lambda variant: _grown([host], variant, memory=mib * _MIB)),)


def processor_relaxations(problem: Problem) -> Iterator[RelaxationRange]:
    """Give all hosts of a platform more logical processors, since they share measured data.

    Yields:
        A relaxation for each platform, by its first host; up to `MORE_PROCESSORS` more on each host. It has to be
            measured where the data logs of the platform no longer hold then.
    """
    platforms: dict[str, list[Host]] = {}
    for host in by_name(problem.system.hosts):
        platforms.setdefault(host.platform, []).append(host)
    for hosts in platforms.values():
        names = [host.name for host in hosts]
        there = [group for group in problem.groups if problem.claims[group.name].keys() & set(names)]
        measured = any(map(depends_on_a_log, there))
        wide = sorted(
            (member.name for group in there for member in _as_wide_as_its_host(group, problem)), key=natural_order
        )
        yield RelaxationRange(
            amounts=range(MORE_PROCESSORS, 0, -1),
            edits_at=partial(_more_processors, names, wide, hosts[0].logical_processors),
            to_be_measured=measured,
        )


def _as_wide_as_its_host(group: Group, problem: Problem) -> Iterator[Component]:
    """Yield the members that have as many processors as their host, since it was not seen how many they use."""
    measured = _measured(group, problem)
    if measured is not None and measured[0].processors_from is ProcessorSource.HOST:
        yield from (member for member in group.members if member.processors is None)


def _more_processors(hosts: Sequence[str], wide: Sequence[str], width: int, more: int) -> Edits:
    """Add processors, and keep these components as wide as they were measured: as wide as their host was."""

    def apply(variant: Variant) -> Variant:
        components = variant.system.components
        narrowed = {name: replace(components[name], processors=width) for name in wide}
        return _grown(hosts, variant.with_entries("components", narrowed), logical_processors=more)

    place = hosts[0] if len(hosts) == 1 else f"each of {in_a_row(hosts)}"
    added = "one more logical processor" if more == 1 else f"{more} more logical processors"
    fixed = f", with `processors: {width}` for {in_a_row(wide)} as now" if wide else ""
    return (Edit(f"{added} on {place}{fixed}", apply),)


def _grown(hosts: Sequence[str], variant: Variant, **more: int) -> Variant:
    """Return the variant with larger hosts (`memory`, `logical_processors`), in the manifest and in what was observed.

    What is added counts from the smaller of both, as a host's capacity does.
    """
    states, after = dict(variant.states), {}
    for name in hosts:
        host, state = variant.system.hosts[name], states.get(name)
        both = [host, *([state.facts] if state else [])]
        whole = {field: added + min(getattr(known, field) for known in both) for field, added in more.items()}
        after[name] = _at_least(host, whole)
        if state is not None:
            states[name] = replace(state, facts=_at_least(state.facts, whole))
    return replace(variant.with_entries("hosts", after), states=states)


def _at_least(known: Known, whole: Mapping[str, int]) -> Known:
    """Return the host, or its facts, with no less of these."""
    larger: dict[str, Any] = {field: max(amount, getattr(known, field)) for field, amount in whole.items()}
    return replace(known, **larger)


def pair_relaxations(problem: Problem, partitions: Collection[str]) -> Iterator[RelaxationRange]:
    """Let two of these partitions share one, the least critical first; both must be measured to need less.

    The first level is the least that the two can need together, above what they were shown to miss with; the last is
    just less than they reserve apart.

    Args:
        partitions: the names among which pairs are made.

    Yields:
        A relaxation for each pair, its amounts CRs of the compound; all have to be measured.
    """
    groups = [group for group in problem.groups if group.name in partitions and depends_on_a_log(group)]
    for minor, leader in combinations(
        sorted(groups, key=lambda group: (group.criticality, natural_order(group.name))), 2
    ):
        hosts = [name for name in problem.claims[minor.name] if name in problem.claims[leader.name]]
        if hosts and may_share(minor, leader):
            yield _pair_relaxation(minor, leader, hosts, problem)


def _pair_relaxation(minor: Group, leader: Group, hosts: Sequence[str], problem: Problem) -> RelaxationRange:
    host = problem.system.hosts[hosts[0]]
    seen = problem.seen[host.name]
    parts = [
        coi_as_measured(
            group, problem.claims[group.name][host.name], problem.reservations, host, sharing=seen.sharing(group.name)
        )
        for group in (minor, leader)
    ]
    compound, members, source = compound_of(parts), (*minor.members, *leader.members), problem.reservations
    missed = source.missed_together(names_of(members), host) if isinstance(source, MeasuredReservations) else 0
    least = max(compound.reserve, 1 + floor(100 * missed / compound.processors))
    reserves = range(least, (total(parts) - 1) // compound.taken_processors + 1)
    taken_missed = show_processors(missed * Fraction(compound.taken_processors, compound.processors))
    platforms = {each.platform for each in problem.system.hosts.values()}
    too_little = f"were shown to miss with {taken_missed}, and " if missed else ""

    def edits_at(reserve: int) -> Edits:
        amount = ProcessorTime(guaranteed(reserve, compound.processors))
        names = tuple(member.name for member in members)
        shared = replace(leader.request, components=names, cpu=CpuRequest(reserve=amount))

        def apply(variant: Variant) -> Variant:
            system = variant.system
            partitions = {name: request for name, request in system.partitions.items() if name != minor.name}
            combined = replace(variant, system=replace(system, partitions={**partitions, leader.name: shared}))
            first = replace(system.components[names[0]], hosts=tuple(hosts))
            return combined.with_entries("components", {first.name: first})

        return (
            Edit(
                (
                    f"{minor.name} and {leader.name} reserve {show_lp_percent(total(parts))} in two partitions on "
                    f"{in_a_row(hosts, 'or')}; in one partition they {too_little}may reserve up to "
                    f"{show_lp_percent(compound.taken_processors * reserve)}"
                ),
                apply,
                host=host.name if len(platforms) > 1 else "",
            ),
        )

    return RelaxationRange(
        partitions=(minor.name, leader.name),
        amounts=reserves,
        edits_at=edits_at,
        to_be_measured=True,
    )
