"""Data logs next to the manifest -> report model. Reads no file: the caller hands the logs down."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import assert_never

from rarms_iac.app.declared_hosts import components_without_reservation, partitions_without_log
from rarms_iac.app.report_model import (
    ComponentProof,
    ComponentVerdict,
    FixedReservation,
    IndexCurve,
    MeasuredPoint,
    Measurement,
    PlatformCapacity,
    Report,
)
from rarms_iac.model.host import Host
from rarms_iac.model.indexes import find_index
from rarms_iac.model.outcomes import (
    Met,
    Missed,
    Overload,
    ReservationVerdict,
    TooFewSamples,
    TooManyFailures,
    Unsteady,
    Verdict,
    WithinNoise,
    verdict_word,
)
from rarms_iac.model.quantities import per_virtual_processor
from rarms_iac.model.run import Run
from rarms_iac.model.series import Series
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import Component, System, Threshold, run_of
from rarms_iac.model.totals import sum_of
from rarms_iac.planner.groups import groups_of
from rarms_iac.planner.reservations import MeasuredReservations, depends_on_a_log, fixed, names_of, to_be_measured
from rarms_iac.planner.totals import PlannedTotals
from rarms_iac.statistics.curves import curve_of
from rarms_iac.statistics.distributions import ERROR, describe_extreme
from rarms_iac.statistics.overload import describe_overload
from rarms_iac.statistics.samples import failures
from rarms_iac.statistics.verdicts import judge_look
from rarms_iac.storage.datalog.log import DataLog, Recorded
from rarms_iac.texts.messages import counted, natural_order
from rarms_iac.texts.quantities import show_bytes, show_processors, show_reserve

NO_VERDICT = ReservationVerdict(thresholds=())
"""Of components that share no partition, or whose reserve the manifest fixes."""

WITHOUT_APT = "mean_response_time"
"""What is shown of a component that has no threshold yet."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedLog:
    """A data log with what is known of it."""

    path: str  # below the manifest's folder
    log: DataLog
    is_expected: bool = True  # the planner would look here: these members, this load
    stale: tuple[str, ...] = ()  # what changed since; empty: it holds
    others: int = 0  # settings in the file that were measured under other conditions


def report_of(
    system: System,
    logs: Sequence[ReportedLog],
    proofs: Sequence[ComponentProof],
    planned: PlannedTotals,
    reservations: MeasuredReservations,
) -> Report:
    """Make a report of data logs.

    Args:
        logs: In any order; what they say of components that are gone is left out.
        proofs: What components showed in the applied layout.

    Returns:
        Manifest by platform, falling criticality and name, the load that decides first; amounts in LPs.
    """
    current = [log for log in logs if all(name in system.components for name in log.log.header.setup.members)]
    measurements = _in_order([_measurement(system, logged, reservations) for logged in current])
    verdicts = component_verdicts(system, reservations)
    platforms = sorted(_platforms(system))
    return Report(
        application=system.application.name,
        description=system.application.description,
        measurements=tuple(measurements),
        capacities=tuple(_capacity(system, platform, planned, verdicts) for platform in platforms),
        verdicts=verdicts,
        proofs=tuple(proofs),
    )


def component_verdicts(system: System, reservations: MeasuredReservations) -> tuple[ComponentVerdict, ...]:
    """Return the verdict on each component whose reserve is to be measured, on each platform that it may run on.

    Returns:
        By platform, falling criticality and name. A platform on which nothing is measured counts if all are so.
    """
    found: list[ComponentVerdict] = []
    for group in filter(depends_on_a_log, groups_of(system)):
        hosts = {host.platform: host for host in reversed([*system.hosts.values()]) if group.may_run_on(host.name)}
        by_platform = {name: reservations.verdict(group.members, host) for name, host in sorted(hosts.items())}
        measured = {name: verdict for name, verdict in by_platform.items() if verdict.interference}
        for platform, verdict in (measured or dict([*by_platform.items()][:1])).items():
            found += (
                ComponentVerdict(
                    component=member.name,
                    members=names_of(group.members),
                    platform=platform,
                    achievement=verdict.of(member.name),
                    indexes=verdict.worst_indexes(member.name),
                    not_measured=verdict.not_measured if verdict.interference else (),
                )
                for member in group.members
                if member.name in to_be_measured(group.members)
            )
    components = system.components
    in_order = sorted(found, key=lambda each: (-components[each.component].criticality, natural_order(each.component)))
    return tuple(sorted(in_order, key=lambda each: each.platform))


