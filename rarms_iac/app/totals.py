"""The totals of hosts, for commands that show them beside something else and make no plan."""

from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress

from rarms_iac.app.data_logs import measured_reservations
from rarms_iac.app.hosts import observe_host, select_hosts
from rarms_iac.app.manifests import Manifest
from rarms_iac.app.requests import HostSelection
from rarms_iac.app.use_case_errors import UseCaseError
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.layout import PlacedPartition
from rarms_iac.model.state import State
from rarms_iac.model.system import System
from rarms_iac.planner.groups import groups_of
from rarms_iac.planner.reservations import MeasuredReservations, depends_on_a_log
from rarms_iac.planner.totals import PlannedTotals, planned_totals


def states_at_hand(manifest: Manifest) -> Mapping[str, State]:
    """Look at the hosts that are files of this machine: the simulated ones. No other is asked, and none is waited for.

    Args:
        manifest: without errors.

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

    Args:
        manifest: without errors.

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
