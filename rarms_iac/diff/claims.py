"""The budget of the steps on a host: its capacity, and the claims on it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from rarms_iac.model.capacity import Capacity, fits
from rarms_iac.model.claims import Claim
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.state import Partition, RunState
from rarms_iac.model.system import Disruption

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
        limit: what there is room for.

    Returns:
        True where the claim is at most the limit in every respect; processors count only with a reserve.
    """
    reserved = claim.reserve == 0 or (claim.processors <= limit.processors and claim.reserve <= limit.reserve)
    return reserved and claim.memory <= limit.memory


@dataclass(frozen=True, slots=True, kw_only=True)
class StepBudget:
    """The capacity that the steps on a host share, and how much they may disturb."""

    capacity: Capacity
    foreign: tuple[Claim, ...] = ()  # of machines that this application does not manage
    managed: Mapping[str, Partition] = field(default_factory=dict)  # by machine id, before the first step
    criticality: Mapping[str, int] = field(default_factory=dict)  # by partition
    max_disruption: Disruption = Disruption.HOST_RESTART
    graces: Mapping[str, Milliseconds] = field(default_factory=dict)  # by partition: for its guest to shut down
    forces: bool = True  # the host can force a guest to shut down

    def holds(self, claims: Iterable[Claim]) -> bool:
        """Whether these claims of managed partitions fit the host beside the foreign ones.

        Args:
            claims: of managed partitions, at most one each.

        Returns:
            False also where it is unknown whether virtual processors find logical ones (`model.capacity.fits`).
        """
        return fits(self.capacity, (*self.foreign, *claims))

    def rank(self, partition: str) -> tuple[int, str]:
        """Return what sorts partitions by criticality, the least critical first, then by name.

        Args:
            partition: its name; one without a known criticality counts as 0.

        Returns:
            Criticality and name.
        """
        return self.criticality.get(partition, 0), partition
