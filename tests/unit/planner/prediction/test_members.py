"""From data logs of components alone to what is predicted of them together."""

from dataclasses import replace

import pytest

from rarms_iac.model.run import Periodic
from rarms_iac.planner.prediction import Alone, Task, alone_of, least_budget, predictor_of, waits_and_work
from tests.builders import a_component, a_run, at_most, milliseconds

CAMERA = Alone(task=Task(work=1_770, period=10_000, deadline=6_000), processors=1)
LASER = Alone(task=Task(work=975, period=4_000, deadline=4_000), processors=1)


def answers(waits: float, work: float) -> list[tuple[float, float]]:
    """The curve of a component that waits and computes so many ms."""
    return [(float(reserve), waits + 100 * work / reserve) for reserve in (10, 20, 50, 90)]


def test_compound_lies_between_member_and_sum() -> None:
    assert [least_budget([alone.task], 100) for alone in (CAMERA, LASER)] == [30, 25]

    together = predictor_of({"camera": CAMERA, "laser": LASER})(("camera", "laser"), 1)

    assert together is not None
    assert 43 < together < 55, "the work of both takes 43 %"


def test_unlogged_components_are_not_predicted() -> None:
    predict = predictor_of({"camera": CAMERA, "laser": LASER})

    assert predict(("camera", "radio"), 1) is None
    assert predict(("camera", "laser"), 2) is None


def test_unachievable_compound_is_not_predicted() -> None:
    busy = Alone(task=replace(LASER.task, work=3_900), processors=1)

    assert predictor_of({"camera": CAMERA, "laser": busy})(("camera", "laser"), 1) is None


def test_single_task_needs_what_was_measured() -> None:
    run = replace(a_run(), arrival=Periodic(period=milliseconds("100 ms")))
    alone = alone_of(a_component(run=run, apt={"p95_response_time": at_most(60)}), answers(10.0, 5.0), 40, 1, None)

    assert alone is not None
    task = alone.task
    assert (task.period, task.deadline) == (10_000, 5_000), "due in 60 ms, of which it waits 10"
    assert least_budget([task], 100) == 40


def test_job_without_deadline_is_due_at_average() -> None:
    alone = alone_of(a_component(apt={"mean_response_time": at_most(95)}), answers(40.0, 10.0), 20, 1, None)

    assert alone is not None
    assert (alone.task.period, alone.task.deadline) == (9_000, 5_000)


def test_job_leaves_unused_processors() -> None:
    component = a_component(apt={"mean_response_time": at_most(50)})
    narrow, wide = (alone_of(component, answers(0.0, 10.0), 20, 2, cpu_ms) for cpu_ms in (10.0, 20.0))

    assert narrow is not None
    assert wide is not None
    assert predictor_of({"a": narrow, "b": narrow})(("a", "b"), 2) == 20
    assert predictor_of({"a": wide, "b": wide})(("a", "b"), 2) == 40


def test_passed_deadline_predicts_nothing() -> None:
    component = a_component(apt={"maximum_response_time": at_most(30)})

    assert alone_of(component, answers(40.0, 10.0), 20, 1, None) is None
    assert alone_of(component, [], 20, 1, None) is None


@pytest.mark.parametrize(("waits", "work"), [(0.0, 12.0), (30.0, 12.0), (30.0, 0.0)])
def test_waiting_and_work_are_read_off_the_curve(waits: float, work: float) -> None:
    assert waits_and_work(answers(waits, work)) == pytest.approx((waits, work), abs=1e-6)


def test_neither_is_below_nothing() -> None:
    steeper, rising = waits_and_work([(10.0, 100.0), (20.0, 40.0)]), waits_and_work([(10.0, 40.0), (20.0, 50.0)])

    assert steeper[0] == 0.0 < steeper[1]
    assert rising[1] == 0.0 < rising[0]
