"""A host once the changes of a plan are made: its machines, and what it has promised then."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import assert_never

from rarms_iac.diff.claims import NO_CLAIM, claim_of
from rarms_iac.model.capacity import foreign_claims
from rarms_iac.model.changes import Adopt, Change, Create, Delete, Release, Update
from rarms_iac.model.state import Partition, State
from rarms_iac.model.totals import Totals, totals_of


def partitions_after(observed: State, application: str, changes: Sequence[Change]) -> tuple[Partition, ...]:
    """List this application's partitions on a host once the changes are made, by name."""
    partitions: dict[str, Partition] = {}
    names: dict[str, str] = {}  # by machine id
    for partition in observed.of(application).partitions:
        if partition.mark:
            partitions[partition.mark.name] = partition
            names[partition.id] = partition.mark.name
    for change in changes:
        if change.address.partition and not change.address.task:
            partitions.pop(names.get(change.address.machine, change.address.partition), None)
    for change in changes:
        if after := partition_after_change(change):
            partitions[change.address.partition] = after
    return tuple(after for _, after in sorted(partitions.items()))


def partition_after_change(change: Change) -> Partition | None:
    """Return a partition after its change; None where it is removed or released, or where it is no partition."""
    match change:
        case Create(after=after) | Update(after=after) | Adopt(after=after):
            return after if isinstance(after, Partition) else None
        case Delete() | Release():
            return None
        case _:
            assert_never(change)


def totals_after(observed: State, application: str, changes: Sequence[Change], named: Collection[str]) -> Totals:
    """Add up what a host has promised once the changes are made.

    A machine that is imported or released changes sides and keeps what it has.

    Args:
        observed: the host before them.
        application: whose partitions are `own`; all other machines are `others`.
        changes: what is changed there; none: the host stays as it is.

    Returns:
        The sums, as the planner counts them. A partition that does not run counts as idle where the manifest names it,
        and otherwise not at all.
    """
    own = partitions_after(observed, application, changes)
    claims = [claim_of(partition) for partition in own]
    idle = [
        partition.claim
        for partition, claim in zip(own, claims, strict=True)
        if claim == NO_CLAIM and partition.mark and partition.mark.name in named
    ]
    taken = {change.before.id for change in changes if isinstance(change, Adopt)}
    strangers = [
        machine
        for machine in observed.partitions
        if machine.id not in taken and (machine.mark is None or machine.mark.application != application)
    ]
    released = [replace(change.before, mark=None) for change in changes if isinstance(change, Release)]
    others = foreign_claims(replace(observed, partitions=(*strangers, *released)), application)
    return totals_of(claims, others, idle)
