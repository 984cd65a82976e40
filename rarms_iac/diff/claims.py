"""What the machines of a host are promised, as the order of steps counts it (DESIGN section 4, Order)."""

from rarms_iac.model.capacity import claim_of_settings
from rarms_iac.model.plan import Claim
from rarms_iac.model.state import Partition, RunState

NO_CLAIM = Claim()

_ACTIVE = frozenset({RunState.RUNNING, RunState.PAUSED, RunState.BUSY, RunState.CRITICAL})


def claim_of(partition: Partition | None) -> Claim:
    """What is promised to a partition of ours: nothing before it runs, because a reserve is taken at the start.

    FACTS 1.2. One that merely starts with its host counts when it is started; the layout fits all of them.
    """
    if partition is None or not (partition.settings.running or partition.state in _ACTIVE):
        return NO_CLAIM
    return claim_of_settings(partition.settings)


def grows(before: Claim, after: Claim) -> bool:
    """Whether more of anything is promised afterwards."""
    return (
        after.processors * after.reserve > before.processors * before.reserve
        or after.memory > before.memory
        or (after.reserve > before.reserve and after.processors > 0)
    )


def within(claim: Claim, limit: Claim) -> bool:
    """Whether it claims at most as much in every respect, so that it fits wherever the limit fits."""
    reserved = claim.reserve == 0 or (claim.processors <= limit.processors and claim.reserve <= limit.reserve)
    return reserved and claim.memory <= limit.memory
