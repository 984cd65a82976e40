"""What the scheduler model never does, with any programs: time is neither lost nor made, and shares are kept."""

from collections import defaultdict
from dataclasses import dataclass, replace
from itertools import pairwise
from math import floor, inf

from hypothesis import example, given, settings
from hypothesis import strategies as st

from rarms_iac.model.loads import Browser, BusyLoop
from rarms_iac.providers.simulated.scheduling.hypervisor import SHORTEST_TURN_MS
from rarms_iac.providers.simulated.scheduling.machine import (
    IDLE,
    INTERRUPT,
    PARENT,
    JobDemand,
    ModelMachine,
    TracePiece,
    VirtualMachine,
)
from rarms_iac.providers.simulated.scheduling.simulation import SchedulerSimulation
from tests.effort import examples

UNTIL_MS = 160.0
GRAIN = 1e-3  # ms: rounding of the model's floats over a run, with plenty to spare

periods = st.one_of(st.none(), st.floats(5, 200))
loads = st.lists(
    st.one_of(
        st.builds(BusyLoop, threads=st.one_of(st.none(), st.integers(1, 3))),
        st.builds(Browser, instances=st.integers(1, 4)),
    ),
    max_size=2,
)


@st.composite
def demands(draw: st.DrawFn, name: str) -> JobDemand:
    return JobDemand(
        component=name,
        work_ms=draw(st.floats(0.1, 80)),
        blocked_ms=draw(st.sampled_from([0.0, 0.5, 12.0])),
        varies=draw(st.sampled_from([0.0, 5.0, 40.0])),
        threads=draw(st.integers(1, 3)),
        period_ms=draw(periods),
        timeout_ms=draw(st.sampled_from([inf, inf, 25.0])),
        priority=draw(st.sampled_from([8, 8, 20, 31])),
    )


@st.composite
def machines(draw: st.DrawFn, *, interrupts: bool = True) -> ModelMachine:
    lps = draw(st.integers(1, 4))
    left = 100.0 * lps
    made = []
    for number in range(draw(st.integers(1, 4))):
        vps = draw(st.integers(1, lps))
        reserve = draw(st.integers(0, min(100, floor(left / vps))))
        left -= reserve * vps
        made.append(
            VirtualMachine(
                name=f"vm{number}",
                vps=vps,
                reserve=reserve,
                limit=draw(st.one_of(st.just(100), st.integers(max(1, reserve), 100))),
                weight=draw(st.integers(1, 1000)),
                memory_mib=draw(st.one_of(st.none(), st.just(512))),
                components=tuple(draw(demands(f"c{number}{index}")) for index in range(draw(st.integers(0, 2)))),
                loads=tuple(draw(loads)),
                partitioned=draw(st.booleans()),
            )
        )
    taken = draw(st.sampled_from([0.0, 5.0, 40.0])) if interrupts else 0.0
    return ModelMachine(lps=lps, machines=tuple(made), interrupts=taken)


@dataclass(frozen=True, slots=True)
class Ran:
    simulation: SchedulerSimulation
    pieces: list[TracePiece]
    jobs: int


def run(machine: ModelMachine, until_ms: float = UNTIL_MS, seed: int = 1) -> Ran:
    pieces: list[TracePiece] = []
    simulation = SchedulerSimulation(machine, seed, until_ms=until_ms, trace=pieces.append)
    return Ran(simulation, pieces, sum(1 for _ in simulation))


@given(machines())
@settings(max_examples=examples(8), deadline=None)
def test_every_lp_does_one_thing_at_once(machine: ModelMachine) -> None:
    pieces = run(machine).pieces

    for number in range(machine.lps):
        its = [piece for piece in pieces if piece.lp == number]
        assert its[0].began == 0.0
        assert its[-1].ended == UNTIL_MS
        assert all(before.ended == after.began for before, after in pairwise(its))


@given(machines())
@settings(max_examples=examples(8), deadline=None)
def test_no_vp_is_on_two_lps_at_once(machine: ModelMachine) -> None:
    by_vp: dict[str, list[TracePiece]] = defaultdict(list)
    for piece in run(machine).pieces:
        if piece.ran not in (IDLE, INTERRUPT, PARENT):
            by_vp[piece.ran].append(piece)

    for its in by_vp.values():
        its.sort(key=lambda run: run.began)
        assert all(before.ended <= after.began for before, after in pairwise(its))