def missing_on(
    system: System, planned: PlannedTotals, verdicts: Sequence[ComponentVerdict], host: str
) -> tuple[ComponentVerdict, ...]:
    """Return the verdicts on components that count in no host's total, since their reservation is not known.

    Args:
        host: its name; only components that may run there.
    """
    missing, platform = components_without_reservation(system, planned, host), system.hosts[host].platform
    return tuple(each for each in verdicts if each.platform == platform and each.component in missing)


def _in_order(measurements: Sequence[Measurement]) -> Sequence[Measurement]:
    """Return deciding measurements first; of the same components the load that decides, then the others."""
    deciding = {(each.platform, each.components) for each in measurements if each.decides}

    def key(each: Measurement) -> tuple[str, bool, int, str, bool, str]:
        is_compared = (each.platform, each.components) not in deciding
        return each.platform, is_compared, -each.criticality, each.name, not each.decides, each.interference

    return sorted(measurements, key=key)


def _measurement(system: System, logged: ReportedLog, reservations: MeasuredReservations) -> Measurement:
    header = logged.log.header
    members = [system.components[name] for name in header.setup.members]
    names = tuple(member.name for member in members)
    group = next((group for group in groups_of(system) if names_of(group.members) == names), None)
    host = _platforms(system).get(header.platform, [None])[0]
    processors = header.setup.processors
    verdict = reservations.verdict(group.members, host) if group and host and depends_on_a_log(group) else NO_VERDICT
    is_valid = logged.is_expected and not logged.stale
    return Measurement(
        components=names,
        partition=group.name if group else "",
        platform=header.platform,
        interference=header.setup.interference,
        log=logged.path,
        processors=processors,
        criticality=max(member.criticality for member in members),
        decides=is_valid and verdict.interference == header.setup.interference,
        verdict=verdict,
        fixed=names
        if group is not None and not to_be_measured(members) and all(member.cpu.reserve for member in members)
        else (),
        floor=0 if host is None or len(members) == 1 else per_virtual_processor(fixed(members, host), processors),
        stale=logged.stale,
        indexes=tuple(index for member in members for index in _indexes(logged.log, member)),
        settings=logged.log.settings,
        facts=tuple(_facts(logged.log, logged.others)),
    )


def _indexes(log: DataLog, component: Component) -> Iterator[IndexCurve]:
    for name in component.apt or (WITHOUT_APT,):
        index = find_index(name)
        assert index is not None, "the manifest's names of indexes are checked"
        curve = curve_of(log.settings, component.name, name, run_of(component))
        points = points_of(log.counting, component.name, name, component.apt, run_of(component))
        yield IndexCurve(
            component=component.name, index=index, threshold=component.apt.get(name), curve=curve, points=points
        )


def _platforms(system: System) -> Mapping[str, list[Host]]:
    platforms: dict[str, list[Host]] = {}
    for host in system.hosts.values():
        platforms.setdefault(host.platform, []).append(host)
    return platforms


def _capacity(
    system: System, platform: str, planned: PlannedTotals, verdicts: Sequence[ComponentVerdict]
) -> PlatformCapacity:
    hosts = tuple(sorted((host.name for host in _platforms(system)[platform]), key=natural_order))
    total = sum_of(planned.hosts[name] for name in hosts)
    return PlatformCapacity(
        platform=platform,
        hosts=hosts,
        processors=total.host_lp,
        capacity_lp=total.capacity_lp,
        fixed=tuple(
            FixedReservation(
                name=partition.name,
                components=tuple(sorted(partition.components)),
                reserved_lp=partition.reserved,
                thresholds=tuple(
                    (name, index, threshold)
                    for name in sorted(partition.components)
                    for index, threshold in system.components[name].apt.items()
                ),
            )
            for partition in partitions_without_log(system, planned, hosts)
        ),
        reserved_lp=total.reserved_lp,
        unmanaged_lp=total.unmanaged_lp,
        partitions=tuple(partition.name for partition in planned.partitions if partition.host in hosts),
        unknown=tuple(dict.fromkeys(each for host in hosts for each in missing_on(system, planned, verdicts, host))),
    )


