"""From data logs of components alone to what each way predicts of them together."""

from dataclasses import replace

import pytest

from rarms_iac.planner.prediction.members import (
    WAYS,
    Alone,
    Predictor,
    expected_of,
    predictions_of,
    predictor_of,
    task_of,
)
from rarms_iac.planner.prediction.periodic import MemberDemand, least_budget, meets_by_deadline

CAMERA = Alone(
    demand=MemberDemand(waits_ms=0.0, work_ms=10.0, enough=30, period_ms=100.0),
    task=task_of(10.0, 100.0, 60.0),
    processors=1,
)
LASER = Alone(
    demand=MemberDemand(waits_ms=5.0, work_ms=4.0, enough=25, period_ms=40.0),
    task=task_of(4.0, 40.0, 40.0),
    processors=1,
)


def test_each_way_says_at_least_what_the_neediest_needs_or_the_rate_takes() -> None:
    sharing, evenly, by_deadline, by_priority = predictions_of([CAMERA, LASER], 1)

    assert sharing is not None
    assert by_deadline is not None
    assert by_priority is not None
    assert 30 <= sharing <= 55
    assert evenly is not None
    assert 20 <= evenly <= 100
    assert 20 <= by_deadline <= by_priority <= 100, "no fixed priorities do with less than earliest deadline first"


def test_without_deadlines_only_sharing_says_something() -> None:
    sharing, *others = predictions_of([CAMERA, replace(LASER, task=None)], 1)

    assert sharing is not None
    assert others == [None, None, None]


def test_a_task_is_fitted_to_what_it_needs_alone() -> None:
    fitted = CAMERA.fitted(100, meets_by_deadline)

    assert CAMERA.task is not None
    assert fitted is not None
    assert fitted.work > CAMERA.task.work, "30 % were measured to be needed, more than its work takes"
    assert least_budget([fitted], 100, meets_by_deadline) == pytest.approx(30, abs=1)


def test_what_was_measured_on_other_processors_predicts_nothing() -> None:
    assert predictions_of([CAMERA, LASER], 2) == (None,) * len(WAYS)


def test_compounds_with_an_unknown_member_are_not_predicted() -> None:
    predictor = predictor_of({"camera": CAMERA, "laser": LASER})

    assert predictor.of(("camera", "laser"), 1) == predictions_of([CAMERA, LASER], 1)
    assert predictor.of(("camera", "radio"), 1) == (None,) * len(WAYS)
    assert expected_of(predictor, ("camera", "radio"), 1, [30, 20]) is None


def test_what_is_expected_lies_from_the_neediest_upwards() -> None:
    predictor = Predictor(ways=("one",), predict=lambda _members, _processors: (45.0,))
    found = expected_of(predictor, ("a", "b"), 1, [40, 20])

    assert found is not None
    assert 42 <= found <= 50


def test_a_task_is_rounded_to_the_safe_side() -> None:
    task = task_of(1.015, 9.999, 5.559)

    assert (task.work, task.period, task.deadline) == (102, 999, 555)


@pytest.mark.parametrize("work", [0.0, 1e-9])
def test_a_task_takes_some_time(work: float) -> None:
    assert task_of(work, 10.0, 10.0).work == 1
