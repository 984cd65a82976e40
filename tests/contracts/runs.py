"""A run of three steps, for what a journal must keep."""

from rarms_iac.model.changes import Address
from rarms_iac.model.claims import Claim
from rarms_iac.model.journal import RunKind, RunStarted
from rarms_iac.model.operations import StopPartition, set_to
from rarms_iac.model.plan import HostPlan, Step, Undo, UndoLevel
from rarms_iac.model.state import State
from rarms_iac.model.system import Disruption
from tests import builders

VISION = Address(partition="vision")
MIB = 2**20


def a_step(number: int) -> Step:
    return Step(
        address=VISION,
        title=f"step {number}",
        operation=set_to("vision", reserve=number, limit=100, weight=100),
        before={"reserve": number + 1, "exists": True},
        after={"reserve": number},
        undo=Undo(level=UndoLevel.FULL, operation=StopPartition(partition="vision", grace_ms=120_000)),
        disruption=Disruption.LIVE,
        claim_before=Claim(),
        claim_after=Claim(processors=2, reserve=number, memory=MIB),
        comment="why",
    )


def a_run(state: State, serial: int = 1) -> RunStarted:
    steps = tuple(a_step(number) for number in range(3))
    host_plan = HostPlan(
        host=builders.a_host(),
        facts=state.facts,
        state_path=".rarms/hosts/onboard.json",
        serial=serial - 1,
        digests={"facts": "0" * 12},
        changes=(),
        steps=steps,
        held_back=(),
        unused=(),
        unchanged=0,
        scripts={},
    )
    return RunStarted(
        run=RunKind.APPLY,
        plan="0123456789ab",
        application="robot",
        started_by="ann@lab",
        started_at="2026-11-20 09:00:00 UTC",
        host_plan=host_plan,
        steps=steps,
        serials={"robot": serial},
    )
