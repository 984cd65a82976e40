"""A partition that stops only so that others can change: what is done meanwhile claims nothing."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from rarms_iac.diff.claims import NO_CLAIM
from rarms_iac.diff.stepping.machine import STARTS_ANEW, asked
from rarms_iac.model.operations import StartPartition, StopPartition
from rarms_iac.model.plan import Step, Undo, UndoLevel
from rarms_iac.model.state import RunState
from rarms_iac.model.system import Disruption


@dataclass(frozen=True, slots=True, kw_only=True)
class Pause:
    """The rest of a change with a stop before it; `start` is what brings the partition back, where it is to run."""

    stop: Step
    between: tuple[Step, ...]
    start: Step | None


def pause_steps(rest: Sequence[Step], why: str, grace: int) -> Pause:
    """The remaining steps of a running partition, done while it is stopped, so that they claim nothing.

    Its guest may take `grace` milliseconds to shut down.
    """
    first = rest[0]
    address, held, last = first.address, first.claim_before, rest[-1].claim_after
    stop = Step(
        address=address,
        title=f"stop it, to make room ({asked(grace)})",
        operation=StopPartition(partition=address.partition, grace_ms=grace, machine=address.machine),
        before={"exists": True, "running": True, "state": RunState.RUNNING.value},
        after={"exists": True, "running": False, "state": RunState.OFF.value},
        undo=Undo(
            level=UndoLevel.PARTIAL,
            operation=StartPartition(partition=address.partition, machine=address.machine),
            says=STARTS_ANEW,
        ),
        disruption=Disruption.PARTITION_STOP,
        claim_before=held,
        claim_after=NO_CLAIM,
        comment=why,
        place=first.place,
    )
    kept = [step for step in rest if not isinstance(step.operation, StopPartition | StartPartition)]
    between = tuple(replace(step, claim_before=NO_CLAIM, claim_after=NO_CLAIM) for step in kept)
    if last == NO_CLAIM:
        return Pause(stop=stop, between=between, start=None)
    start = replace(
        stop,
        title="start it again",
        operation=StartPartition(partition=address.partition, machine=address.machine),
        before=stop.after,
        after=stop.before,
        undo=Undo(
            level=UndoLevel.FULL,
            operation=StopPartition(partition=address.partition, grace_ms=grace, machine=address.machine),
        ),
        disruption=Disruption.LIVE,
        claim_before=NO_CLAIM,
        claim_after=last,
        comment="it was stopped only to make room",
    )
    return Pause(stop=stop, between=between, start=start)
