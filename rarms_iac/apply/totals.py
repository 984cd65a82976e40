"""What a host has promised once a plan is done: told to the reader, and nothing is decided by it."""

from collections.abc import Sequence

from rarms_iac.diff.claims import claim_of
from rarms_iac.model.capacity import foreign_claims, load_of
from rarms_iac.model.plan import Step, Totals
from rarms_iac.model.state import State


def totals_of(observed: State, application: str, steps: Sequence[Step]) -> Totals:
    """The promises to this application's partitions after these steps, and those to all others now."""
    ours = {one.mark.name: claim_of(one) for one in observed.of(application).partitions if one.mark}
    renamed: dict[str, str] = {one.id: one.mark.name for one in observed.of(application).partitions if one.mark}
    for step in steps:
        address = step.address
        if address.partition and not address.task:
            ours.pop(renamed.get(address.machine, ""), None)
            ours[address.partition] = step.claim_after
    mine, others = load_of(ours.values()), load_of(foreign_claims(observed, application))
    return Totals(percent=mine.percent, memory=mine.memory, others_percent=others.percent, others_memory=others.memory)
