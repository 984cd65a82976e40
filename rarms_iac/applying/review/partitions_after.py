"""The partitions of an application once a plan is applied."""

from typing import assert_never

from rarms_iac.model.changes import Adopt, Change, Create, Delete, Release, Update
from rarms_iac.model.plan import HostPlan
from rarms_iac.model.state import Partition, State


def partitions_after(observed: State, application: str, plan: HostPlan) -> tuple[Partition, ...]:
    """List this application's partitions on a host once the plan is applied, by name."""
    partitions: dict[str, Partition] = {}
    names: dict[str, str] = {}  # by machine id
    for partition in observed.of(application).partitions:
        if partition.mark:
            partitions[partition.mark.name] = partition
            names[partition.id] = partition.mark.name
    for change in plan.changes:
        if change.address.partition and not change.address.task:
            partitions.pop(names.get(change.address.machine, change.address.partition), None)
    for change in plan.changes:
        if after := partition_after_change(change):
            partitions[change.address.partition] = after
    return tuple(after for _, after in sorted(partitions.items()))


def partition_after_change(change: Change) -> Partition | None:
    """A partition after its change; None where it is removed or released, or where it is no partition."""
    match change:
        case Create(after=after) | Update(after=after) | Adopt(after=after):
            return after if isinstance(after, Partition) else None
        case Delete() | Release():
            return None
        case _:
            assert_never(change)
