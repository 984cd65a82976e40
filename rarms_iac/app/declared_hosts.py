"""What can be said without waiting for a host: whether a manifest fits its hosts, and what a plan would promise.

Only files below the manifest's folder are read, simulated hosts among them, and no solver is asked: what takes a search
to say is left to `rarms plan`, which says the same of the hosts as they are.
"""

from collections import Counter
from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction

from rarms_iac.app.data_logs import measured_reservations
from rarms_iac.app.hosts import observe_host, select_hosts
from rarms_iac.app.manifests import Manifest
from rarms_iac.app.requests import HostSelection
from rarms_iac.app.use_case_errors import UseCaseError
from rarms_iac.model.commands import MEASURE, PLAN, prose
from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.host import Host, ProviderKind
from rarms_iac.model.layout import Infeasible, LookedUp, PlacedPartition
from rarms_iac.model.quantities import in_processors
from rarms_iac.model.seen_host import unseen
from rarms_iac.model.state import State
from rarms_iac.model.system import Component, Measured, RunsOn, System
from rarms_iac.planner import planning_findings
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.infeasibility.causes import evident_causes
from rarms_iac.planner.layout import causes_as_findings, remarks_as_findings
from rarms_iac.planner.problem import Problem, problem_of
from rarms_iac.planner.reservations import (
    FixedReservations,
    MeasuredReservations,
    ReservationSource,
    depends_on_a_log,
    fixed,
    names_of,
    to_be_measured,
)
from rarms_iac.planner.totals import PlannedTotals, planned_totals
from rarms_iac.planner.verdicts import NotMeasured
from rarms_iac.texts.findings import OVER_HOST, UNUSABLE_RESERVE, Finding


def states_at_hand(manifest: Manifest) -> Mapping[str, State]:
    """Look at the hosts that are files of this machine: the simulated ones. No other is asked, and none is waited for.

    Returns:
        By name; one whose file is damaged is left out: every command that is about hosts says so.
    """
    states: dict[str, State] = {}
    hosts = select_hosts(manifest, HostSelection())
    for name, host in sorted(manifest.system.hosts.items()):
        if host.provider is ProviderKind.SIMULATED:
            with suppress(UseCaseError):
                states[name] = observe_host(hosts.open(name))
    return states


def totals_at_hand(manifest: Manifest) -> tuple[PlannedTotals, MeasuredReservations]:
    """Add up what a plan would have the hosts promise, by the data logs next to the manifest.

    Returns:
        The totals of every host, and the reservations that they count. Hosts that would have to be waited for count as
            the manifest has them.
    """
    states = states_at_hand(manifest)
    reservations = measured_reservations(manifest, states)
    return planned_totals(manifest.system, reservations, states), reservations


def partitions_without_log(system: System, planned: PlannedTotals, hosts: Collection[str]) -> Iterator[PlacedPartition]:
    """Yield the partitions on these hosts whose reservation the manifest itself says, by name.

    Yields:
        Those that reserve something.
    """
    here = {partition.name: partition for partition in planned.partitions if partition.host in hosts}
    for group in groups_of(system):
        partition = here.get(group.name)
        if partition is not None and partition.reserved and not depends_on_a_log(group):
            yield partition


def components_without_reservation(system: System, planned: PlannedTotals, host: str) -> tuple[str, ...]:
    """Name the components whose partition counts in no host's total, since what it reserves is not known.

    Returns:
        Those that may run on this host, by name.
    """
    planned_names = {partition.name for partition in planned.partitions}
    return tuple(
        sorted(
            member.name
            for group in groups_of(system)
            if group.name not in planned_names
            for member in group.members
            if member.may_run_on(host)
        )
    )


NOT_YET_MEASURED = Finding.note("RARMS101", "The reserve has not been measured yet")

LOOKED_AT = 2_000
"""Components times hosts that are looked at closely; of more, only where their sum exceeds all hosts together."""

_TOO_LARGE = frozenset({OVER_HOST.code, UNUSABLE_RESERVE.code})
_ADVICE = prose("Lower a reserve, or combine components in a partition; ", PLAN, " finds a change that is enough.")


def declared_host_findings(manifest: Manifest, errors: Sequence[Diagnostic]) -> Iterator[Diagnostic]:
    """Report what the declared hosts cannot give, and what data logs lack.

    Args:
        errors: that are known already: nothing is reported again of what they are about.

    Yields:
        Errors for providers that rarms does not have, reservations and memory that exceed the hosts, and stale or
        damaged logs; warnings and notes on logs that hold; a note for what was never measured.
    """
    system, places = manifest.system, manifest.places
    depends_on_logs = any(component.cpu.reserve is Measured.MEASURED for component in system.components.values())
    if (
        not depends_on_logs
        and len(system.components) * len(system.hosts) > LOOKED_AT
        and not _exceeds_all_hosts(system)
    ):
        return
    source = measured_reservations(manifest, {}) if depends_on_logs else FixedReservations()
    problem = problem_of(system, _AtLeast(source=source), {}, may_move=True)
    blamed = {error.address for error in errors}
    right = [group for group in problem.groups if not _is_about(group, blamed)]
    yield from _about_logs(right, problem, source, places)
    causes = [cause for group in right for cause in problem.blocked[group.name]]
    causes += _excesses(problem, {error.address for error in errors if error.code in _TOO_LARGE})
    yield from _as_findings([cause for cause in causes if cause.address not in blamed], system, places)


