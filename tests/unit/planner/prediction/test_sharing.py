"""Processor sharing: what follows by hand, and what the curve of a component alone says of it."""

from math import inf

import pytest

from rarms_iac.planner.prediction.periodic import MemberDemand, demand_of, least_shared, responses

BUSY = MemberDemand(waits_ms=0.0, work_ms=10.0, enough=20)  # answers after 50 ms there, and never waits
HALF = MemberDemand(waits_ms=40.0, work_ms=8.0, enough=20)  # computes half of the time there


def test_two_that_never_wait_need_the_sum_if_they_are_alike() -> None:
    assert least_shared([BUSY, BUSY], 1) == pytest.approx(40, abs=0.1)


def test_who_waits_leaves_its_time_to_the_other() -> None:
    together = least_shared([HALF, HALF], 1)

    assert together == pytest.approx(30, abs=0.1), "8 ms of work take half as long again beside one that waits half"
    assert responses([HALF, HALF], together, 1) == pytest.approx((80.0, 80.0), rel=0.01)


def test_who_never_waits_leaves_nothing() -> None:
    assert least_shared([BUSY, HALF], 1) == pytest.approx(40, abs=0.1), "half of it is for the other, whenever it asks"


def test_with_a_processor_each_nobody_is_slower() -> None:
    assert least_shared([BUSY, BUSY], 2) == pytest.approx(20, abs=0.1)
    assert least_shared([BUSY, BUSY, BUSY], 2) == pytest.approx(30, abs=0.1)


def test_one_on_two_processors_leaves_none() -> None:
    wide = MemberDemand(waits_ms=0.0, work_ms=10.0, enough=20, parallel=2.0)

    assert responses([wide, BUSY], 20, 2) == pytest.approx((75.0, 75.0))


def test_a_periodic_job_that_is_not_done_when_the_next_is_due_never_is() -> None:
    often = MemberDemand(waits_ms=0.0, work_ms=10.0, enough=50, period_ms=25.0)

    assert responses([often], 50, 1) == pytest.approx((20.0,))
    assert responses([often], 30, 1) == (inf,)


@pytest.mark.parametrize(("waits", "work"), [(0.0, 12.0), (30.0, 12.0), (30.0, 0.0)])
def test_the_demand_is_read_off_the_curve(waits: float, work: float) -> None:
    points = [(reserve, waits + 100 * work / reserve) for reserve in (10.0, 20.0, 50.0, 90.0)]
    found = demand_of(points, enough=30)

    assert found is not None
    assert (found.waits_ms, found.work_ms) == pytest.approx((waits, work), abs=1e-6)


def test_neither_part_of_it_is_below_nothing() -> None:
    steeper = demand_of([(10.0, 100.0), (20.0, 40.0)], enough=10)
    rising = demand_of([(10.0, 40.0), (20.0, 50.0)], enough=10)

    assert steeper is not None
    assert rising is not None
    assert (steeper.waits_ms, rising.work_ms) == (0.0, 0.0)
    assert steeper.work_ms > 0 < rising.waits_ms


def test_without_a_measured_answer_there_is_no_demand() -> None:
    assert demand_of([], enough=10) is None
