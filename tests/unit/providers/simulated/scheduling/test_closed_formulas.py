"""The scheduler model against formulas: processor sharing, the periodic resource's supply bound, priorities."""

from itertools import islice

import pytest

from rarms_iac.model.loads import BusyLoop
from rarms_iac.providers.simulated.scheduling.hypervisor import QUANTUM_MS
from rarms_iac.providers.simulated.scheduling.machine import JobDemand, ModelMachine, VirtualMachine
from rarms_iac.providers.simulated.scheduling.simulation import SchedulerSimulation


def test_two_equal_threads_of_one_system_take_turns() -> None:
    job = JobDemand(component="job", work_ms=100)
    system = VirtualMachine(name="os", vps=1, components=(job,), loads=(BusyLoop(threads=1),))

    jobs = list(islice(SchedulerSimulation(ModelMachine(lps=1, machines=(system,)), 1), 40))

    assert (jobs[-1].began + jobs[-1].response) / 40 == pytest.approx(200, rel=0.02)


def test_a_thread_that_wakes_has_a_whole_turn() -> None:
    """20 ms of work after a wait are less than a turn: once it runs, each job is done without a second wait."""
    shy = JobDemand(component="shy", work_ms=20, blocked_ms=30)
    system = VirtualMachine(name="os", vps=1, components=(shy,), loads=(BusyLoop(threads=1),))

    responses = [job.response for job in islice(SchedulerSimulation(ModelMachine(lps=1, machines=(system,)), 1), 40)]

    assert all(50.0 <= response <= 50.0 + QUANTUM_MS for response in responses)


def test_ready_thread_keeps_its_turn() -> None:
    """Jobs of 20 ms one after another share the processor with the loop: no job begins a turn anew."""
    steady = JobDemand(component="steady", work_ms=20)
    system = VirtualMachine(name="os", vps=1, components=(steady,), loads=(BusyLoop(threads=1),))

    *_, last = islice(SchedulerSimulation(ModelMachine(lps=1, machines=(system,)), 1), 200)

    assert (last.began + last.response) / 200 == pytest.approx(40.0, rel=0.02)


def test_higher_thread_never_waits_for_lower_one() -> None:
    urgent = JobDemand(component="urgent", work_ms=20, blocked_ms=5, priority=30)
    system = VirtualMachine(name="os", vps=1, components=(urgent,), loads=(BusyLoop(threads=3),))

    jobs = list(islice(SchedulerSimulation(ModelMachine(lps=1, machines=(system,)), 1), 10))

    assert {round(job.response, 6) for job in jobs} == {25.0}


def test_interrupts_take_their_share_from_highest_thread_too() -> None:
    job = JobDemand(component="job", work_ms=30, priority=31)
    system = VirtualMachine(name="os", vps=1, reserve=100, components=(job,))

    jobs = list(islice(SchedulerSimulation(ModelMachine(lps=1, machines=(system,), interrupts=25), 1), 200))

    assert (jobs[-1].began + jobs[-1].response) / 200 == pytest.approx(40, rel=0.03)


def test_more_than_there_is_cannot_be_reserved() -> None:
    greedy = VirtualMachine(name="greedy", vps=2, reserve=80)

    with pytest.raises(ValueError, match="160 % of one LP are reserved, and 1 LPs have 100 %"):
        ModelMachine(lps=1, machines=(greedy,))


def test_a_name_stands_for_one_thing() -> None:
    machine = VirtualMachine(name="P1", vps=1)

    with pytest.raises(ValueError, match="a name stands twice in P1, P1"):
        ModelMachine(lps=1, machines=(machine, machine))
