"""The totals of hosts by the manifest and the data logs, for commands that show sums without making a plan."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

from rarms_iac.model.layout import Layout, PlacedPartition
from rarms_iac.model.seen_host import seen_hosts
from rarms_iac.model.state import State
from rarms_iac.model.system import Disruption, System
from rarms_iac.model.totals import HostTotals, host_totals, totals_of
from rarms_iac.planner.packing.first_fit import partial_first_fit
from rarms_iac.planner.packing.values import claims_by_host
from rarms_iac.planner.problem import Problem, problem_of, solve
from rarms_iac.planner.reservations import ReservationSource


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedTotals:
    """The place where each partition counts, and the totals of each host by its name."""

    partitions: tuple[PlacedPartition, ...]
    hosts: Mapping[str, HostTotals]


def planned_totals(system: System, reservations: ReservationSource, states: Mapping[str, State]) -> PlannedTotals:
    """Place each partition once, as a plan would, and add up what each host promises.

    Args:
        reservations: where reservations come from; a partition whose reservation is not known does not count.
        states: the hosts that were looked at, by name; of the others the manifest alone counts.

    Returns:
        The totals of every host of the manifest.
    """
    may_move = system.policy.max_disruption is Disruption.REMOVAL
    partitions = _placement_of(problem_of(system, reservations, states, may_move=may_move))
    return PlannedTotals(partitions=partitions, hosts=totals_by_host(system, partitions, states))


def totals_by_host(
    system: System, partitions: Collection[PlacedPartition], states: Mapping[str, State]
) -> Mapping[str, HostTotals]:
    """Add up what each host of the manifest promises to the partitions that are placed there, and to others.

    Args:
        states: the hosts that were looked at, by name.

    Returns:
        By host, in the order of the names.
    """
    totals: dict[str, HostTotals] = {}
    for name, seen in sorted(seen_hosts(system.hosts, system.application.name, states).items()):
        own = (partition.claim for partition in partitions if partition.host == name)
        totals[name] = host_totals(seen.host, seen.facts, totals_of(own, seen.claims))
    return totals


def _placement_of(problem: Problem) -> tuple[PlacedPartition, ...]:
    """Return the layout; without one, each partition of known size on one host, so that what must be there counts."""
    answer = solve(problem)
    if isinstance(answer, Layout):
        return answer.partitions
    return tuple(problem.partition_on(name, host) for name, host in sorted(hosts_without_layout(problem).items()))


def hosts_without_layout(problem: Problem) -> Mapping[str, str]:
    """Return the host that each partition counts on without a layout.

    A partition with a choice takes what those without one leave; if no host has room for it, it counts on the first.

    Args:
        problem: Partitions of unknown size are left out.

    Returns:
        The name of the host by that of the partition.
    """
    items = sorted((item for item in problem.items if item.claims), key=lambda item: item.name)
    host_of = {item.name: min(item.claims) for item in items}
    forced = [item for item in items if len(item.claims) == 1]
    taken = claims_by_host(forced, problem.bins, host_of)
    bins = [replace(host, foreign_claims=tuple(taken[host.name])) for host in problem.bins]
    return host_of | dict(partial_first_fit([item for item in items if item not in forced], bins))
