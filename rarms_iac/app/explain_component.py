"""How a component comes to what it gets, gathered from manifest, data logs, hosts and the layout.

Begin at `explain_component`; the values that it returns are in `explanation`.
"""

from collections.abc import Iterator
from dataclasses import replace

from rarms_iac.app.alternatives import elsewhere
from rarms_iac.app.data_logs import measured_reservations
from rarms_iac.app.explained_partition import ExplainedPartition, ExplainedPlace, explained_place, partition_to_explain
from rarms_iac.app.explanation import ComponentExplanation, DataLogSummary, ExplainedIndex, Explanation, HostExplanation
from rarms_iac.app.hosts import observe_hosts, select_hosts
from rarms_iac.app.manifests import Manifest
from rarms_iac.app.previous_tuning import previous_tuning
from rarms_iac.app.requests import HostSelection
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.model.host import Host
from rarms_iac.model.quantities import LogicalProcessors, in_processors
from rarms_iac.model.system import Component, Measured
from rarms_iac.model.wording import suggestion
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.measured_together import MeasuredTogether, NotMeasured
from rarms_iac.planner.problem import by_name
from rarms_iac.planner.reservations import depends_on_a_log, names_of
from rarms_iac.planner.totals import totals_by_host
from rarms_iac.statistics.curves import highest_missed, holds
from rarms_iac.storage.finding_pages import known_codes


def find_component(manifest: Manifest, name: str) -> Component:
    """Return a component of the manifest by its name.

    Args:
        manifest: without errors.
        name: as it was given.

    Returns:
        The component.

    Raises:
        RequestError: There is none; the message offers the nearest component or finding.
    """
    component = manifest.system.components.get(name)
    if component is None:
        nearest = suggestion(name, (*manifest.system.components, *known_codes()))
        raise RequestError(f'The manifest has no component "{name}", and no finding is called so.{nearest}')
    return component


def explain_component(manifest: Manifest, name: str) -> ComponentExplanation:
    """Explain how a component comes to what it gets, as a plan places it.

    Args:
        manifest: Its hosts are looked at; those that cannot be count by what the manifest says.
        name: Of the component.

    Returns:
        What its reservation rests on, and the errors that keep everything from fitting.

    Raises:
        RequestError: There is no such component.
        UseCaseError: Its partition has no host at all (negative).
    """
    component, system = find_component(manifest, name), manifest.system
    group = next((group for group in groups_of(system) if name in names_of(group.members)), None)
    if group is None:
        allowed = component.hosts if component.hosts is not None else system.hosts
        homes = tuple(host for host in by_name(system.hosts) if host.name in allowed)
        return HostExplanation(subject=component, places=homes)
    hosts = select_hosts(manifest, HostSelection())
    partition = partition_to_explain(hosts, group, observe_hosts(hosts, needed=()))
    return _with_measurements(_explanation(partition, explained_place(partition), component))


def _explanation(partition: ExplainedPartition, place: ExplainedPlace, component: Component) -> Explanation:
    """All but what a data log says."""
    group, host, layout = partition.group, place.host, partition.layout
    by_log, previous = depends_on_a_log(group), previous_tuning(partition.hosts.manifest, host)
    totals = None if layout is None else totals_by_host(partition.system, layout.partitions, partition.views)[host.name]
    own = group.request.cpu.reserve
    fixed_partition = "" if by_log or own is None or isinstance(own, Measured) else group.name
    fixed_members = [member.name for member in group.members if member.cpu.reserve is not None]
    return Explanation(
        subject=component,
        shared=partition,
        place=place,
        totals=totals,
        wanted_lp=_wanted(partition, host),
        fixed_partition=fixed_partition,
        fixed_members=() if by_log or fixed_partition else tuple(fixed_members),
        previous=previous,
        compounds=tuple(previous.rejected(names_of(group.members))) if by_log else (),
        elsewhere=elsewhere(partition, place.partition),
    )