def _is_about(group: Group, addresses: Collection[str]) -> bool:
    """Return whether one of the addresses names the partition or a component in it."""
    return f"partition/{group.name}" in addresses or any(
        f"component/{each.name}" in addresses for each in group.members
    )


def _exceeds_all_hosts(system: System) -> bool:
    """Return whether the fixed reserves need more than all hosts have, each on the host where it is least."""
    capacities = [unseen(host).capacity for host in system.hosts.values()]
    inside = [component for component in system.components.values() if component.runs_on is RunsOn.PARTITION]
    fewest = min(host.logical_processors for host in system.hosts.values())
    reserves = Counter(component.cpu.reserve for component in inside)
    reserved = sum(
        (
            number * in_processors(reserve, fewest)
            for reserve, number in reserves.items()
            if reserve is not None and not isinstance(reserve, Measured)
        ),
        start=Fraction(0),
    )
    memory = sum(component.memory for component in inside)
    return reserved > sum(capacity.processors for capacity in capacities) or memory > sum(
        capacity.memory for capacity in capacities
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _AtLeast:
    """Reservations as their source says; what is not measured counts with what the manifest fixes."""

    source: ReservationSource

    def look_up(self, members: tuple[Component, ...], host: Host) -> LookedUp:
        answer = self.source.look_up(members, host)
        return LookedUp(reservation=fixed(members, host)) if isinstance(answer, NotMeasured) else answer

    def depends_on(self, host: Host) -> Hashable:
        return self.source.depends_on(host)


def _about_logs(
    groups: Iterable[Group], problem: Problem, source: ReservationSource, places: Places
) -> Iterator[Diagnostic]:
    """Report what there is to say of the data logs; one platform on which a log holds is enough."""
    unmeasured: list[tuple[Host, Group]] = []
    for group in filter(depends_on_a_log, groups):
        if not problem.system.loads_of(names_of(group.members)):
            continue  # that is reported already
        hosts = [problem.system.hosts[name] for name in problem.claims[group.name]]
        answers = [(source.look_up(group.members, host), host) for host in hosts]
        known = next((answer for answer, _ in answers if isinstance(answer, LookedUp)), None)
        if known is not None:
            yield from remarks_as_findings(known.remarks, places)
            continue
        for answer, host in answers[:1]:
            assert isinstance(answer, NotMeasured)
            if answer.why.code == planning_findings.UNMEASURED.code:
                unmeasured.append((host, group))
            else:
                yield from _as_findings([answer.why], problem.system, places)
    yield from _not_yet_measured(unmeasured, places)


def _not_yet_measured(unmeasured: Iterable[tuple[Host, Group]], places: Places) -> Iterator[Diagnostic]:
    """Report components without a measurement: one finding for each platform, at its first host."""
    kinds: dict[tuple[str, bool], list[tuple[Host, Group]]] = {}
    for host, group in unmeasured:
        without_demand = any(each.simulation is None for each in group.members)
        needs_demand = host.provider is ProviderKind.SIMULATED and without_demand
        kinds.setdefault((host.platform, needs_demand), []).append((host, group))
    for (platform, needs_demand), alike in kinds.items():
        name = alike[0][0].name
        advice = prose(MEASURE, " finds the reservation.")
        if needs_demand:
            demand = "The host is simulated, so each component needs `simulation: { work: 20 ms }`. Then "
            advice = prose(demand, advice)
        yield NOT_YET_MEASURED.at(
            places.key("hosts", name),
            "Not measured on {platform} yet: {components}.",
            advice,
            address=f"host/{name}",
            components=tuple(component for _, group in alike for component in to_be_measured(group.members)),
            platform=platform,
        )


def _excesses(problem: Problem, too_large: Collection[str]) -> list[Diagnostic]:
    """Return the findings on partitions that exceed the hosts together, without those that are too large alone."""
    reported = {group.name for group in problem.groups if _is_about(group, too_large)}
    judged = replace(problem, items=tuple(item for item in problem.items if item.name not in reported))
    return [replace(cause, advice=_ADVICE) for cause in evident_causes(judged)]


def _as_findings(causes: list[Diagnostic], system: System, places: Places) -> Iterator[Diagnostic]:
    answer = Infeasible(proven=True, causes=tuple(dict.fromkeys(causes)), relaxations=())
    return causes_as_findings(answer, system, places)
