"""The partition that an explanation is about: what is known of it, and where a plan puts it, or would."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from rarms_iac.app.data_logs import measured_reservations
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.model.host import Host
from rarms_iac.model.layout import Cause, Layout, PlacedPartition
from rarms_iac.model.state import State
from rarms_iac.model.system import Disruption, System
from rarms_iac.model.wording import natural_order
from rarms_iac.planner.groups import Group
from rarms_iac.planner.layout import Planning, plan_layout
from rarms_iac.planner.measured_together import NotMeasured
from rarms_iac.planner.problem import HostView, host_view
from rarms_iac.planner.reservations import MeasuredReservations
from rarms_iac.planner.sizes import size, size_without_reserve


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplainedPartition:
    """A partition with the plan, the hosts and the measurements that its explanation needs."""

    group: Group
    hosts: Hosts
    reservations: MeasuredReservations
    states: Mapping[str, State]  # of the hosts that could be looked at
    views: Mapping[str, HostView]  # the same hosts as the planner sees them
    planning: Planning

    @property
    def system(self) -> System:
        """What the manifest says."""
        return self.hosts.system

    @property
    def layout(self) -> Layout | None:
        """The layout that a plan would have; None: there is none."""
        return self.planning.answer if isinstance(self.planning.answer, Layout) else None

    @property
    def current_host(self) -> str:
        """The host that the partition is on now, the first by name; empty: none that was looked at."""
        return next((name for name, view in sorted(self.views.items()) if self.group.name in view.present), "")

    @property
    def why_bound(self) -> str:
        """Why it may only be where it is; empty: it may be elsewhere."""
        if not self.current_host or self.system.policy.max_disruption is Disruption.REMOVAL:
            return ""
        return (
            f"it stays on {self.current_host}, where it is: a move is a removal, and policy.max_disruption forbids that"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplainedPlace:
    """Where the partition is, or would be if there were room, or if it were known how much it needs."""

    host: Host
    partition: PlacedPartition
    no_host_because: str = ""  # why no host can have it


def partition_to_explain(hosts: Hosts, group: Group, states: Mapping[str, State]) -> ExplainedPartition:
    """Plan the layout, and gather what is known of one of its partitions.

    Args:
        hosts: All hosts of the manifest.
        group: The members of the partition.
        states: Of the hosts that could be looked at, by name.

    Returns:
        The partition with its logs, its place and what the planner found of it.
    """
    reservations = measured_reservations(hosts.manifest, states)
    views = {name: host_view(state, hosts.system.application.name) for name, state in states.items()}
    return ExplainedPartition(
        group=group,
        hosts=hosts,
        reservations=reservations,
        states=states,
        views=views,
        planning=plan_layout(hosts.system, reservations, views, hosts.manifest.places, explain=False),
    )


def explained_place(partition: ExplainedPartition) -> ExplainedPlace:
    """Return its place in the layout; else where it is, or the first host by name that could have it.

    Args:
        partition: as `partition_to_explain` returns it.

    Returns:
        The host with the partition's size there.

    Raises:
        UseCaseError: It may run on no host at all (negative).
    """
    system, group = partition.system, partition.group
    if partition.layout is not None:
        chosen = next(each for each in partition.layout.partitions if each.name == group.name)
        return ExplainedPlace(host=system.hosts[chosen.host], partition=chosen)
    allowed = [
        host
        for host in sorted(
            system.hosts.values(), key=lambda host: (host.name != partition.current_host, natural_order(host.name))
        )
        if group.may_run_on(host.name)
    ]
    answers = [(host, size(group, host, partition.reservations)) for host in allowed]
    for host, answer in answers:
        if isinstance(answer, PlacedPartition):
            return ExplainedPlace(host=host, partition=answer)
    for host, answer in answers:
        shape = size_without_reserve(_as_wide_as_measured(partition, host), host)
        if isinstance(shape, PlacedPartition) and isinstance(answer, Cause):
            return ExplainedPlace(host=host, partition=shape, no_host_because=answer.message)
    raise UseCaseError(Outcome.NEGATIVE, partition.planning.findings, partition.hosts.manifest.sources)


def _as_wide_as_measured(partition: ExplainedPartition, host: Host) -> Group:
    """The group with the virtual processors that its data log was measured with, where no reservation says them."""
    group = partition.group
    log = partition.reservations.log(group.members, host)
    if isinstance(log, NotMeasured) or group.request.processors is not None:
        return group
    return replace(group, request=replace(group.request, processors=log.processors))
