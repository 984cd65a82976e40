"""The scheduler model against schedules worked out by hand."""

from itertools import islice, pairwise

import pytest

from rarms_iac.model.loads import LOADS_WITHOUT_ENTRY, Browser, BusyLoop, CommandLoad
from rarms_iac.providers.simulated.measuring import demand_of, model_load
from rarms_iac.providers.simulated.scheduling.hypervisor import QUANTUM_MS
from rarms_iac.providers.simulated.scheduling.machine import (
    IDLE,
    BurstLoads,
    JobDemand,
    JobDone,
    ModelMachine,
    TracePiece,
    VirtualMachine,
)
from rarms_iac.providers.simulated.scheduling.simulation import SchedulerSimulation
from tests.builders import a_component, a_run, a_simulation


def face_detection(varies: float = 0) -> JobDemand:
    return JobDemand(component="face-detection", work_ms=61.6, blocked_ms=26.4, varies=varies)


def bench(demand: JobDemand, reserve: float, *, lps: int = 2) -> ModelMachine:
    """The test partitions P1 with the component and P2 with a busy loop a VP.

    P2's weight has all but a hundredth of what P1's idle VP leaves, so that P1 gets no more than it reserves.
    """
    return ModelMachine(
        lps=lps,
        machines=(
            VirtualMachine(name="P1", vps=lps, reserve=reserve, components=(demand,)),
            VirtualMachine(name="P2", vps=lps, reserve=100 - reserve, weight=10_000, loads=(BusyLoop(),)),
        ),
    )


def first(machine: ModelMachine, count: int, seed: int = 1) -> list[JobDone]:
    return list(islice(SchedulerSimulation(machine, seed), count))


def test_lone_job_takes_blocked_time_and_work() -> None:
    machine = ModelMachine(lps=1, machines=(VirtualMachine(name="P1", vps=1, components=(face_detection(),)),))

    jobs = first(machine, 3)

    assert [round(job.response, 6) for job in jobs] == [88.0, 88.0, 88.0]
    assert [round(job.began, 6) for job in jobs] == [0.0, 88.0, 176.0]
    assert [round(job.cpu, 6) for job in jobs] == [61.6, 123.2, 184.8]


def test_busy_loops_stretch_work_by_reserve() -> None:
    [*_, last] = first(bench(face_detection(), 10), 150)

    assert abs((last.began + last.response) / 150 - 61.6 / 0.10) < 6.16


def test_sufficient_reserve_is_as_fast_as_alone() -> None:
    assert {88.0} == {round(job.response, 6) for job in first(bench(face_detection(), 75), 50)[1:]}


def test_seed_decides_the_jobs() -> None:
    machine = bench(face_detection(varies=5), 40)

    assert first(machine, 20, seed=7) == first(machine, 20, seed=7) != first(machine, 20, seed=8)


def test_late_periodic_job_counts_from_due() -> None:
    overrun = JobDemand(component="video", work_ms=15, period_ms=10, success_within_ms=24)
    machine = ModelMachine(lps=1, machines=(VirtualMachine(name="P1", vps=1, components=(overrun,)),))

    jobs = first(machine, 3)
    began = jobs[0].began

    assert 0.0 < began < 10.0, "at a random moment of its period"
    assert [(round(job.began - began, 6), round(job.response, 6), job.successful) for job in jobs] == [
        (0.0, 15.0, True),
        (10.0, 20.0, True),
        (20.0, 25.0, False),
    ]


def test_timed_out_job_uses_nothing_more() -> None:
    """60 ms of work every 50 ms, ended after 20 ms each: 40 % are used, and the busy loop below has the rest."""
    late = JobDemand(component="late", work_ms=60, period_ms=50, timeout_ms=20, priority=20)
    behind = JobDemand(component="behind", work_ms=30)
    machine = ModelMachine(lps=1, machines=(VirtualMachine(name="P1", vps=1, components=(late, behind)),))
    simulation = SchedulerSimulation(machine, 1, until_ms=10_000)

    jobs = list(simulation)
    ended = [job for job in jobs if job.component == "late"]

    assert [(round(job.began - ended[0].began, 6), round(job.response, 6), job.answered) for job in ended[:2]] == [
        (0.0, 20.0, False),
        (50.0, 20.0, False),
    ]
    assert not any(job.successful for job in ended)
    assert simulation.consumed_ms("late") == pytest.approx(4000.0, rel=0.01)
    assert simulation.consumed_ms("behind") + simulation.consumed_ms("late") == pytest.approx(10_000.0)


def test_waiting_job_is_timed_out_too() -> None:
    waits = JobDemand(component="waits", work_ms=1, blocked_ms=30, timeout_ms=10)
    starved = JobDemand(component="starved", work_ms=5, timeout_ms=10, priority=1)
    first_of_all = VirtualMachine(name="P1", vps=1, components=(waits, starved), loads=(BusyLoop(threads=1),))

    simulation = SchedulerSimulation(ModelMachine(lps=1, machines=(first_of_all,)), 1, until_ms=100)
    jobs = list(simulation)

    assert [job.component for job in jobs].count("waits") == 10
    assert [job.component for job in jobs].count("starved") == 10
    assert not any(job.answered for job in jobs)
    assert simulation.consumed_ms("waits") == simulation.consumed_ms("starved") == 0.0


def test_timely_job_ends_its_watch() -> None:
    quick = JobDemand(component="quick", work_ms=8, timeout_ms=10)
    machine = ModelMachine(lps=1, machines=(VirtualMachine(name="P1", vps=1, components=(quick,)),))

    assert all(job.answered and round(job.response, 6) == 8.0 for job in first(machine, 50))