def _facts(log: DataLog, others: int) -> Iterator[tuple[str, str]]:
    platform, setup = log.header.platform_facts, log.header.setup
    when = sorted(recorded.provenance.when for recorded in log.counting)
    if when:
        yield "Measured", when[0] if when[0] == when[-1] else f"{when[0]} to {when[-1]}"
        yield "By rarms", ", ".join(sorted({recorded.provenance.rarms_version for recorded in log.counting}))
    yield (
        "Machine",
        f"{platform.processor}, {show_processors(platform.logical_processors)}{', SMT' if platform.smt else ''}",
    )
    yield "Provider", f"{platform.provider.value}, scheduler {platform.scheduler.value}"
    if platform.os_build:
        yield "Build of the operating system", str(platform.os_build)
    if platform.guest_image:
        yield "Guest image", platform.guest_image
    yield "Partition", f"{setup.processors} VPs, {show_bytes(setup.memory)}"
    yield "Limit and weight", f"{show_reserve(setup.limit, setup.processors)}, {setup.weight}"
    running = sorted({name for recorded in log.counting for name in recorded.provenance.beside})
    if running:
        yield "Also running", ", ".join(running)
    yield "Conditions", log.header.digest
    if others:
        yield "Measured under other conditions", f"{counted(others, 'setting')}, not used"


def points_of(
    recorded: tuple[Recorded, ...], component: str, index: str, apt: Mapping[str, Threshold], run: Run
) -> tuple[MeasuredPoint, ...]:
    """Return a point for each setting in which a component was measured, by reserve.

    Args:
        recorded: The settings, in the order in which they were measured.
        apt: The thresholds of the component; without the index nothing is judged.
        run: How the component is run; it decides what counts of a sample.

    Returns:
        Ascending; of equal reserves the earlier one first.
    """
    points = [
        point_of(entry.setting, series, index, {index: apt[index]} if index in apt else {}, run)
        for entry in recorded
        for series in entry.setting.series
        if series.component == component
    ]
    return tuple(sorted(points, key=lambda point: point.reserve))


def point_of(setting: Setting, series: Series, index: str, apt: Mapping[str, Threshold], run: Run) -> MeasuredPoint:
    """Return value, bounds and verdict of one setting for an index of a component.

    Args:
        apt: its threshold alone; empty: no verdict.
    """
    estimates = curve_of([setting], series.component, index, run).estimates
    verdict = judge_look(series, apt, run)
    point = MeasuredPoint(
        reserve=setting.reserve,
        samples=len(series.samples),
        failed=len(failures(series)),
        verdict=verdict_word(verdict) if apt else None,
        remark=_remark(verdict),
        response_ms=tuple(
            sample.response_ms for sample in series.samples if sample.successful and sample.response_ms is not None
        ),
    )
    if not estimates:
        return point
    [estimate] = estimates
    beyond = "" if estimate.beyond is None else describe_extreme(estimate.beyond)
    return replace(
        point,
        value=estimate.value,
        low=estimate.lower,
        high=estimate.upper,
        effective=estimate.effective_samples,
        error=ERROR if apt and isinstance(verdict, Met | Missed) else None,
        remark="; ".join(text for text in (point.remark, beyond) if text),
    )


def _remark(verdict: Verdict) -> str:
    """Return further facts about a verdict."""
    match verdict:
        case Missed(overload=Overload() as overload):
            return describe_overload(overload)
        case Met(warm_up=warm_up) | Missed(warm_up=warm_up) | WithinNoise(warm_up=warm_up):
            return f"{warm_up} warm-up samples omitted" if warm_up else ""
        case Unsteady(reason=reason) | TooFewSamples(reason=reason):
            return reason
        case TooManyFailures(failures=failed, allowed=allowed):
            return f"{len(failed)} failed, {allowed} allowed"
        case _:
            assert_never(verdict)
