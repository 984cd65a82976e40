"""What is promised on a host once the steps of a plan are done."""

from collections.abc import Sequence

from rarms_iac.diff.claims import NO_CLAIM, claim_of
from rarms_iac.model.capacity import foreign_claims
from rarms_iac.model.changes import Adopt, Change, Delete, Release
from rarms_iac.model.plan import Step
from rarms_iac.model.state import Partition, State, StoppedBy
from rarms_iac.model.totals import Totals, totals_of


def totals_after(
    observed: State, desired: State, application: str, changes: Sequence[Change], steps: Sequence[Step]
) -> Totals:
    """Add up what a host has promised once the steps are done.

    A machine that is imported or released changes sides and keeps what it has. A partition that does not run, and that
    is desired or was stopped by `rarms stop`, counts as idle: with what the layout or its settings reserve for it.

    Args:
        observed: the host before the steps.
        desired: the host's final State.
        application: whose partitions are `own`; all other machines are `others`.
        changes: the changes that the steps make.
        steps: in their order.

    Returns:
        The sums, as the planner counts them.
    """
    claims = {
        partition.mark.name: claim_of(partition) for partition in observed.of(application).partitions if partition.mark
    }
    names_by_id: dict[str, str] = {
        partition.id: partition.mark.name for partition in observed.of(application).partitions if partition.mark
    }
    for step in steps:
        address = step.address
        if address.partition and not address.task:
            claims.pop(names_by_id.get(address.machine, ""), None)
            claims[address.partition] = step.claim_after
    others = list(foreign_claims(observed, application))
    for change in changes:
        match change:
            case Adopt(before=Partition(claims_resources=True) as before):
                others.remove(before.claim)
            case Release(before=Partition() as before):
                claims.pop(change.address.partition, None)
                others += [before.claim] if before.claims_resources else []
            case _:
                pass
    removed = {change.address.partition for change in changes if isinstance(change, Delete)}
    stopped = {
        partition.mark.name: partition.claim
        for partition in observed.of(application).partitions
        if partition.mark and partition.mark.stopped_by is not StoppedBy.NO_USER and partition.mark.name not in removed
    }
    reserved = stopped | {partition.settings.name: partition.claim for partition in desired.partitions}
    idle = [reserved[name] for name, claim in claims.items() if claim == NO_CLAIM and name in reserved]
    return totals_of(claims.values(), others, idle)
