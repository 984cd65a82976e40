"""How a component comes to what it gets, gathered from manifest, data logs, hosts and the layout.

Begin at `explain_component`; the values that it returns are in `explanation`.
"""

from collections.abc import Iterator
from dataclasses import replace

from rarms_iac.app.data_logs import Measurements, measured_reservations, measurements_of
from rarms_iac.app.errors import RequestError
from rarms_iac.app.explained_partition import ExplainedPartition, ExplainedPlace, partition_to_explain, place_of
from rarms_iac.app.explanation import ComponentExplanation, DataLogSummary, Explanation, HostExplanation, MemberCurve
from rarms_iac.app.explanation_steps import explain
from rarms_iac.app.hosts import observe_hosts, select_hosts
from rarms_iac.app.manifests import Manifest
from rarms_iac.app.requests import HostSelection
from rarms_iac.model.diagnostics import has_errors
from rarms_iac.model.host import Host
from rarms_iac.model.quantities import LogicalProcessors, in_processors
from rarms_iac.model.system import Component, Measured
from rarms_iac.model.wording import suggestion
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.problem import by_name
from rarms_iac.planner.reservations import MeasuredTogether, NotMeasured, depends_on_a_log, names_of
from rarms_iac.storage.datalog.files import read_log
from rarms_iac.storage.datalog.log import DataLog
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
        The steps from the APT to the reservation, and the errors that keep everything from fitting.

    Raises:
        RequestError: There is no such component.
        UseCaseError: Its partition has no host at all (negative).
    """
    component, system = find_component(manifest, name), manifest.system
    group = next((group for group in groups_of(system) if name in names_of(group.members)), None)
    if group is None:
        allowed = component.hosts if component.hosts is not None else system.hosts
        homes = tuple(host for host in by_name(system.hosts) if host.name in allowed)
        return explain(HostExplanation(component=component, hosts=homes))
    hosts = select_hosts(manifest, HostSelection())
    partition = partition_to_explain(hosts, measurements_of(manifest), group, observe_hosts(hosts, needed=()))
    place = place_of(partition)
    errors = [finding for finding in partition.planning.findings if has_errors([finding])]
    return explain(_explanation(partition, place, component), tuple(errors) if place.no_host_because else ())


def _explanation(partition: ExplainedPartition, place: ExplainedPlace, component: Component) -> Explanation:
    group, host = partition.group, place.host
    explanation = Explanation(
        component=component,
        partition=partition,
        place=place,
        wanted=_wanted(partition, host),
        fixed_by="" if depends_on_a_log(group) else _fixed_by(group),
        log=None,
        least=None,
    )
    if not depends_on_a_log(group):
        log, least = _log_despite_fixed(partition, host) if explanation.fixed_by else (None, None)
        return replace(explanation, log=log, least=least)
    answer = partition.reservations.log(group.members, host)
    if not isinstance(answer, MeasuredTogether):
        return explanation
    return replace(
        explanation,
        log=_data_log_summary(partition.measurements, group, answer),
        least=partition.reservations.least(group.members, host),
        curves=tuple(_member_curves(group, answer)),
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
    measurements = replace(partition.measurements, system=unfixed)
    members = tuple(unfixed.components[name] for name in names_of(group.members))
    reservations = measured_reservations(measurements, partition.states)
    log = reservations.log(members, host)
    if not isinstance(log, MeasuredTogether):
        return None, None
    return _data_log_summary(measurements, group, log), reservations.least(members, host)


def _wanted(partition: ExplainedPartition, host: Host) -> LogicalProcessors | None:
    own = partition.group.request.cpu.reserve
    if own is None or isinstance(own, Measured):
        answer = partition.reservations.reservation(partition.group.members, host)
        return None if isinstance(answer, NotMeasured) else in_processors(answer, host.logical_processors)
    return in_processors(own, host.logical_processors)


def _fixed_by(group: Group) -> str:
    own = group.request.cpu.reserve
    if own is not None and not isinstance(own, Measured):
        return f"the manifest's partition {group.name}"
    names = [member.name for member in group.members if member.cpu.reserve is not None]
    return f"the manifest, for {' and '.join(names)}," if names else ""


def _data_log_summary(measurements: Measurements, group: Group, log: MeasuredTogether) -> DataLogSummary:
    loads = measurements.system.loads_of(names_of(group.members))
    whole = read_log(measurements.folder / log.path)
    assert isinstance(whole, DataLog), "what a reservation rests on was read a moment ago"
    platform, times = whole.header.platform_facts, sorted(recorded.provenance.when for recorded in whole.recorded)
    return DataLogSummary(
        path=log.path,
        first=times[0] if times else "",
        last=times[-1] if times else "",
        reserves=log.measured,
        interference=log.interference,
        other_loads=tuple(load for load in loads if load != log.interference),
        processors=log.processors,
        provider=platform.provider.value,
        processor=platform.processor,
        logical_processors=platform.logical_processors,
        smt=platform.smt,
        scheduler=platform.scheduler,
        os_build=platform.os_build,
        again=log.again,
    )


def _member_curves(group: Group, log: MeasuredTogether) -> Iterator[MemberCurve]:
    for member in group.members:
        for index, threshold in member.apt.items():
            yield MemberCurve(
                member=member.name, index=index, threshold=threshold, curve=log.curves(member.name, index)
            )
