"""How a component comes to what it gets, gathered from manifest, data logs, hosts and the layout.

Begin at `explain_component`; the values that it returns are in `explanation`.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from rarms_iac.app.data_logs import Measurements, measured_reservations, measurements_of, path_of, subject_of
from rarms_iac.app.errors import Outcome, RequestError, UseCaseError
from rarms_iac.app.explanation import DataLogSummary, Explanation, HostExplanation, HostPromises, MemberCurve
from rarms_iac.app.hosts import Hosts, observe_hosts, select_hosts
from rarms_iac.app.manifests import Manifest
from rarms_iac.app.requests import HostSelection
from rarms_iac.app.tuning_log import NOT_LOOKED_FOR, previous_tuning, rejected_compounds, why_together
from rarms_iac.measuring.setup import interference_of
from rarms_iac.model.capacity import capacity_of
from rarms_iac.model.claims import load_of
from rarms_iac.model.diagnostics import Diagnostic, has_errors
from rarms_iac.model.layout import Cause, Layout, PlacedPartition
from rarms_iac.model.quantities import LogicalProcessors, ProcessorTime, in_processors, show_lp_percent, show_processors
from rarms_iac.model.state import State
from rarms_iac.model.system import Component, Disruption, Host, Measured, System
from rarms_iac.model.wording import suggestion
from rarms_iac.planner.alternatives import ChosenPlace, Elsewhere, elsewhere
from rarms_iac.planner.groups import Group, groups_of, may_share
from rarms_iac.planner.layout import Planning, plan_layout
from rarms_iac.planner.packing.values import cost
from rarms_iac.planner.prediction.members import Predictor, alone_in, expected_of, predictor_of
from rarms_iac.planner.problem import HostView, by_name, host_view
from rarms_iac.planner.reservations import (
    FixedReservations,
    MeasuredReservations,
    MeasuredTogether,
    Names,
    NotMeasured,
    names_of,
    rests_on_a_log,
)
from rarms_iac.planner.sizes import size
from rarms_iac.statistics.curves import LeastReserve
from rarms_iac.storage.datalog.files import read_log
from rarms_iac.storage.datalog.log import DataLog
from rarms_iac.storage.finding_pages import known_codes


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplainedComponent:
    """The explanation, and what keeps it from an end."""

    explanation: Explanation | HostExplanation
    errors: tuple[Diagnostic, ...] = ()  # why nothing can be said of how much it needs

    @property
    def fits(self) -> bool:
        """Whether there is a layout with it."""
        return isinstance(self.explanation, HostExplanation) or not self.explanation.infeasibility


@dataclass(frozen=True, slots=True, kw_only=True)
class _KnownOfPartition:
    """What is known when a partition is explained."""

    measured: Measurements
    hosts: Hosts
    states: Mapping[str, State]  # of the hosts that could be looked at
    reservations: MeasuredReservations
    planning: Planning
    group: Group

    @property
    def system(self) -> System:
        """What the manifest says."""
        return self.measured.system

    @property
    def views(self) -> Mapping[str, HostView]:
        """The hosts as the planner looks at them."""
        return {name: host_view(state, self.system.application.name) for name, state in self.states.items()}

    @property
    def layout(self) -> Layout | None:
        """None: there is none."""
        return self.planning.answer if isinstance(self.planning.answer, Layout) else None

    @property
    def now(self) -> str:
        """The host that the partition is on now, the first by name; empty: none that was looked at."""
        return next((name for name, view in sorted(self.views.items()) if self.group.name in view.present), "")

    @property
    def stays(self) -> str:
        """Why it may only be where it is; empty: it may be elsewhere."""
        if not self.now or self.system.policy.max_disruption is Disruption.REMOVAL:
            return ""
        return f"it stays on {self.now}, where it is: a move is a removal, and policy.max_disruption forbids that"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Placement:
    """Where the partition is, or would be if there were room, or if it were known how much it needs."""

    host: Host
    placed: PlacedPartition
    no_host_because: str = ""  # why no host can have it


def find_component(manifest: Manifest, name: str) -> Component:
    """Return a component of the manifest by its name.

    Raises:
        RequestError: There is none; the message offers the nearest component or finding.
    """
    component = manifest.system.components.get(name)
    if component is None:
        nearest = suggestion(name, (*manifest.system.components, *known_codes()))
        raise RequestError(f'The manifest has no component "{name}", and no finding is called so.{nearest}')
    return component


def explain_component(manifest: Manifest, name: str) -> ExplainedComponent:
    """Explain how a component comes to what it gets, as a plan places it.

    Args:
        manifest: Its hosts are looked at; those that cannot be count by what the manifest says.
        name: Of the component.

    Raises:
        RequestError: There is no such component.
        UseCaseError: Its partition has no host at all (negative).
    """
    component, measured, system = find_component(manifest, name), measurements_of(manifest), manifest.system
    hosts = select_hosts(manifest, HostSelection())
    group = next((group for group in groups_of(system) if name in names_of(group.members)), None)
    if group is None:
        allowed = component.hosts if component.hosts is not None else system.hosts
        homes = tuple(host for host in by_name(system.hosts) if host.name in allowed)
        return ExplainedComponent(explanation=HostExplanation(component=component, hosts=homes))
    states = observe_hosts(hosts, needed=())
    reservations = measured_reservations(measured, states)
    views = {name: host_view(state, system.application.name) for name, state in states.items()}
    planning = plan_layout(system, reservations, views, hosts.manifest.places)
    known = _KnownOfPartition(
        measured=measured, hosts=hosts, states=states, reservations=reservations, planning=planning, group=group
    )
    placement = _placement_of(known)
    errors = (
        tuple(finding for finding in planning.findings if has_errors([finding])) if placement.no_host_because else ()
    )
    return ExplainedComponent(explanation=_explanation(known, placement, component), errors=errors)


def _explanation(known: _KnownOfPartition, placement: _Placement, component: Component) -> Explanation:
    group, reservations, layout = known.group, known.reservations, known.layout
    log = reservations.log(group.members, placement.host)
    rests = rests_on_a_log(group)
    used = log if rests and isinstance(log, MeasuredTogether) else None
    beside_fixed = None if rests else _log_beside_fixed(known, placement.host)
    previous = previous_tuning(known.measured, placement.host)
    return Explanation(
        component=component,
        group=group,
        host=placement.host,
        placed=placement.placed,
        no_host_because=placement.no_host_because,
        wanted=_wanted(group, placement.host, reservations),
        fixed_by="" if rests else _fixed_by(group),
        measured=None if used is None else _data_log_summary(known.measured, group, placement.host, used),
        curves=() if used is None else tuple(_member_curves(group, used)),
        least=None if used is None else reservations.least(group.members, placement.host),
        beside_fixed=None if beside_fixed is None else beside_fixed[0],
        least_beside_fixed=None if beside_fixed is None else beside_fixed[1],
        remarks=() if used is None else tuple(remark.says for remark in used.remarks),
        why_together=tuple(why_together(group, known.system, previous)),
        apart=_apart(known, placement),
        shared=tuple(rejected_compounds(group, previous, placement.host)) if rests else (NOT_LOOKED_FOR,),
        partners=()
        if used is None
        else _partners(
            group, groups_of(known.system), placement.host, reservations, _was_measured(known.measured, placement.host)
        ),
        on_host=None if layout is None else _on_host(known, layout, placement),
        current_host=_where_now(known, placement),
        not_observed=tuple(sorted(set(known.system.hosts) - set(known.states))),
        elsewhere=_elsewhere(known, placement),
        infeasibility=() if layout is not None else tuple(_misfit(known.planning)),
    )


def _log_beside_fixed(known: _KnownOfPartition, host: Host) -> tuple[DataLogSummary, LeastReserve | None] | None:
    """The data log of a partition whose reserve is fixed, and the least that is enough by it; None: there is none."""
    group, system = known.group, known.system
    measured_members = {
        member.name: replace(member, cpu=replace(member.cpu, reserve=Measured.MEASURED))
        for member in group.members
        if member.apt
    }
    partitions = {
        name: replace(partition, cpu=replace(partition.cpu, reserve=None)) if name == group.name else partition
        for name, partition in system.partitions.items()
    }
    unfixed = replace(system, components={**system.components, **measured_members}, partitions=partitions)
    measured = replace(known.measured, system=unfixed)
    members = tuple(unfixed.components[name] for name in names_of(group.members))
    reservations = measured_reservations(measured, known.states)
    log = reservations.log(members, host)
    if not isinstance(log, MeasuredTogether):
        return None
    return _data_log_summary(measured, group, host, log), reservations.least(members, host)


def _was_measured(measured: Measurements, host: Host) -> Callable[[Names], bool]:
    def has_log(names: Names) -> bool:
        subject = subject_of(measured.system, host, names, interference_of(measured.system, names))
        return path_of(measured.folder, subject).is_file()

    return has_log


def _placement_of(known: _KnownOfPartition) -> _Placement:
    """In the layout; else where it is, or the first host by name that could have it, or that it may run on."""
    system, group = known.system, known.group
    if known.layout is not None:
        placed = next(partition for partition in known.layout.partitions if partition.name == group.name)
        return _Placement(host=system.hosts[placed.host], placed=placed)
    allowed = [
        host
        for host in sorted(system.hosts.values(), key=lambda host: (host.name != known.now, host.name))
        if all(member.hosts is None or host.name in member.hosts for member in group.members)
    ]
    answers = [(host, size(group, host, known.reservations)) for host in allowed]
    for host, answer in answers:
        if isinstance(answer, PlacedPartition):
            return _Placement(host=host, placed=answer)
    for host, answer in answers:
        shape = size(_without_reserve(group), host, FixedReservations())
        if isinstance(shape, PlacedPartition) and isinstance(answer, Cause):
            return _Placement(host=host, placed=shape, no_host_because=answer.says.rstrip("."))
    raise UseCaseError(Outcome.NEGATIVE, known.planning.findings, known.hosts.manifest.sources)


def _without_reserve(group: Group) -> Group:
    """Return the partition with no reservation: what else it gets can be told before that is measured."""
    nothing = ProcessorTime(LogicalProcessors(Fraction(0)))
    return replace(group, request=replace(group.request, cpu=replace(group.request.cpu, reserve=nothing)))


def _wanted(group: Group, host: Host, reservations: MeasuredReservations) -> LogicalProcessors | None:
    own = group.request.cpu.reserve
    if own is None or isinstance(own, Measured):
        answer = reservations.reservation(group.members, host)
        return None if isinstance(answer, NotMeasured) else in_processors(answer, host.logical_processors)
    return in_processors(own, host.logical_processors)


def _fixed_by(group: Group) -> str:
    own = group.request.cpu.reserve
    if own is not None and not isinstance(own, Measured):
        return f"the manifest's partition {group.name}"
    names = [member.name for member in group.members if member.cpu.reserve is not None]
    return f"the manifest, for {' and '.join(names)}," if names else ""


def _data_log_summary(measured: Measurements, group: Group, host: Host, log: MeasuredTogether) -> DataLogSummary:
    members = names_of(group.members)
    subject = subject_of(measured.system, host, members, interference_of(measured.system, members))
    whole = read_log(path_of(measured.folder, subject))
    assert isinstance(whole, DataLog), "what a reservation rests on was read a moment ago"
    bench, times = whole.header.bench, sorted(recorded.provenance.when for recorded in whole.recorded)
    return DataLogSummary(
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


def _member_curves(group: Group, log: MeasuredTogether) -> Iterator[MemberCurve]:
    for member in group.members:
        for index, threshold in member.apt.items():
            yield MemberCurve(
                member=member.name, index=index, threshold=threshold, curve=log.curves(member.name, index)
            )


def _apart(known: _KnownOfPartition, placement: _Placement) -> str:
    """Say what the members would reserve in partitions of their own, and whether that fits.

    For this the layout is planned without the partition.
    """
    group, measured = known.group, known.measured
    if group.name not in measured.system.partitions or len(group.members) == 1:
        return ""
    partitions = {name: request for name, request in measured.system.partitions.items() if name != group.name}
    alone = replace(measured, system=replace(measured.system, partitions=partitions))
    reservations = measured_reservations(alone, known.states)
    names = set(names_of(group.members))
    sizes = [
        size(part, placement.host, reservations)
        for part in groups_of(alone.system)
        if names & set(names_of(part.members))
    ]
    placed = [answer for answer in sizes if isinstance(answer, PlacedPartition)]
    if len(placed) < len(sizes) or len(sizes) == 1:
        return ""
    places = known.hosts.manifest.places
    fits = isinstance(plan_layout(alone.system, reservations, known.views, places).answer, Layout)
    parts = " and ".join(f"{partition.name} {show_processors(partition.reserved)}" for partition in placed)
    total = show_processors(sum((partition.reserved for partition in placed), Fraction(0)))
    return (
        f"apart: {parts}, {total} instead of {show_processors(placement.placed.reserved)}; "
        f"{'that fits too' if fits else 'that does not fit'}"
    )


def _on_host(known: _KnownOfPartition, layout: Layout, placement: _Placement) -> HostPromises:
    view = known.views.get(placement.host.name, HostView())
    capacity = capacity_of(placement.host, view.facts)
    others = sorted(
        (partition.name, partition.reserved)
        for partition in layout.partitions
        if partition.host == placement.host.name and partition.name != placement.placed.name
    )
    kept = LogicalProcessors(Fraction(capacity.logical_processors) - capacity.processors)
    unmanaged = LogicalProcessors(Fraction(load_of(view.claims).percent, 100))
    return HostPromises(
        capacity=capacity.processors,
        kept_for_host=kept,
        unmanaged=unmanaged,
        beside=tuple(others),
        placement=layout.placement,
    )


def _where_now(known: _KnownOfPartition, placement: _Placement) -> str:
    if not known.now:
        return ""
    if known.now != placement.host.name:
        return f"it is on {known.now} now: applied, it is made anew on {placement.host.name}"
    return known.stays or "it is there now"


def _elsewhere(known: _KnownOfPartition, placement: _Placement) -> tuple[Elsewhere, ...]:
    chosen = ChosenPlace(placed=placement.placed, layout=known.layout, views=known.views, stays=known.stays)
    return elsewhere(known.group, chosen, known.system, known.reservations)


def _misfit(planning: Planning) -> Iterator[str]:
    for finding in planning.findings:
        if has_errors([finding]):
            yield f"{finding.summary} ({finding.code}): {finding.detail} {finding.advice}"


MOST_PARTNERS = 3


def _partners(
    group: Group,
    groups: Sequence[Group],
    host: Host,
    reservations: MeasuredReservations,
    was_measured: Callable[[Names], bool],
) -> tuple[str, ...]:
    """The pairs that would save most, if what their members do alone is a guide; the most first.

    Only pairs of which nothing was measured: of others the data log says more.
    """
    others = [other for other in groups if other.name != group.name and may_share(group, other)]
    others = [other for other in others if not was_measured(names_of((*group.members, *other.members)))]
    predictor = predictor_of(alone_in(groups, reservations, host))
    savings = [_saving(group, other, host, reservations, predictor) for other in others]
    return tuple(message for _, message in sorted(saving for saving in savings if saving is not None)[:MOST_PARTNERS])


def _saving(
    group: Group, other: Group, host: Host, reservations: MeasuredReservations, predictor: Predictor
) -> tuple[int, str] | None:
    """With what it saves, below 0, in per cent of one logical processor; None: nothing, or nothing says so."""
    sizes = [size(part, host, reservations) for part in (group, other)]
    claims = [answer.claim for answer in sizes if isinstance(answer, PlacedPartition)]
    if len(claims) < len(sizes):
        return None
    costs, processors = [cost(claim) for claim in claims], max(claim.processors for claim in claims)
    together = expected_of(predictor, names_of((*group.members, *other.members)), processors, costs)
    if together is None or together * processors >= sum(costs):
        return None
    apart, now = map(show_lp_percent, (sum(costs), together * processors))
    message = f"sharing with {other.name}: predicted {now} instead of {apart} apart; `rarms tune` measures it"
    return together * processors - sum(costs), message
