from dataclasses import replace
from fractions import Fraction

from rarms_iac.diff.disruption import hold_back
from rarms_iac.diff.order import order
from rarms_iac.diff.step_context import StepContext
from rarms_iac.diff.steps import PlannedChange
from rarms_iac.model.changes import Address, Reason, Update
from rarms_iac.model.claims import Claim
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.operations import call_name, set_to
from rarms_iac.model.plan import Step, Undo, UndoLevel
from rarms_iac.model.quantities import Percent, ShareOfHost
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import Partition, RunState, State
from rarms_iac.model.system import CpuRequest, Disruption, System
from tests.builders import a_component, a_host, a_mark, a_system
from tests.builders_plan import facts
from tests.planning import route
from tests.pure_host import PureHost
from tests.strategies import MIB, empty_state, some_settings

HOST = a_host(logical_processors=2)


def shares(**reserves: int) -> System:
    """Components with these reserves in per cent; the later named, the less critical."""
    return a_system(
        hosts=[HOST],
        components=[
            replace(
                a_component(name, criticality=50 - at), cpu=CpuRequest(reserve=ShareOfHost(Percent(Fraction(share))))
            )
            for at, (name, share) in enumerate(reserves.items())
        ],
    )


def applied(system: System, state: State) -> State:
    host = PureHost(state)
    host.walk(steps(system, state))
    return host.state


def steps(system: System, state: State, limit: Disruption = Disruption.REMOVAL) -> tuple[Step, ...]:
    return route(system, state, limit).steps


def test_disruptive_change_holds_back_dependent_growth() -> None:
    state = applied(shares(vision=70, speech=30), empty_state(HOST))
    narrower = shares(vision=20, speech=60)
    narrow = replace(narrower.components["vision"], processors=1)
    wanted = replace(narrower, components={**narrower.components, "vision": narrow})

    found = route(wanted, state, Disruption.LIVE)

    assert found.allowed == ()
    assert {str(held.change.address): held.why for held in found.held_back} == {
        "partition/speech": "it needs what a change that is held back would have given back",
        "partition/vision": "--max-disruption partition_stop allows it",
    }
    assert found.ordered == ()


def running(name: str, reserve: int, memory: int) -> Partition:
    settings = replace(some_settings(name), reserve=reserve, memory=memory * MIB, running=True)
    mark = a_mark(f"id-{name}", "robot", name, "0" * 12)
    return Partition(settings=settings, id=f"id-{name}", state=RunState.RUNNING, mark=mark)


def claim(reserve: int, memory: int) -> Claim:
    return Claim(processors=1, reserve=reserve, memory=memory * MIB)


def step(partition: Partition, before: Claim, after: Claim) -> Step:
    """A step that changes the reserve or else the memory, with these claims."""
    name = partition.settings.name
    operation = (
        set_to(name, reserve=after.reserve, limit=100, weight=100, machine=partition.id)
        if before.reserve != after.reserve
        else set_to(name, memory=after.memory, machine=partition.id)
    )
    return Step(
        address=Address(partition=name, machine=partition.id),
        title="change it",
        operation=operation,
        before={},
        after={},
        undo=Undo(level=UndoLevel.NONE, operation=None),
        disruption=Disruption.LIVE,
        claim_before=before,
        claim_after=after,
        comment="",
    )


def crossed() -> tuple[list[PlannedChange], StepContext]:
    """Two full partitions; each first takes what the other gives only afterwards, so that no order fits."""
    vision, speech = running("vision", 80, 100), running("speech", 20, 900)
    taken = [
        PlannedChange(
            change=Update(
                address=Address(partition=partition.settings.name, machine=partition.id),
                before=partition,
                after=partition,
                reason=Reason(message="for the test"),
                disruption=Disruption.LIVE,
            ),
            steps=changes,
        )
        for partition, changes in [
            (vision, (step(vision, claim(80, 100), claim(80, 900)), step(vision, claim(80, 900), claim(20, 900)))),
            (speech, (step(speech, claim(20, 900), claim(80, 900)), step(speech, claim(80, 900), claim(80, 100)))),
        ]
    ]
    state = State(facts=facts(logical_processors=1, ram="1000 MiB"), partitions=(vision, speech))
    host = a_host(logical_processors=1, memory="1000 MiB")
    seen = SeenHost(host=host, application="robot", state=state)
    context = StepContext(seen=seen, criticality={"vision": 2, "speech": 1})
    return taken, context


def test_least_critical_stops_when_no_order_fits() -> None:
    taken, context = crossed()

    found = order(taken, context)

    assert not isinstance(found, Diagnostic), found
    assert [(step.address.partition, call_name(step.operation)) for step in found] == [
        ("speech", "stop_partition"),
        ("vision", "set_memory"),
        ("vision", "set_cpu"),
        ("speech", "set_cpu"),
        ("speech", "set_memory"),
        ("speech", "start_partition"),
    ]
    assert "least critical" in found[0].comment
    assert never_over(found, context)


def never_over(steps: tuple[Step, ...], context: StepContext) -> bool:
    claims = {
        partition.id: claim(partition.settings.reserve, partition.settings.memory // MIB)
        for partition in context.seen.own
    }
    for step in steps:
        assert claims[step.address.machine] == step.claim_before, f"{step.address} {step.title}"
        claims[step.address.machine] = step.claim_after
        if sum(c.reserve for c in claims.values()) > 100 or sum(c.memory for c in claims.values()) > 1000 * MIB:
            return False
    return True


def test_unbreakable_cycle_is_named() -> None:
    taken, context = crossed()

    found = order(taken, replace(context, max_disruption=Disruption.LIVE))

    assert isinstance(found, Diagnostic)
    assert found.values["partitions"] == ("speech", "vision")
    assert found.code == "RARMS154"
    assert "max_disruption" in found.detail


def test_nothing_is_held_back_where_all_is_allowed() -> None:
    taken, context = crossed()

    assert hold_back([planned.change for planned in taken], context)[1] == ()