@given(st.lists(demands("x"), min_size=1, max_size=3), st.integers(1, 3), st.integers(0, 100))
@settings(max_examples=examples(8), deadline=None)
def test_what_components_consumed_is_what_their_vps_ran(asked: list[JobDemand], lps: int, reserve: int) -> None:
    named = tuple(_named(demand, f"c{number}") for number, demand in enumerate(asked))
    vm = VirtualMachine(name="vm", vps=lps, reserve=reserve, components=named)

    ran = run(ModelMachine(lps=lps, machines=(vm,), interrupts=10))

    on_vps = sum(piece.ended - piece.began for piece in ran.pieces if piece.ran.startswith("vm."))
    assert abs(on_vps - sum(ran.simulation.consumed_ms(demand.component) for demand in named)) < GRAIN


@given(st.floats(0.5, 60), st.integers(1, 3), st.integers(1, 100))
@settings(max_examples=examples(8), deadline=None)
def test_job_is_paid_in_full_and_only_once(work: float, threads: int, reserve: int) -> None:
    asked = JobDemand(component="c", work_ms=work, threads=threads)
    machine = ModelMachine(
        lps=2,
        machines=(
            VirtualMachine(name="P1", vps=2, reserve=reserve, components=(asked,)),
            VirtualMachine(name="P2", vps=2, reserve=100 - reserve, loads=(BusyLoop(),)),
        ),
    )

    jobs = list(SchedulerSimulation(machine, 1, until_ms=UNTIL_MS))

    assert all(abs(job.cpu - work * number) < GRAIN for number, job in enumerate(jobs, start=1))


@given(machines())
@settings(max_examples=examples(8), deadline=None)
def test_a_limit_is_passed_in_no_window(machine: ModelMachine) -> None:
    used = _by_window(run(machine).pieces, machine.window_ms)

    for vm in machine.machines:
        allowed = vm.limit / 100 * machine.window_ms + GRAIN
        assert all(time <= allowed for (vp, _), time in used.items() if vp.startswith(f"{vm.name}."))


@given(machines())
@settings(max_examples=examples(8), deadline=None)
def test_limit_bounds_every_span(machine: ModelMachine) -> None:
    """Two windows may lie back to back, one used at its end and one at its beginning: more than that is never had."""
    ran = run(machine, 500.0)

    for vm in machine.machines:
        share = vm.limit / 100
        for number in range(vm.vps):
            most = _most_ahead(ran.pieces, f"{vm.name}.{number}", share)
            assert most <= share * 2 * machine.window_ms * (1.0 - share) + GRAIN


def test_limit_may_be_used_twice_within_a_window() -> None:
    """So the bound is not wider than it has to be: a job that is due late in a window uses that one and the next."""
    late = JobDemand(component="c", work_ms=60.0, period_ms=270.0)
    vm = VirtualMachine(name="vm", vps=1, limit=30, components=(late,))
    ran = run(ModelMachine(lps=1, machines=(vm,)), 1000.0)

    assert 0.9 <= _most_ahead(ran.pieces, "vm.0", 0.3) / (0.3 * 2 * 100.0 * 0.7) <= 1.0


@given(machines(interrupts=False), st.integers(1, 100))
@settings(max_examples=examples(8), deadline=None)
def test_no_lp_idles_while_thread_could_use_it(machine: ModelMachine, weight: int) -> None:
    greedy = VirtualMachine(name="greedy", vps=machine.lps, weight=weight, loads=(BusyLoop(),))
    pieces = run(ModelMachine(lps=machine.lps, machines=(*machine.machines, greedy))).pieces

    assert sum(piece.ended - piece.began for piece in pieces if piece.ran == IDLE) == 0.0


@st.composite
def machines_with_steady(draw: st.DrawFn) -> ModelMachine:
    """The last machine always demands: it is `steady`, and has what the others leave of the reserves."""
    machine = draw(machines(interrupts=False))
    left = 100 * machine.lps - sum(vm.vps * vm.reserve for vm in machine.machines)
    vps = draw(st.integers(1, machine.lps))
    reserve = draw(st.integers(0, min(100, floor(left / vps))))
    quiet = tuple(_without_browsers(vm) for vm in machine.machines)
    return replace(machine, machines=(*quiet, _steady(reserve, vps)))