def _with_measurements(explanation: Explanation) -> Explanation:
    """With what the data log of the partition says, if there is one that holds."""
    partition, host = explanation.shared, explanation.place.host
    group = partition.group
    if not depends_on_a_log(group):
        log, least = _log_despite_fixed(partition, host) if explanation.is_fixed else (None, None)
        return replace(explanation, data_log=log, least=least)
    answer = partition.reservations.log(group.members, host)
    if not isinstance(answer, MeasuredTogether):
        return explanation
    curves = [answer.curves(member.name, index) for member in group.members for index in member.apt]
    least = answer.least
    at = least if least is not None else max(answer.measured, default=0)
    return replace(
        explanation,
        data_log=_data_log_summary(partition.hosts.manifest, group, answer),
        least=least,
        verdicts=tuple(_at_reserve(group, answer, at)),
        one_less=() if least is None else tuple(_at_reserve(group, answer, least - 1)),
        inconclusive=tuple(sorted({at for curve in curves for at in curve.inconclusive})),
        overloaded=tuple(sorted({at for curve in curves for at in curve.overloaded})),
        remarks=tuple(remark.message for remark in answer.remarks),
    )


def _log_despite_fixed(partition: ExplainedPartition, host: Host) -> tuple[DataLogSummary | None, int | None]:
    """The data log of a partition whose reserve is fixed, and the least that is enough by it."""
    group, system = partition.group, partition.system
    measured_members = {
        member.name: replace(member, cpu=replace(member.cpu, reserve=Measured.MEASURED))
        for member in group.members
        if member.apt
    }
    partitions = {
        name: replace(request, cpu=replace(request.cpu, reserve=None)) if name == group.name else request
        for name, request in system.partitions.items()
    }
    unfixed = replace(system, components={**system.components, **measured_members}, partitions=partitions)
    manifest = replace(partition.hosts.manifest, system=unfixed)
    members = tuple(unfixed.components[name] for name in names_of(group.members))
    reservations = measured_reservations(manifest, partition.states)
    log = reservations.log(members, host)
    if not isinstance(log, MeasuredTogether):
        return None, None
    return _data_log_summary(manifest, group, log), log.least


def _wanted(partition: ExplainedPartition, host: Host) -> LogicalProcessors | None:
    own = partition.group.request.cpu.reserve
    if own is None or isinstance(own, Measured):
        answer = partition.reservations.look_up(partition.group.members, host)
        return None if isinstance(answer, NotMeasured) else answer.reservation
    return in_processors(own, host.logical_processors)


def _data_log_summary(manifest: Manifest, group: Group, log: MeasuredTogether) -> DataLogSummary:
    loads = manifest.system.loads_of(names_of(group.members))
    platform = log.records.header.platform_facts
    times = sorted(recorded.provenance.when for recorded in log.records.recorded)
    return DataLogSummary(
        path=log.path,
        first=times[0] if times else "",
        last=times[-1] if times else "",
        reserves=log.measured,
        others=log.others,
        interference=log.interference,
        other_loads=tuple(load for load in loads if load != log.interference),
        processors=log.processors,
        processors_from=log.processors_from,
        provider=platform.provider.value,
        processor=platform.processor,
        logical_processors=platform.logical_processors,
        smt=platform.smt,
        scheduler=platform.scheduler,
        os_build=platform.os_build,
        again=log.again,
    )


def _at_reserve(group: Group, log: MeasuredTogether, reserve: int) -> Iterator[ExplainedIndex]:
    """What the curves have there, those that end elsewhere left out."""
    for member in group.members:
        for index, threshold in member.apt.items():
            curve = log.curves(member.name, index)
            point = curve.value_at(reserve)
            if point is not None:
                yield ExplainedIndex(
                    member=member.name,
                    index=index,
                    threshold=threshold,
                    reserve=reserve,
                    point=point,
                    estimate=curve.estimate_at(reserve),
                    met=holds(curve, threshold, reserve),
                    missed=reserve <= highest_missed([(curve, threshold)]),
                    inconclusive=reserve in curve.inconclusive,
                )
