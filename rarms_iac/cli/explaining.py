"""What `rarms explain COMPONENT` walks through, gathered from manifest, data logs and the layout."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction

from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.datalogs import Measurements, measured_reservations, path_of, subject_of
from rarms_iac.cli.manifests import Opened
from rarms_iac.cli.partners import partners
from rarms_iac.cli.problems import Halted
from rarms_iac.datalog.files import read_log
from rarms_iac.datalog.log import DataLog
from rarms_iac.experiments.setup import interference_of
from rarms_iac.model.capacity import capacity_of
from rarms_iac.model.layout import Layout, PlacedPartition
from rarms_iac.model.quantities import LogicalProcessors, in_processors, show_processors
from rarms_iac.model.system import Host, Measured, System
from rarms_iac.planner.alternatives import elsewhere
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.layout import Planning, plan_layout
from rarms_iac.planner.reservations import (
    MeasuredReservations,
    MeasuredTogether,
    Names,
    NotMeasured,
    names_of,
    rests_on_a_log,
)
from rarms_iac.planner.sizes import Sized, size
from rarms_iac.views import walk as shown


@dataclass(frozen=True, slots=True, kw_only=True)
class _Found:
    """Where the partition is, or would be if there were room."""

    group: Group
    host: Host
    placed: PlacedPartition


def walk_of(measured: Measurements, opened: Opened, name: str) -> shown.Walk:
    """The walk for a component that has a partition, as manifest and data logs alone place it.

    Raises:
        Halted: nothing says how much it needs on any host (4).
    """
    system = measured.system
    reservations = measured_reservations(measured, {})
    planning = plan_layout(system, reservations, {}, opened.loaded.places)
    group = next(one for one in groups_of(system) if name in names_of(one.members))
    found = _found(group, planning, system, reservations)
    if found is None:
        raise Halted(ExitCode.NO, planning.findings, opened.loaded.sources)
    layout = planning.answer if isinstance(planning.answer, Layout) else None
    log = reservations.log(group.members, found.host)
    rests = rests_on_a_log(group) and isinstance(log, MeasuredTogether)
    return shown.Walk(
        component=system.components[name],
        group=group,
        host=found.host,
        placed=found.placed,
        wanted=_wanted(group, found.host, reservations),
        fixed_by="" if rests else _fixed_by(group),
        measured=_measured(measured, group, found.host, log) if rests and isinstance(log, MeasuredTogether) else None,
        looked=tuple(_looked(group, log)) if rests and isinstance(log, MeasuredTogether) else (),
        least=reservations.least(group.members, found.host) if rests else None,
        remarks=tuple(one.says for one in log.remarks) if rests and isinstance(log, MeasuredTogether) else (),
        why_together=tuple(_why_together(group, system)),
        apart=_apart(measured, opened, group, found),
        partners=partners(group, groups_of(system), found.host, reservations, _was_measured(measured, found.host))
        if rests
        else (),
        on_host=None if layout is None else _on_host(layout, found),
        elsewhere=() if layout is None else elsewhere(group, found.placed, layout, system, reservations),
        misfit=() if layout is not None else tuple(_misfit(planning)),
    )


def _was_measured(measured: Measurements, host: Host) -> Callable[[Names], bool]:
    def has_log(names: Names) -> bool:
        subject = subject_of(measured.system, host, names, interference_of(measured.system, names))
        return path_of(measured.folder, subject).is_file()

    return has_log


def _found(group: Group, planning: Planning, system: System, reservations: MeasuredReservations) -> _Found | None:
    if isinstance(planning.answer, Layout):
        placed = next(one for one in planning.answer.partitions if one.name == group.name)
        return _Found(group=group, host=system.hosts[placed.host], placed=placed)
    for _, host in sorted(system.hosts.items()):
        if all(one.hosts is None or host.name in one.hosts for one in group.members):
            answer = size(group, host, reservations)
            if isinstance(answer, Sized):
                return _Found(group=group, host=host, placed=answer.placed)
    return None


def _wanted(group: Group, host: Host, reservations: MeasuredReservations) -> LogicalProcessors:
    own = group.wish.cpu.reserve
    if own is None or isinstance(own, Measured):
        answer = reservations.reservation(group.members, host)
        assert not isinstance(answer, NotMeasured), "a partition that has a size has a reservation"
        return in_processors(answer, host.logical_processors)
    return in_processors(own, host.logical_processors)


def _fixed_by(group: Group) -> str:
    own = group.wish.cpu.reserve
    if own is not None and not isinstance(own, Measured):
        return f"the manifest's partition {group.name}"
    names = [one.name for one in group.members if one.cpu.reserve is not None]
    return f"the manifest, for {' and '.join(names)}," if names else ""


def _measured(measured: Measurements, group: Group, host: Host, log: MeasuredTogether) -> shown.Measured:
    members = names_of(group.members)
    subject = subject_of(measured.system, host, members, interference_of(measured.system, members))
    whole = read_log(path_of(measured.folder, subject))
    assert isinstance(whole, DataLog), "what a reservation rests on was read a moment ago"
    bench, times = whole.header.bench, sorted(one.provenance.when for one in whole.recorded)
    return shown.Measured(
        path=log.path,
        first=times[0] if times else "",
        last=times[-1] if times else "",
        reserves=log.measured,
        interference=whole.header.setup.interference,
        processors=log.processors,
        provider=bench.provider.value,
        processor=bench.processor,
        logical_processors=bench.logical_processors,
        smt=bench.smt,
        scheduler=bench.scheduler,
        os_build=bench.os_build,
        again=log.again,
    )


def _looked(group: Group, log: MeasuredTogether) -> Iterator[shown.Looked]:
    for one in group.members:
        for index, threshold in one.apt.items():
            yield shown.Looked(member=one.name, index=index, threshold=threshold, curve=log.curves(one.name, index))


def _why_together(group: Group, system: System) -> Iterator[str]:
    if group.name in system.partitions:
        yield f"the manifest's `partitions` puts them together, as written by hand or by `rarms tune` ({group.name})"
    for one in group.members:
        others = [name for name in one.together if name in names_of(group.members)]
        if others:
            yield f"{one.name} says that it must be together with {', '.join(others)}"


def _apart(measured: Measurements, opened: Opened, group: Group, found: _Found) -> str:
    """What the members would reserve in partitions of their own, and whether that fits, as planned without this one."""
    if group.name not in measured.system.partitions or len(group.members) == 1:
        return ""
    partitions = {name: one for name, one in measured.system.partitions.items() if name != group.name}
    alone = replace(measured, system=replace(measured.system, partitions=partitions))
    reservations = measured_reservations(alone, {})
    names = set(names_of(group.members))
    sizes = [
        size(one, found.host, reservations) for one in groups_of(alone.system) if names & set(names_of(one.members))
    ]
    told = [one.placed for one in sizes if isinstance(one, Sized)]
    if len(told) < len(sizes) or len(sizes) == 1:
        return ""
    fits = isinstance(plan_layout(alone.system, reservations, {}, opened.loaded.places).answer, Layout)
    parts = " and ".join(f"{one.name} {show_processors(one.reserved)}" for one in told)
    total = show_processors(sum((one.reserved for one in told), Fraction(0)))
    return (
        f"apart: {parts}, {total} instead of {show_processors(found.placed.reserved)}; "
        f"{'that fits too' if fits else 'that does not fit'}"
    )


def _on_host(layout: Layout, found: _Found) -> shown.OnHost:
    capacity = capacity_of(found.host, None)
    others = sorted(
        (one.name, one.reserved)
        for one in layout.partitions
        if one.host == found.host.name and one.name != found.placed.name
    )
    kept = LogicalProcessors(Fraction(capacity.logical_processors) - capacity.processors)
    return shown.OnHost(capacity=capacity.processors, kept=kept, beside=tuple(others), placement=layout.placement)


def _misfit(planning: Planning) -> Iterator[str]:
    for one in planning.findings:
        if one.severity.value == "error":
            yield f"{one.summary} ({one.code}): {one.detail} {one.advice}"