def _steady(reserve: float, vps: int = 1) -> VirtualMachine:
    return VirtualMachine(name="steady", vps=vps, reserve=reserve, loads=(BusyLoop(),))


def _reserved(
    name: str, reserve: float, *demands: JobDemand, weight: int = 100, loads: tuple[BusyLoop, ...] = ()
) -> VirtualMachine:
    return VirtualMachine(name=name, vps=1, reserve=reserve, weight=weight, components=demands, loads=loads)


# The last claim of `steady` is used up while no other waits: what it runs beyond is not a debt.
ALONE_ON_ONE_LP = ModelMachine(
    lps=1,
    machines=(
        _reserved(
            "vm0",
            88,
            JobDemand(component="c00", work_ms=47, blocked_ms=0.5, varies=5, threads=2, period_ms=101),
            JobDemand(component="c01", work_ms=67, blocked_ms=12),
            weight=1,
        ),
        _steady(1),
    ),
)
ALONE_ON_ONE_OF_TWO_LPS = ModelMachine(
    lps=2,
    machines=(
        _reserved(
            "vm0",
            100,
            JobDemand(component="c00", work_ms=25, threads=3, period_ms=153.6),
            JobDemand(component="c01", work_ms=61.3, blocked_ms=12, varies=5, threads=3, period_ms=95.3),
        ),
        _reserved("vm1", 26, JobDemand(component="c10", work_ms=57.7, period_ms=56.2), loads=(BusyLoop(),)),
        _reserved("vm2", 45, JobDemand(component="c20", work_ms=2.6, blocked_ms=12, varies=40)),
        _steady(1),
    ),
)


@given(machines_with_steady())
@example(ALONE_ON_ONE_LP)
@example(ALONE_ON_ONE_OF_TWO_LPS)
@settings(max_examples=examples(10), deadline=None)
def test_a_reserve_that_is_demanded_is_given(machine: ModelMachine) -> None:
    """Over any time t from any moment on, a VP that always demands gets its share of all but one window of t."""
    pieces = run(machine, 500.0).pieces

    steady = machine.machines[-1]
    share = steady.reserve / 100
    for number in range(steady.vps):
        wanted = _most_behind(pieces, f"steady.{number}", share)
        assert wanted <= share * (machine.window_ms + 5 * SHORTEST_TURN_MS) + GRAIN


def _named(demand: JobDemand, name: str) -> JobDemand:
    return replace(demand, component=name, priority=8, period_ms=None)


def _without_browsers(vm: VirtualMachine) -> VirtualMachine:
    return replace(vm, loads=tuple(load for load in vm.loads if not isinstance(load, Browser)))


def _by_window(pieces: list[TracePiece], window_ms: float) -> dict[tuple[str, int], float]:
    used: dict[tuple[str, int], float] = defaultdict(float)
    for piece in pieces:
        window = floor(piece.began / window_ms + 1e-9)
        while window * window_ms < piece.ended - GRAIN:
            begin, end = max(piece.began, window * window_ms), min(piece.ended, (window + 1) * window_ms)
            used[piece.ran, window] += max(0.0, end - begin)
            window += 1
    return used


def _most_ahead(pieces: list[TracePiece], vp: str, share: float) -> float:
    """The most that the VP got more than its share between any two moments, in ms."""
    ahead = least = most = at = 0.0
    for piece in sorted((run for run in pieces if run.ran == vp), key=lambda run: run.began):
        ahead -= share * (piece.began - at)
        least = min(least, ahead)
        ahead += (1.0 - share) * (piece.ended - piece.began)
        most = max(most, ahead - least)
        at = piece.ended
    return most


def _most_behind(pieces: list[TracePiece], vp: str, share: float) -> float:
    """The most that the VP got less than its share between any two moments, in ms."""
    behind = least = most = at = 0.0
    for piece in sorted((run for run in pieces if run.ran == vp), key=lambda run: run.began):
        behind += share * (piece.began - at)
        most = max(most, behind - least)
        behind -= (1.0 - share) * (piece.ended - piece.began)
        least = min(least, behind)
        at = piece.ended
    return max(most, behind + share * (500.0 - at) - least)
