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
    """The promises to this application's partitions after these steps, and those to all others then.

    A machine that is taken over or let go of changes sides, and keeps what it has. One that is wanted, or that
    `rarms stop` stopped, and does not run is promised what the layout or its settings give it, as the planner counts.
    """
    claims = {
        partition.mark.name: claim_of(partition) for partition in observed.of(application).partitions if partition.mark
    }
    renamed: dict[str, str] = {
        partition.id: partition.mark.name for partition in observed.of(application).partitions if partition.mark
    }
    for step in steps:
        address = step.address
        if address.partition and not address.task:
            claims.pop(renamed.get(address.machine, ""), None)
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
    layout = stopped | {partition.settings.name: partition.claim for partition in desired.partitions}
    idle = [layout[name] for name, claim in claims.items() if claim == NO_CLAIM and name in layout]
    return totals_of(claims.values(), others, idle)
