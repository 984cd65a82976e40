"""Laws of the whole route, on simulated hosts: plan, apply, plan again; stop anywhere, go on; take everything back."""

from dataclasses import replace

from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from rarms_iac.applying.run_report import RunEnding
from rarms_iac.diff.compare import compare
from rarms_iac.diff.drift import DriftKind, drift
from rarms_iac.diff.step_context import StepContext, claim_of
from rarms_iac.model.capacity import foreign_claims, packs
from rarms_iac.model.claims import load_of
from rarms_iac.model.host import SchedulerType
from rarms_iac.model.layout import Layout
from rarms_iac.model.mmcss import SYSTEM_RESPONSIVENESS
from rarms_iac.model.plan import UndoLevel
from rarms_iac.model.quantities import Bytes
from rarms_iac.model.state import Partition, RegistryValue, Responsiveness, State
from rarms_iac.model.system import System
from rarms_iac.storage.plan_file import write_plan
from tests.effort import examples
from tests.lab import Countdown, Lab, a_lab, without_serials
from tests.planning import layout_of, route
from tests.pure_host import PureHost
from tests.strategies import Strangers, edits, empty_state, strangers, systems

FEW = settings(
    max_examples=examples(8), deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much]
)


def unmanaged(lab: Lab) -> list[Partition]:
    return [partition for state in lab.observe().values() for partition in state.partitions if partition.mark is None]


def shipped(states: dict[str, State]) -> list[object]:
    return [task for state in states.values() for task in state.tasks if task.record is None and not task.inside]


def possible(lab: Lab) -> None:
    assume(lab.prepare().plan is not None)


@FEW
@given(systems(), strangers())
def test_applied_plan_is_empty_and_strangers_untouched(system: System, others: Strangers) -> None:
    with a_lab(system) as lab:
        lab.add(others)
        possible(lab)
        machines, tasks = unmanaged(lab), shipped(lab.observe())

        report = lab.apply(lab.plan())

        assert report.ending in {RunEnding.DONE, RunEnding.NOTHING}, report.findings
        assert lab.steps_left() == 0
        assert unmanaged(lab) == machines
        assert shipped(lab.observe()) == tasks


@FEW
@given(systems(), strangers(), st.integers(0, 60))
def test_stopped_run_is_finished_from_the_host(system: System, others: Strangers, stop: int) -> None:
    with a_lab(system) as undisturbed, a_lab(system) as lab:
        for bench in (undisturbed, lab):
            bench.add(others)
        possible(lab)
        undisturbed.apply(undisturbed.plan())

        first = lab.apply(lab.plan(), Countdown(stop))
        second = lab.finish()

        assert (second is None) == (first.ending is not RunEnding.INTERRUPTED)
        assert second is None or second.ending is RunEnding.DONE
        assert lab.observe() == undisturbed.observe()


@FEW
@given(st.data(), strangers(), st.integers(0, 60))
def test_undo_brings_everything_back_but_the_serial(data: st.DataObject, others: Strangers, stop: int) -> None:
    first = data.draw(systems())
    with a_lab(first) as earlier:
        earlier.add(others)
        possible(earlier)
        earlier.apply(earlier.plan())
        lab = earlier.wanting(data.draw(systems(next(iter(first.hosts.values())))))
        possible(lab)
        before = lab.observe()
        plan = lab.plan()
        assume(any(host.steps for host in plan.hosts))

        lab.apply(plan, Countdown(stop))
        reports = lab.undo()

        assert [report.ending for report in reports] == [RunEnding.DONE]
        after = lab.observe()
        assert ids_of(before) <= ids_of(after) or reports[0].findings, "what cannot be brought back is told"
        if not reports[0].findings:
            assert without_serials(after) == without_serials(before)
        assert all(after[name].serials != before[name].serials for name in after)


def ids_of(states: dict[str, State]) -> set[str]:
    return {partition.id for state in states.values() for partition in state.partitions}


@FEW
@given(systems(), strangers())
def test_the_same_input_makes_the_same_plan_file(system: System, others: Strangers) -> None:
    with a_lab(system) as first, a_lab(system) as other:
        for lab in (first, other):
            lab.add(others)
        possible(first)

        assert write_plan(first.plan()) == write_plan(other.plan())


def applied(system: System, state: State) -> State:
    """The host after a plan for this system was applied to it."""
    host = PureHost(state, made=len(state.partitions))
    host.walk(route(system, state).steps)
    return host.state


def planned_or_no_case(system: System, state: State) -> None:
    assume(isinstance(layout_of(system, state), Layout))


def strangers_of(state: State) -> Strangers:
    return Strangers(
        tuple(partition for partition in state.partitions if partition.mark is None),
        tuple(task for task in state.tasks if task.record is None),
        _before(state.responsiveness),
    )