def test_parallel_work_uses_all_vps() -> None:
    wide = JobDemand(component="wide", work_ms=40, threads=2, period_ms=None)
    machine = ModelMachine(lps=2, machines=(VirtualMachine(name="P1", vps=2, components=(wide,)),))

    assert round(first(machine, 1)[0].response, 6) == 20.0


def test_it_ends_on_request_with_consumption() -> None:
    simulation = SchedulerSimulation(bench(face_detection(), 50), 1, until_ms=1000)

    jobs = list(simulation)

    assert jobs
    assert 490 < simulation.consumed_ms("face-detection") < 510


def bursts(lps: int = 2) -> ModelMachine:
    """A load that wakes on every VP for 20 ms, with 30 ms between, and nothing beside it."""
    load = BurstLoads(burst_ms=20.0, gap_ms=30.0)
    return ModelMachine(lps=lps, machines=(VirtualMachine(name="P2", vps=lps, loads=(load,)),))


def busy_pieces(machine: ModelMachine, lp: int, until_ms: float = 5000.0) -> list[TracePiece]:
    """When the LP ran something."""
    pieces: list[TracePiece] = []
    list(SchedulerSimulation(machine, 1, until_ms=until_ms, trace=pieces.append))
    return [piece for piece in pieces if piece.lp == lp and piece.ran != IDLE]


def test_burst_threads_wake_together() -> None:
    first_lp, second_lp = busy_pieces(bursts(), 0), busy_pieces(bursts(), 1)

    assert [piece.began for piece in first_lp] == [piece.began for piece in second_lp]
    assert {round(piece.ended - piece.began, 6) for piece in first_lp[:-1]} == {20.0}


def test_gaps_between_bursts_are_random() -> None:
    pieces = busy_pieces(bursts(), 0, until_ms=60_000.0)
    gaps = [later.began - earlier.ended for earlier, later in pairwise(pieces)]

    assert 15.0 <= min(gaps) < 16.0
    assert 44.0 < max(gaps) <= 45.0
    assert abs(sum(gaps) / len(gaps) - 30.0) < 1.0
    assert len({round(gap, 6) for gap in gaps}) == len(gaps)


def test_burst_is_processor_time_however_long_that_takes() -> None:
    """Beside a partition that takes half of the LP, 20 ms last longer, and the gap is none the shorter."""
    load = BurstLoads(burst_ms=20.0, gap_ms=30.0)
    other = VirtualMachine(name="P1", vps=1, reserve=70, loads=(BusyLoop(),))
    machine = ModelMachine(lps=1, machines=(other, VirtualMachine(name="P2", vps=1, reserve=30, loads=(load,))))
    pieces: list[TracePiece] = []
    list(SchedulerSimulation(machine, 1, until_ms=30_000.0, trace=pieces.append))

    consumed = sum(piece.ended - piece.began for piece in pieces if piece.ran == "P2.0")
    assert 0.27 < consumed / 30_000.0 < 0.31, "20 ms at 30 % take up to 67 ms, less what was saved in the gap"


def test_restarted_load_gives_p1_nothing_extra() -> None:
    starts, left_out_ms, counted_ms = 100, 500.0, 500.0
    demand = JobDemand(component="coi", work_ms=5.0)
    p1 = VirtualMachine(name="P1", vps=1, reserve=10, components=(demand,))
    p2 = VirtualMachine(name="P2", vps=4, reserve=90, weight=10_000, loads=(BusyLoop(),))
    machine = SchedulerSimulation(ModelMachine(lps=4, machines=(p1, p2)), 1)
    began, counted, seen = 0.0, 0, 0.0
    for job in machine:
        now = job.began + job.response
        if now - began > left_out_ms + counted_ms:
            counted += 1
            if counted > starts:
                break
            machine.restart_loads()
            began = now
        elif counted and now - began > left_out_ms:
            seen += demand.work_ms

    assert seen / (starts * counted_ms) == pytest.approx(0.10, rel=0.08)


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
    """Jobs of 20 ms one after another share the processor with the loop: no job begins a turn again."""
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


def test_a_component_s_simulation_is_its_demand() -> None:
    asked = a_simulation(work="61.6 ms", blocked="26.4 ms", varies="5 %", threads=2, within="400 ms")
    wanted = JobDemand(
        component="vision",
        work_ms=61.6,
        blocked_ms=26.4,
        varies=5.0,
        threads=2,
        success_within_ms=400.0,
        timeout_ms=5000.0,
        priority=24,
    )

    assert demand_of(a_component("vision", run=a_run(timeout="5 s"), simulation=asked), priority=24) == wanted


def test_a_periodic_component_keeps_its_period() -> None:
    video = a_component(run=a_run(every="33 ms"), simulation=a_simulation())

    assert demand_of(video).period_ms == 33.0


def test_bursts_without_duty_take_what_their_partition_reserves() -> None:
    assert model_load(LOADS_WITHOUT_ENTRY["bursts-50"], 80) == BurstLoads(burst_ms=40.0, gap_ms=10.0)
    assert model_load(LOADS_WITHOUT_ENTRY["bursts-50-half"], 80) == BurstLoads(burst_ms=25.0, gap_ms=25.0)


@pytest.mark.parametrize("load", [BusyLoop(), BusyLoop(threads=3), Browser(instances=5)])
def test_a_load_that_the_model_knows_is_itself(load: BusyLoop | Browser) -> None:
    assert model_load(load) == load


def test_unknown_program_never_waits() -> None:
    assert model_load(CommandLoad(command=("stress",), instances=2)) == BusyLoop(threads=2)
