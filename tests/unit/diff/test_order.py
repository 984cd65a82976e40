from dataclasses import replace
from fractions import Fraction

import pytest

from rarms_iac.diff.disruption import hold_back
from rarms_iac.diff.order import order
from rarms_iac.diff.step_context import StepContext
from rarms_iac.diff.steps import PlannedChange
from rarms_iac.model.changes import Address, Create, Reason, Update
from rarms_iac.model.claims import Claim
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.operations import call_name, set_to
from rarms_iac.model.plan import Step, Undo, UndoLevel
from rarms_iac.model.quantities import LogicalProcessors, Percent, ShareOfHost
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import Partition, RunState, Starting, State
from rarms_iac.model.system import CpuRequest, Disruption, StartRequest, System
from tests.builders import a_component, a_host, a_mark, a_system, cpu_amount, milliseconds
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


def starting(system: System, **reserves: str) -> System:
    """The system with these reserves for 30 s from each start on."""
    more = {
        name: replace(
            system.components[name],
            cpu=replace(
                system.components[name].cpu, starting=StartRequest(reserve=cpu_amount(share), time=milliseconds("30 s"))
            ),
        )
        for name, share in reserves.items()
    }
    return replace(system, components={**system.components, **more})


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
        "partition/speech": "it needs capacity that a held-back change would free",
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


WHY = Reason(message="for the test")


def changed(name: str, before: Partition, after: Partition, disruption: Disruption) -> Update:
    address = Address(partition=name, machine=before.id)
    return Update(address=address, before=before, after=after, reason=WHY, disruption=disruption)


def crossed(vision_keeps: int = 20) -> tuple[list[PlannedChange], StepContext]:
    """Two full partitions; each first takes what the other gives only afterwards, so that no order fits."""
    vision, speech = running("vision", 80, 100), running("speech", 20, 900)
    taken = [
        PlannedChange(
            change=changed(partition.settings.name, partition, partition, Disruption.LIVE),
            steps=changes,
        )
        for partition, changes in [
            (
                vision,
                (step(vision, claim(80, 100), claim(80, 900)), step(vision, claim(80, 900), claim(vision_keeps, 900))),
            ),
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


@pytest.mark.parametrize("vision_keeps", [10, 20])
def test_restart_to_make_room_has_more_where_free(vision_keeps: int) -> None:
    (vision, speech), context = crossed(vision_keeps)
    assert isinstance(speech.change, Update)
    assert isinstance(speech.change.after, Partition)
    ends = replace(speech.change.after, settings=replace(speech.change.after.settings, reserve=80, memory=100 * MIB))
    speech = replace(speech, change=replace(speech.change, after=ends))
    more = Starting(reserve=LogicalProcessors(Fraction(9, 10)), time_ms=30_000)

    found = order([vision, speech], replace(context, starting={"speech": more}))

    assert not isinstance(found, Diagnostic), found
    assert never_over(found, context)
    around = [call_name(each.operation) for each in found[5:]]
    assert around == (["set_cpu", "start_partition", "set_cpu"] if vision_keeps == 10 else ["start_partition"])
    assert found[-1].claim_after == claim(80, 100)


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


def test_more_for_a_start_is_given_back() -> None:
    system = starting(shares(vision=30, speech=20, door=30), vision="45 %", speech="40 %")

    found = route(system, empty_state(HOST), Disruption.REMOVAL)
    host = PureHost(empty_state(HOST))
    most = 0
    for each_step in found.steps:
        host.walk((each_step,))
        most = max(most, sum(each.settings.reserve for each in host.state.partitions if each.settings.running))
    walked = [each.title.partition(":")[0] for each in found.steps if each.wait_ms is not None]

    assert found.held_back == ()
    assert walked == ["for its start", "30 s after its start"] * 2
    reserves = {each.settings.name: each.settings.reserve for each in host.state.partitions}
    assert reserves == {"vision": 30, "speech": 20, "door": 30}
    assert most <= 100


def test_held_back_neighbour_leaves_no_room_to_start() -> None:
    """One keeps its name, since it must not stop; so the next one keeps its reservation, and a start lacks room."""
    first, second = running("first", 10, 100), running("second", 60, 100)
    less, new = running("first", 10, 100), running("new", 20, 100)
    more = Starting(reserve=LogicalProcessors(Fraction(7, 10)), time_ms=30_000)
    changes = (
        changed("third", first, first, Disruption.PARTITION_STOP),
        changed("first", second, less, Disruption.LIVE),
        Create(address=Address(partition="new"), after=new, reason=WHY),
    )
    _, context = crossed()
    state = replace(context.seen.state, partitions=(first, second))
    here = replace(
        context,
        seen=replace(context.seen, state=state),
        max_disruption=Disruption.LIVE,
        starting={"new": more},
    )

    allowed, held = hold_back(changes, here)

    assert allowed == ()
    assert [each.why for each in held] == [
        "--max-disruption partition_stop allows it",
        "its name is used by partition/third",
        "its start needs 0.7 LP, and the host has 0.3 LP free",
    ]


def test_start_without_room_is_held_back() -> None:
    found = route(starting(shares(vision=30, speech=40), vision="70 %"), empty_state(HOST), Disruption.REMOVAL)

    (held,) = found.held_back
    assert (str(held.change.address), held.why) == (
        "partition/vision",
        "its start needs 1.4 LP, and the host has 1.2 LP free",
    )