def _before(responsiveness: Responsiveness | None) -> RegistryValue | None:
    """What was there before rarms, or is there without it."""
    if responsiveness is None or responsiveness.record is None:
        return responsiveness.value if responsiveness else None
    return (responsiveness.record.before or {}).get(SYSTEM_RESPONSIVENESS)


@given(systems(), strangers())
def test_a_state_has_no_difference_to_itself(system: System, others: Strangers) -> None:
    start = empty_state(next(iter(system.hosts.values())), others)
    planned_or_no_case(system, start)
    state = applied(system, start)

    for host in (start, state):
        ours = host.of("robot")
        found = compare(ours, host, "robot", route(system, host).context)
        assert found.changes == []
        assert drift(ours, host, "robot") == ()


@given(st.data(), strangers())
def test_changed_manifest_is_reached_without_overpromising(data: st.DataObject, others: Strangers) -> None:
    first = data.draw(systems())
    host = next(iter(first.hosts.values()))
    start = empty_state(host, others)
    start = replace(start, facts=replace(start.facts, scheduler=SchedulerType.CORE, smt=data.draw(st.booleans())))
    planned_or_no_case(first, start)
    middle = applied(first, start)
    second = data.draw(systems(host))
    planned_or_no_case(second, middle)
    plan = route(second, middle)

    walker = PureHost(middle, made=50)
    passed = walker.walk(plan.steps)

    for state in passed:
        never_more(state, middle, plan.context)
    again = route(second, walker.state)
    assert again.difference.changes == []
    assert set(again.difference.unused) == set(again.desired.unused)
    assert strangers_of(walker.state) == others


def never_more(state: State, start: State, context: StepContext) -> None:
    before = [*foreign_claims(start, "robot"), *map(claim_of, start.of("robot").partitions)]
    now = [*foreign_claims(state, "robot"), *map(claim_of, state.of("robot").partitions)]
    most, load = load_of(before), load_of(now)
    assert load.percent <= 100 * context.seen.capacity.processors or load.percent <= most.percent
    assert load.memory <= max(context.seen.capacity.memory, most.memory)
    assert packs(now, context.seen.capacity) or not packs(before, context.seen.capacity)


@given(st.data(), systems())
def test_a_step_and_its_full_undo_cancel(data: st.DataObject, system: System) -> None:
    host = next(iter(system.hosts.values()))
    start = empty_state(host)
    planned_or_no_case(system, start)
    middle = applied(system, start)
    second = data.draw(systems(host))
    planned_or_no_case(second, middle)

    walker = PureHost(middle, made=50)
    for step in route(second, middle).steps:
        before = walker.state
        walker.take(step.operation, step, step.before, step.after)
        if step.undo.level is UndoLevel.FULL and step.undo.operation is not None:
            back = PureHost(walker.state, made=80)
            back.take(step.undo.operation, step, step.after, step.before)
            assert in_order(back.state) == in_order(before)


def in_order(state: State) -> State:
    return replace(
        state,
        partitions=tuple(sorted(state.partitions, key=lambda partition: partition.id)),
        tasks=tuple(sorted(state.tasks, key=lambda task: (task.inside, task.name.lower()))),
    )


@given(st.data(), systems(), st.booleans(), st.booleans())
def test_who_moved_is_told_apart(data: st.DataObject, system: System, by_hand: bool, in_manifest: bool) -> None:
    host = next(iter(system.hosts.values()))
    start = empty_state(host)
    planned_or_no_case(system, start)
    state = applied(system, start)
    victim = data.draw(st.sampled_from(sorted(state.of("robot").partitions, key=lambda partition: partition.id)))
    assert victim.mark is not None
    name = victim.mark.name
    wanted = system
    if by_hand:
        edited = replace(victim, settings=data.draw(edits(victim.settings)))
        state = replace(
            state,
            partitions=tuple(edited if partition.id == victim.id else partition for partition in state.partitions),
        )
    if in_manifest:
        leader = system.partitions[name].components[0] if name in system.partitions else name
        old = system.components[leader]
        heavier = replace(old, memory=Bytes(old.memory + 2**20))
        wanted = replace(system, components={**system.components, leader: heavier})
    planned_or_no_case(wanted, state)

    found = {
        entry.address.partition: entry.drift for entry in drift(route(wanted, state).desired.state, state, "robot")
    }

    kinds = {
        (True, True): DriftKind.BOTH,
        (True, False): DriftKind.HOST_CHANGED,
        (False, True): DriftKind.NOT_APPLIED,
    }
    assert found == ({name: kinds[by_hand, in_manifest]} if by_hand or in_manifest else {})


@given(st.data(), systems())
def test_the_order_of_the_input_does_not_matter(data: st.DataObject, system: System) -> None:
    start = empty_state(next(iter(system.hosts.values())))
    planned_or_no_case(system, start)
    names = data.draw(st.permutations(sorted(system.components)))
    shuffled = replace(system, components={name: system.components[name] for name in names})

    assert route(shuffled, start).ordered == route(system, start).ordered
