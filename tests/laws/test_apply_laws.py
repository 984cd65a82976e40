"""Laws of the whole route, on simulated hosts: plan, apply, plan again; stop anywhere, go on; take everything back."""

from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from rarms_iac.applying.run_report import RunEnding
from rarms_iac.model.state import Partition, State
from rarms_iac.model.system import System
from rarms_iac.storage.plan_file import write_plan
from tests.effort import examples
from tests.lab import Countdown, Lab, a_lab, without_serials
from tests.strategies import Strangers, strangers, systems

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
