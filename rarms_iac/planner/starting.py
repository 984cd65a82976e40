"""What partitions reserve while they start, as the manifest says it for a host."""

from collections.abc import Mapping
from fractions import Fraction
from math import ceil

from rarms_iac.model.host import Host
from rarms_iac.model.quantities import LogicalProcessors, in_processors
from rarms_iac.model.starting import Starting
from rarms_iac.model.system import System
from rarms_iac.planner.groups import Group, groups_of


def starting_of(group: Group, host: Host) -> Starting | None:
    """Return what a partition reserves while it starts: its own, or the sum of its members' for the longest time.

    Args:
        host: Shares of a host are of its logical processors.

    Returns:
        None where neither the partition nor a member says it.
    """
    own = group.request.cpu.starting
    requests = [own] if own is not None else [each.cpu.starting for each in group.members if each.cpu.starting]
    if not requests:
        return None
    total = sum((in_processors(each.reserve, host.logical_processors) for each in requests), Fraction(0))
    return Starting(reserve=LogicalProcessors(total), time_ms=max(ceil(each.time) for each in requests))


def starting_partitions(system: System, host: Host) -> Mapping[str, Starting]:
    """Return by partition what it reserves on a host while it starts; those that start with no more are left out."""
    found = {group.name: starting_of(group, host) for group in groups_of(system)}
    return {name: starting for name, starting in found.items() if starting is not None}
