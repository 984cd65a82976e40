"""What every host that is measured on keeps to; `host` is where another provider joins."""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import islice
from pathlib import Path

import pytest

from rarms_iac.measuring.partitions import (
    remove_test_partitions,
    running_test_partitions,
    set_reserves,
    shapes_of_test_partitions,
)
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.loads import (
    LOADS_WITHOUT_ENTRY,
    BusyLoop,
    CommandLoad,
    Interference,
    Stress,
    equal_parts,
    load_parts,
)
from rarms_iac.model.run import Elapsed, Run, SampleCount, Samples, TimeField
from rarms_iac.model.series import Sample
from rarms_iac.model.setting import LOAD_PARTITIONS, P1, P2, EnvironmentSetup
from rarms_iac.model.system import Component
from rarms_iac.providers.cgroups.measuring import LinuxMeasuringHost
from rarms_iac.providers.interface import HostRefused
from rarms_iac.providers.measuring import MeasuringHost, Obstacle, PartitionWork, Work
from rarms_iac.providers.simulated.measuring import SimulatedMeasuringHost
from rarms_iac.providers.simulated.scheduling.simulation import SchedulerSimulation
from tests.builders import a_component, a_host, a_run, a_simulation, memory, milliseconds
from tests.contracts.benches import forget_groups, groups_of, slice_of
from tests.needs import CHECKOUT

JOBS = """\
import json, os, sys, time
for _ in range(int(sys.argv[3]) - 1):
    if os.fork() == 0:
        break
due = time.perf_counter()
while True:
    used = time.process_time()
    while time.process_time() - used < float(sys.argv[1]): pass
    now = time.perf_counter()
    print(json.dumps({"ms": 1000 * (now - due)}), flush=True)
    time.sleep(max(0.0, float(sys.argv[2])))
    due = time.perf_counter()
"""
"""A real component: so much processor time and so much sleep a job, in seconds, in so many processes."""


def simulated(folder: Path) -> MeasuringHost:
    return SimulatedMeasuringHost(a_host(), folder / "onboard.json", SchedulerSimulation)


def linux(folder: Path) -> MeasuringHost:
    """This machine, with components that are real programs."""
    (folder / "jobs.py").write_text(JOBS, encoding="utf-8")
    return LinuxMeasuringHost(a_host(provider=ProviderKind.LINUX), folder, folder / "state", groups_of(folder))


SETUP = EnvironmentSetup(
    members=("ears", "eyes"), interference="busy-loop", processors=2, memory=memory("512 MiB"), limit=100, weight=100
)
SHAPES = shapes_of_test_partitions(SETUP, memory("256 MiB"), (2, 2))


def program(work_s: float, sleep_s: float = 0.0, processes: int = 1) -> Run:
    words = ("python3", "jobs.py", str(work_s), str(sleep_s), str(processes))
    return a_run(command=words, samples=Samples(source="json_lines", response_time=TimeField(field="ms", unit="ms")))


BUSY = BusyLoop()
EYES = a_component(
    "eyes", run=program(0.004, 0.002), simulation=a_simulation(work="4 ms", blocked="2 ms", varies="10 %")
)
EARS = a_component("ears", run=program(0.001, 0.019), simulation=a_simulation(work="1 ms", varies="10 %"))


LATER = pytest.mark.system
"""Takes seconds of all processors, and is left out of a usual run as tests/system is."""


