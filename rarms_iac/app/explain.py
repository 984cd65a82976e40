"""What `rarms explain COMPONENT` walks through, gathered from manifest, data logs, hosts and the layout."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from rarms_iac.app import explanation
from rarms_iac.app.data_logs import Measurements, measured_reservations, path_of, subject_of
from rarms_iac.app.errors import Outcome, UseCaseError
from rarms_iac.app.hosts import Hosts, observe_hosts
from rarms_iac.app.tuning_log import NOT_LOOKED_FOR, shared, tuned_before, why_together
from rarms_iac.measuring.setup import interference_of
from rarms_iac.model.capacity import capacity_of, load_of
from rarms_iac.model.diagnostics import Diagnostic, has_errors
from rarms_iac.model.layout import Cause, Layout, PlacedPartition
from rarms_iac.model.quantities import LogicalProcessors, ProcessorTime, in_processors, show_processors
from rarms_iac.model.state import State
from rarms_iac.model.system import Component, Disruption, Host, Measured, System
from rarms_iac.planner.alternatives import Chosen, Elsewhere, elsewhere
from rarms_iac.planner.groups import Group, groups_of, may_share
from rarms_iac.planner.layout import Planning, plan_layout
from rarms_iac.planner.placing.first_fit import cost
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
from rarms_iac.planner.sizes import Sized, size
from rarms_iac.storage.datalog.files import read_log
from rarms_iac.storage.datalog.log import DataLog

TOLD = 3


def partners(
    group: Group,
    groups: Sequence[Group],
    host: Host,
    reservations: MeasuredReservations,
    was_measured: Callable[[Names], bool],
) -> tuple[str, ...]:
    """The pairs that would save most, if what their members do alone is a guide; the most first.

    Only pairs of which nothing was measured: of others the data log says more.
    """
    others = [one for one in groups if one.name != group.name and may_share(group, one)]
    others = [other for other in others if not was_measured(names_of((*group.members, *other.members)))]
    predictor = predictor_of(alone_in(groups, reservations, host))
    found = [_told(group, other, host, reservations, predictor) for other in others]
    return tuple(says for _, says in sorted(one for one in found if one is not None)[:TOLD])


def _told(
    group: Group, other: Group, host: Host, reservations: MeasuredReservations, predictor: Predictor
) -> tuple[int, str] | None:
    """With what it saves, below 0, in per cent of one logical processor; None: nothing, or nothing says so."""
    sizes = [size(one, host, reservations) for one in (group, other)]
    claims = [size.claim for size in sizes if isinstance(size, Sized)]
    if len(claims) < len(sizes):
        return None
    costs, processors = [cost(claim) for claim in claims], max(claim.processors for claim in claims)
    together = expected_of(predictor, names_of((*group.members, *other.members)), processors, costs)
    if together is None or together * processors >= sum(costs):
        return None
    apart, now = (show_processors(Fraction(one, 100)) for one in (sum(costs), together * processors))
    says = f"sharing with {other.name}: predicted {now} instead of {apart} apart; `rarms tune` measures it"
    return together * processors - sum(costs), says


@dataclass(frozen=True, slots=True, kw_only=True)
class Explained:
    """The walk, and what keeps it from an end."""

    walk: explanation.Explanation | explanation.HostExplanation
    errors: tuple[Diagnostic, ...] = ()  # why nothing can be said of how much it needs

    @property
    def fits(self) -> bool:
        """Whether there is a layout with it."""
        return isinstance(self.walk, explanation.HostExplanation) or not self.walk.misfit


@dataclass(frozen=True, slots=True, kw_only=True)
class _Asked:
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
class _Found:
    """Where the partition is, or would be if there were room, or if it were known how much it needs."""

    host: Host
    placed: PlacedPartition
    cannot: str = ""  # why no host can have it


def explained(measured: Measurements, hosts: Hosts, component: Component) -> Explained:
    """The walk of a component, as `rarms plan` places it; hosts that cannot be looked at count by the manifest alone.

    Raises:
        UseCaseError: its partition has no host at all (4).
    """
    system = measured.system
    group = next((one for one in groups_of(system) if component.name in names_of(one.members)), None)
    if group is None:
        allowed = component.hosts if component.hosts is not None else system.hosts
        homes = tuple(host for host in by_name(system.hosts) if host.name in allowed)
        return Explained(walk=explanation.HostExplanation(component=component, hosts=homes))
    states = observe_hosts(hosts, needed=())
    reservations = measured_reservations(measured, states)
    views = {name: host_view(state, system.application.name) for name, state in states.items()}
    planning = plan_layout(system, reservations, views, hosts.manifest.places)
    asked = _Asked(
        measured=measured, hosts=hosts, states=states, reservations=reservations, planning=planning, group=group
    )
    found = _found(asked)
    errors = tuple(finding for finding in planning.findings if has_errors([finding])) if found.cannot else ()
    return Explained(walk=_walk(asked, found, component), errors=errors)


def _walk(asked: _Asked, found: _Found, component: Component) -> explanation.Explanation:
    group, reservations, layout = asked.group, asked.reservations, asked.layout
    log = reservations.log(group.members, found.host)
    rests = rests_on_a_log(group)
    used = log if rests and isinstance(log, MeasuredTogether) else None
    before = tuned_before(asked.measured.folder, found.host.platform)
    return explanation.Explanation(
        component=component,
        group=group,
        host=found.host,
        placed=found.placed,
        cannot=found.cannot,
        wanted=_wanted(group, found.host, reservations),
        fixed_by="" if rests else _fixed_by(group),
        measured=None if used is None else _measured(asked.measured, group, found.host, used),
        looked=() if used is None else tuple(_looked(group, used)),
        least=None if used is None else reservations.least(group.members, found.host),
        remarks=() if used is None else tuple(remark.says for remark in used.remarks),
        why_together=tuple(why_together(group, asked.system, before)),
        apart=_apart(asked, found),
        shared=tuple(shared(group, before, found.host)) if rests else (NOT_LOOKED_FOR,),
        partners=()
        if used is None
        else partners(
            group, groups_of(asked.system), found.host, reservations, _was_measured(asked.measured, found.host)
        ),
        on_host=None if layout is None else _on_host(asked, layout, found),
        where_now=_where_now(asked, found),
        unseen=tuple(sorted(set(asked.system.hosts) - set(asked.states))),
        elsewhere=_elsewhere(asked, found),
        misfit=() if layout is not None else tuple(_misfit(asked.planning)),
    )


def _was_measured(measured: Measurements, host: Host) -> Callable[[Names], bool]:
    def has_log(names: Names) -> bool:
        subject = subject_of(measured.system, host, names, interference_of(measured.system, names))
        return path_of(measured.folder, subject).is_file()

    return has_log


def _found(asked: _Asked) -> _Found:
    """In the layout; else where it is, or the first host by name that could have it, or that it may run on."""
    system, group = asked.system, asked.group
    if asked.layout is not None:
        placed = next(partition for partition in asked.layout.partitions if partition.name == group.name)
        return _Found(host=system.hosts[placed.host], placed=placed)
    allowed = [
        host
        for host in sorted(system.hosts.values(), key=lambda one: (one.name != asked.now, one.name))
        if all(member.hosts is None or host.name in member.hosts for member in group.members)
    ]
    answers = [(host, size(group, host, asked.reservations)) for host in allowed]
    for host, answer in answers:
        if isinstance(answer, Sized):
            return _Found(host=host, placed=answer.placed)
    for host, answer in answers:
        shape = size(_without_reserve(group), host, FixedReservations())
        if isinstance(shape, Sized) and isinstance(answer, Cause):
            return _Found(host=host, placed=shape.placed, cannot=answer.says.rstrip("."))
    raise UseCaseError(Outcome.NEGATIVE, asked.planning.findings, asked.hosts.manifest.sources)


def _without_reserve(group: Group) -> Group:
    """The same reserving nothing: what else it gets does not wait for that."""
    nothing = ProcessorTime(LogicalProcessors(Fraction(0)))
    return replace(group, wish=replace(group.wish, cpu=replace(group.wish.cpu, reserve=nothing)))


def _wanted(group: Group, host: Host, reservations: MeasuredReservations) -> LogicalProcessors | None:
    own = group.wish.cpu.reserve
    if own is None or isinstance(own, Measured):
        answer = reservations.reservation(group.members, host)
        return None if isinstance(answer, NotMeasured) else in_processors(answer, host.logical_processors)
    return in_processors(own, host.logical_processors)


def _fixed_by(group: Group) -> str:
    own = group.wish.cpu.reserve
    if own is not None and not isinstance(own, Measured):
        return f"the manifest's partition {group.name}"
    names = [member.name for member in group.members if member.cpu.reserve is not None]
    return f"the manifest, for {' and '.join(names)}," if names else ""


def _measured(measured: Measurements, group: Group, host: Host, log: MeasuredTogether) -> explanation.DataLogSummary:
    members = names_of(group.members)
    subject = subject_of(measured.system, host, members, interference_of(measured.system, members))
    whole = read_log(path_of(measured.folder, subject))
    assert isinstance(whole, DataLog), "what a reservation rests on was read a moment ago"
    bench, times = whole.header.bench, sorted(one.provenance.when for one in whole.recorded)
    return explanation.DataLogSummary(
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


def _looked(group: Group, log: MeasuredTogether) -> Iterator[explanation.MemberCurve]:
    for member in group.members:
        for index, threshold in member.apt.items():
            yield explanation.MemberCurve(
                member=member.name, index=index, threshold=threshold, curve=log.curves(member.name, index)
            )


def _apart(asked: _Asked, found: _Found) -> str:
    """What the members would reserve in partitions of their own, and whether that fits, as planned without this one."""
    group, measured = asked.group, asked.measured
    if group.name not in measured.system.partitions or len(group.members) == 1:
        return ""
    partitions = {name: request for name, request in measured.system.partitions.items() if name != group.name}
    alone = replace(measured, system=replace(measured.system, partitions=partitions))
    reservations = measured_reservations(alone, asked.states)
    names = set(names_of(group.members))
    sizes = [
        size(one, found.host, reservations) for one in groups_of(alone.system) if names & set(names_of(one.members))
    ]
    told = [size.placed for size in sizes if isinstance(size, Sized)]
    if len(told) < len(sizes) or len(sizes) == 1:
        return ""
    places = asked.hosts.manifest.places
    fits = isinstance(plan_layout(alone.system, reservations, asked.views, places).answer, Layout)
    parts = " and ".join(f"{partition.name} {show_processors(partition.reserved)}" for partition in told)
    total = show_processors(sum((partition.reserved for partition in told), Fraction(0)))
    return (
        f"apart: {parts}, {total} instead of {show_processors(found.placed.reserved)}; "
        f"{'that fits too' if fits else 'that does not fit'}"
    )


def _on_host(asked: _Asked, layout: Layout, found: _Found) -> explanation.HostPromises:
    view = asked.views.get(found.host.name, HostView())
    capacity = capacity_of(found.host, view.facts)
    others = sorted(
        (partition.name, partition.reserved)
        for partition in layout.partitions
        if partition.host == found.host.name and partition.name != found.placed.name
    )
    kept = LogicalProcessors(Fraction(capacity.logical_processors) - capacity.processors)
    foreign = LogicalProcessors(Fraction(load_of(view.claims).percent, 100))
    return explanation.HostPromises(
        capacity=capacity.processors, kept=kept, foreign=foreign, beside=tuple(others), placement=layout.placement
    )


def _where_now(asked: _Asked, found: _Found) -> str:
    if not asked.now:
        return ""
    if asked.now != found.host.name:
        return f"it is on {asked.now} now: applied, it is made anew on {found.host.name}"
    return asked.stays or "it is there now"


def _elsewhere(asked: _Asked, found: _Found) -> tuple[Elsewhere, ...]:
    chosen = Chosen(placed=found.placed, layout=asked.layout, views=asked.views, stays=asked.stays)
    return elsewhere(asked.group, chosen, asked.system, asked.reservations)


def _misfit(planning: Planning) -> Iterator[str]:
    for finding in planning.findings:
        if has_errors([finding]):
            yield f"{finding.summary} ({finding.code}): {finding.detail} {finding.advice}"
