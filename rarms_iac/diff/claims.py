"""What managed partitions claim of their host, and what fits in place of what."""

from rarms_iac.model.claims import Claim
from rarms_iac.model.state import Partition, RunState

NO_CLAIM = Claim()

_ACTIVE = frozenset({RunState.RUNNING, RunState.PAUSED, RunState.BUSY, RunState.CRITICAL})


def claim_of(partition: Partition | None) -> Claim:
    """Return what a managed partition is promised now.

    Nothing before it runs, because a reserve is taken at the start (windows.md 1.2). A partition that merely starts
    with its host counts when it is started; the layout has room for all of them.

    Args:
        partition: as observed; None: there is none.

    Returns:
        Virtual processors, reserve (per cent of each) and memory (bytes).
    """
    if partition is None or not (partition.settings.running or partition.state in _ACTIVE):
        return NO_CLAIM
    return partition.claim


def within(claim: Claim, limit: Claim) -> bool:
    """Tell whether a claim fits in every place where the limit fits.

    Args:
        claim: what is asked for.

    Returns:
        True where the claim is at most the limit in every respect; processors count only with a reserve.
    """
    reserved = claim.reserve == 0 or (claim.processors <= limit.processors and claim.reserve <= limit.reserve)
    return reserved and claim.memory <= limit.memory