@pytest.fixture(params=[simulated, pytest.param(linux, marks=[pytest.mark.needs("control-groups"), pytest.mark.alone])])
def host(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[MeasuringHost]:
    made = request.param(tmp_path)
    assert isinstance(made, MeasuringHost)
    yield made
    forget_groups(tmp_path)


@contextmanager
def ready(host: MeasuringHost, reserve: int = 60, load: Interference = BUSY) -> Iterator[None]:
    parts = parts_of(load)
    shapes = SHAPES[: 1 + parts]
    with running_test_partitions(host, "robot", shapes):
        of_part = {shape.name: (100 - reserve) // parts for shape in shapes[1:]}
        set_reserves(host, "robot", shapes, {P1: reserve, **of_part})
        yield


def parts_of(load: Interference) -> int:
    return equal_parts(load) if load_parts(load, 2) > 1 else 1


def some_work(*components: Component, seed: int = 7, load: Interference = BUSY, **until: SampleCount | Elapsed) -> Work:
    return Work(
        application="robot",
        partitions=(
            PartitionWork(partition=P1, components=components),
            *(PartitionWork(partition=name, load=load) for name in LOAD_PARTITIONS[: parts_of(load)]),
        ),
        until=until,
        seed=seed,
    )


def seen(host: MeasuringHost, work: Work) -> list[tuple[str, Sample]]:
    with host.run(work) as running:
        return list(running.samples())


def test_every_component_gets_enough_samples(host: MeasuringHost) -> None:
    work = some_work(EYES, EARS, eyes=SampleCount(samples=30), ears=SampleCount(samples=12))
    with ready(host):
        names = [name for name, _ in seen(host, work)]

    assert names.count("eyes") >= 30
    assert names.count("ears") >= 12
    assert names.count("eyes") == 30 or names.count("ears") == 12


def test_samples_come_in_order_in_which_jobs_end(host: MeasuringHost) -> None:
    with ready(host):
        samples = seen(host, some_work(EYES, EARS, eyes=SampleCount(samples=30)))

    assert all(sample.successful and not sample.failure for _, sample in samples)
    for component in ("eyes", "ears"):
        ends = [sample.began_ms + (sample.response_ms or 0) for name, sample in samples if name == component]
        assert ends == sorted(ends)


def test_fixed_time_runs_to_its_end(host: MeasuringHost) -> None:
    clock, consumed = [0.0], [0.0]
    with ready(host), host.run(some_work(EYES, eyes=Elapsed(time=milliseconds("500 ms")))) as running:
        for name, _ in running.samples():
            clock.append(running.elapsed_ms())
            consumed.append(running.cpu_ms(name) or 0.0)

    assert clock == sorted(clock)
    assert clock[-1] >= 500
    assert consumed == sorted(consumed)
    assert 0 < consumed[-1] <= 2 * clock[-1]


def test_counting_begins_on_request_and_lasts(host: MeasuringHost) -> None:
    work = replace(some_work(EYES, eyes=SampleCount(samples=10)), least_ms=5 * host.scheduler_memory_ms)
    began = 0.0
    with ready(host), host.run(work) as running:
        for number, _ in enumerate(running.samples(), start=1):
            if number == 8:
                began = running.elapsed_ms()
                running.count_from_now()
        assert number >= 18
        assert running.elapsed_ms() >= began + 5 * host.scheduler_memory_ms > began > 0


@pytest.mark.parametrize(("load", "begins_anew"), [("busy-loop", True), pytest.param("bursts-20", False, marks=LATER)])
def test_steady_load_restarts_while_components_run(load: str, begins_anew: bool, host: MeasuringHost) -> None:
    work = some_work(EYES, load=LOADS_WITHOUT_ENTRY[load], eyes=SampleCount(samples=40))
    with ready(host), host.run(work) as running:
        samples = running.samples()
        list(islice(samples, 5))
        running.count_from_now()  # its start is over
        answers = [running.restart_load() for _ in islice(samples, 40)]
        used = running.used_processors(P1)

    assert set(answers) == {begins_anew}
    assert used == 1


def test_a_listener_that_has_seen_enough_stops_asking(host: MeasuringHost) -> None:
    with ready(host):
        with host.run(some_work(EYES, eyes=SampleCount(samples=10_000))) as running:
            first = list(islice(running.samples(), 5))
        with host.run(some_work(EYES, eyes=SampleCount(samples=5))) as running:
            again = list(running.samples())

    assert len(first) == len(again) == 5


@LATER
def test_more_reserve_is_never_slower(host: MeasuringHost) -> None:
    means = []
    for reserve in (10, 40, 90):
        with ready(host, reserve):
            samples = [
                sample.response_ms or 0.0 for _, sample in seen(host, some_work(EYES, eyes=SampleCount(samples=60)))
            ]
        means.append(sum(samples) / len(samples))

    assert means[0] > 1.3 * means[1]
    assert means[1] >= 0.8 * means[2], "a real machine is noisy"


@LATER
@pytest.mark.parametrize("load", ["bursts-20", "bursts-100-half"])
def test_beside_bursts_components_get_the_rest(host: MeasuringHost, load: str) -> None:
    """P1 reserves 20 %: beside bursts of P2's own 80 % it has hardly more, beside half of the time about half."""
    greedy = a_component("eyes", run=program(0.004, processes=2), simulation=a_simulation(work="4 ms", threads=2))
    described = LOADS_WITHOUT_ENTRY[load]
    work = some_work(greedy, load=described, eyes=Elapsed(time=milliseconds("3000 ms")))
    with ready(host, 20, described), host.run(work) as running:
        assert list(running.samples())
        share = (running.cpu_ms("eyes") or 0.0) / running.elapsed_ms() / 2

    assert 0.3 < share < 0.75 if load.endswith("half") else 0.12 < share < 0.4


@pytest.mark.parametrize(("reserve", "threads"), [(10, 1), (10, 2), (60, 1), (60, 2)])
def test_p1_gets_exactly_cr_on_each_processor(tmp_path: Path, reserve: int, threads: int) -> None:
    host = simulated(tmp_path)
    greedy = a_component("eyes", simulation=a_simulation(work="4 ms", threads=threads))
    with ready(host, reserve), host.run(some_work(greedy, eyes=Elapsed(time=milliseconds("10000 ms")))) as running:
        assert list(running.samples())
        shares = (running.cpu_ms("eyes") or 0.0) / running.elapsed_ms() / threads

    assert shares == pytest.approx(reserve / 100, rel=0.04)


@pytest.mark.needs("control-groups")
@pytest.mark.alone
@pytest.mark.parametrize("reserve", [10, pytest.param(60, marks=LATER)])
def test_real_processes_share_as_p1_and_p2_reserve(tmp_path: Path, reserve: int) -> None:
    """Of what both got: others use this machine, too. Tried three times, as a setting is."""
    host, shares = linux(tmp_path), [0.0]
    greedy = a_component("eyes", run=program(0.004, processes=2))
    work = replace(some_work(greedy, eyes=SampleCount(samples=40)), least_ms=1500.0)
    while abs(shares[-1] - reserve / 100) > 0.03 and len(shares) < 4:
        with ready(host, reserve), host.run(work) as running:
            for number, _ in enumerate(running.samples()):
                if number == 5:
                    running.count_from_now()
            evidence = running.evidence()
        assert evidence is not None
        shares.append(evidence.cpu_ms[P1] / (evidence.cpu_ms[P1] + evidence.load_cpu_ms))
    forget_groups(tmp_path)

    assert shares[-1] == pytest.approx(reserve / 100, abs=0.03), shares


@pytest.mark.needs("control-groups")
@pytest.mark.alone
def test_further_part_without_a_reservation_runs_no_load(tmp_path: Path) -> None:
    """On a full host it would never start, and the measurement would end."""
    host, second = linux(tmp_path), LOAD_PARTITIONS[1]
    with ready(host):
        set_reserves(host, "robot", SHAPES, {P1: 60, P2: 40, second: 0})
        with host.run(some_work(EYES, eyes=SampleCount(samples=20))) as running:
            assert list(running.samples())
            evidence = running.evidence()
    forget_groups(tmp_path)

    assert evidence is not None
    assert (evidence.cpu_ms[P2] > 0, evidence.cpu_ms[second]) == (True, 0)


@pytest.mark.needs("control-groups")
@pytest.mark.alone
def test_real_work_leaves_nothing_and_ran_in_groups(tmp_path: Path) -> None:
    host, groups = linux(tmp_path), groups_of(tmp_path)
    with ready(host):
        both_run = some_work(EYES, EARS, eyes=SampleCount(samples=5), ears=SampleCount(samples=1))
        with host.run(both_run) as running:
            assert list(running.samples())
            inside = {name: len(groups.processes(name)) for name in groups.names()}
            consumed = [running.cpu_ms(name) for name in ("eyes", "ears")]
        after = [groups.processes(name) for name in groups.names()]
    forget_groups(tmp_path)

    assert sorted(inside.values()) == [2, 3, 3], "two components; twice two busy loops and what started them"
    assert all(inside_group == () for inside_group in after)
    assert all(each is not None and each > 0 for each in consumed)


@pytest.mark.needs("control-groups")
@pytest.mark.alone
def test_a_real_host_names_what_it_cannot_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    host = linux(tmp_path)

    assert (host.obstacle(EYES), host.obstacle(BusyLoop())) == (None, None)
    assert reason(host.obstacle(a_component("eyes", run=a_run(command=("no-such-program",))))) == (
        'the program "no-such-program" is not on the PATH'
    )
    assert reason(host.obstacle(a_component("nobody"))) == "it has no `run`"
    assert "no-such-program" in reason(host.obstacle(CommandLoad(command=("no-such-program",))))
    monkeypatch.setenv("PATH", str(tmp_path))
    assert reason(host.obstacle(Stress(stressor="timer"))) == "stress-ng was not found on the PATH: stress-ng"


def reason(obstacle: Obstacle | None) -> str:
    assert obstacle is not None
    return obstacle.reason


KILLED = """\
import sys
from rarms_iac.providers.cgroups.trees import find_tree
from tests.contracts.test_measuring_contract import *
folder = Path(sys.argv[1])
(folder / "jobs.py").write_text(JOBS, encoding="utf-8")
host = LinuxMeasuringHost(a_host(provider=ProviderKind.LINUX), folder, folder / "state", find_tree(sys.argv[2]))
with ready(host), host.run(some_work(EYES, eyes=SampleCount(samples=1_000_000))) as running:
    for _ in running.samples():
        print("running", flush=True)
"""
"""Another rarms that measures on the host of this test."""


@pytest.mark.needs("control-groups")
@pytest.mark.alone
def test_killed_measurement_leaves_nothing_running(tmp_path: Path) -> None:
    groups, words = groups_of(tmp_path), [sys.executable, "-c", KILLED, str(tmp_path), slice_of(tmp_path)]
    with subprocess.Popen(words, cwd=CHECKOUT, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"running\n"
        inside = {name: len(groups.processes(name)) for name in groups.names()}
        other.kill()
    until = time.perf_counter() + 20
    while any(map(groups.processes, groups.names())) and time.perf_counter() < until:
        time.sleep(0.02)
    after = [groups.processes(name) for name in groups.names()]
    removed = remove_test_partitions(linux(tmp_path))
    forget_groups(tmp_path)

    assert inside == {P1: 1, P2: 3, LOAD_PARTITIONS[1]: 3}
    assert after == [(), (), ()]
    assert removed == (P1, *LOAD_PARTITIONS[:2])
    assert groups.names() == ()


@pytest.mark.needs("control-groups")
@pytest.mark.alone
def test_component_that_cannot_start_leaves_nothing(tmp_path: Path) -> None:
    host = linux(tmp_path)
    missing = a_component("eyes", run=a_run(command=("no-such-program",)))
    with ready(host), pytest.raises(HostRefused, match="the program"), host.run(some_work(missing)):
        raise AssertionError("it cannot start")
    assert groups_of(tmp_path).names() == ()


def test_measuring_host_tells_its_platform(host: MeasuringHost) -> None:
    bench = host.platform_facts()

    assert bench.logical_processors == host.observe().facts.logical_processors
    assert bench.processor
    assert bench == host.platform_facts()


def test_what_does_not_run_cannot_be_worked_in(host: MeasuringHost) -> None:
    with pytest.raises(HostRefused), host.run(some_work(EYES, eyes=SampleCount(samples=2))):
        raise AssertionError("there is no P1")


def test_equal_seeds_give_equal_samples(tmp_path: Path) -> None:
    def run(seed: int) -> list[tuple[str, Sample]]:
        host = SimulatedMeasuringHost(a_host(), tmp_path / "onboard.json", SchedulerSimulation)
        with ready(host):
            return seen(host, some_work(EYES, EARS, seed=seed, eyes=SampleCount(samples=20)))

    first = run(7)

    assert run(7) == first, "also in partitions that were made again"
    assert run(8) != first


def test_a_simulated_component_needs_a_demand(tmp_path: Path) -> None:
    host = SimulatedMeasuringHost(a_host(), tmp_path / "onboard.json", SchedulerSimulation)
    work = some_work(a_component("nobody", simulation=None), nobody=SampleCount(samples=2))
    with ready(host), pytest.raises(HostRefused, match="its demand on a simulated host"), host.run(work):
        raise AssertionError("it has no demand")


def test_simulated_job_beyond_timeout_fails(tmp_path: Path) -> None:
    slow = a_component("slow", run=a_run(timeout="10 ms"), simulation=a_simulation(work="50 ms"))
    host = SimulatedMeasuringHost(a_host(), tmp_path / "onboard.json", SchedulerSimulation)
    with ready(host):
        ((name, sample),) = seen(host, some_work(slow, slow=SampleCount(samples=1)))

    assert name == "slow"
    assert (sample.response_ms, sample.successful, sample.failure) == (None, False, "no answer within 10 ms")
