"""What every host that is measured on keeps to; `HOSTS` is where another provider joins."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import islice
from pathlib import Path

import pytest

from rarms_iac.measuring.partitions import running_test_partitions, set_reserves, shapes_of_test_partitions
from rarms_iac.model.measurement import P1, P2, EnvironmentSetup, Sample
from rarms_iac.model.run import Elapsed, SampleCount
from rarms_iac.model.system import BusyLoop, Component
from rarms_iac.providers.interface import HostRefused
from rarms_iac.providers.measuring import MeasuringHost, PartitionWork, Work
from rarms_iac.providers.simulated.measuring import SimulatedMeasuringHost
from rarms_iac.providers.simulated.scheduling.simulation import simulate
from tests.builders import a_component, a_host, a_run, a_simulation, memory, milliseconds

HOSTS: tuple[Callable[[Path], MeasuringHost], ...] = (
    lambda folder: SimulatedMeasuringHost(a_host(), folder / "onboard.json", simulate),
)
SETUP = EnvironmentSetup(
    members=("ears", "eyes"), interference="busy-loop", processors=2, memory=memory("512 MiB"), limit=100, weight=100
)
SHAPES = shapes_of_test_partitions(SETUP, 2, memory("256 MiB"))
EYES = a_component("eyes", simulation=a_simulation(work="4 ms", blocked="2 ms", varies="10 %"))
EARS = a_component("ears", run=a_run(every="20 ms"), simulation=a_simulation(work="1 ms", varies="10 %"))


@pytest.fixture(params=HOSTS)
def host(request: pytest.FixtureRequest, tmp_path: Path) -> MeasuringHost:
    made = request.param(tmp_path)
    assert isinstance(made, MeasuringHost)
    return made


@contextmanager
def ready(host: MeasuringHost, reserve: int = 60) -> Iterator[None]:
    with running_test_partitions(host, "robot", SHAPES):
        set_reserves(host, "robot", SHAPES, {P1: reserve, P2: 100 - reserve})
        yield


def some_work(*components: Component, seed: int = 7, **until: SampleCount | Elapsed) -> Work:
    return Work(
        application="robot",
        partitions=(PartitionWork(partition=P1, components=components), PartitionWork(partition=P2, load=BusyLoop())),
        until=until,
        seed=seed,
    )


def seen(host: MeasuringHost, work: Work) -> list[tuple[str, Sample]]:
    with host.run(work) as running:
        return list(running.samples())


def test_every_component_shows_its_samples_until_all_have_enough(host: MeasuringHost) -> None:
    work = some_work(EYES, EARS, eyes=SampleCount(samples=30), ears=SampleCount(samples=12))
    with ready(host):
        names = [name for name, _ in seen(host, work)]

    assert names.count("eyes") >= 30
    assert names.count("ears") >= 12
    assert names.count("eyes") == 30 or names.count("ears") == 12


def test_samples_come_in_the_order_in_which_jobs_end(host: MeasuringHost) -> None:
    with ready(host):
        samples = [sample for _, sample in seen(host, some_work(EYES, EARS, eyes=SampleCount(samples=30)))]

    ends = [sample.began_ms + (sample.response_ms or 0) for sample in samples]
    assert ends == sorted(ends)
    assert all(sample.successful and not sample.failure for sample in samples)


def test_a_time_is_run_to_its_end_and_clock_and_consumption_only_grow(host: MeasuringHost) -> None:
    clock, consumed = [0.0], [0.0]
    with ready(host), host.run(some_work(EYES, eyes=Elapsed(time=milliseconds("500 ms")))) as running:
        for name, _ in running.samples():
            clock.append(running.elapsed_ms())
            consumed.append(running.cpu_ms(name) or 0.0)

    assert clock == sorted(clock)
    assert clock[-1] >= 500
    assert consumed == sorted(consumed)
    assert 0 < consumed[-1] <= 2 * clock[-1]


def test_what_counts_begins_when_it_is_said_and_lasts_as_long_as_it_must(host: MeasuringHost) -> None:
    work = replace(some_work(EYES, eyes=SampleCount(samples=10)), least_ms=5 * host.scheduler_memory_ms)
    began = 0.0
    with ready(host), host.run(work) as running:
        for number, _ in enumerate(running.samples(), start=1):
            if number == 40:
                began = running.elapsed_ms()
                running.count_from_now()
        assert number >= 50
        assert running.elapsed_ms() >= began + 5 * host.scheduler_memory_ms > began > 0


def test_whoever_has_seen_enough_stops_asking(host: MeasuringHost) -> None:
    with ready(host):
        with host.run(some_work(EYES, eyes=SampleCount(samples=10_000))) as running:
            first = list(islice(running.samples(), 5))
        with host.run(some_work(EYES, eyes=SampleCount(samples=5))) as running:
            again = list(running.samples())

    assert len(first) == len(again) == 5


def test_more_reserve_is_never_slower(host: MeasuringHost) -> None:
    means = []
    for reserve in (10, 40, 90):
        with ready(host, reserve):
            samples = [
                sample.response_ms or 0.0 for _, sample in seen(host, some_work(EYES, eyes=SampleCount(samples=60)))
            ]
        means.append(sum(samples) / len(samples))

    assert means[0] > 1.3 * means[1]
    assert means[1] >= means[2]


@pytest.mark.parametrize(("reserve", "threads"), [(10, 1), (10, 2), (60, 1), (60, 2)])
def test_whoever_asks_for_more_in_p1_gets_exactly_cr_on_each_processor_that_it_uses(
    host: MeasuringHost, reserve: int, threads: int
) -> None:
    greedy = a_component("eyes", simulation=a_simulation(work="4 ms", threads=threads))
    with ready(host, reserve), host.run(some_work(greedy, eyes=Elapsed(time=milliseconds("10000 ms")))) as running:
        assert list(running.samples())
        shares = (running.cpu_ms("eyes") or 0.0) / running.elapsed_ms() / threads

    assert shares == pytest.approx(reserve / 100, rel=0.04)


def test_the_bench_says_what_it_is(host: MeasuringHost) -> None:
    bench = host.bench()

    assert bench.logical_processors == host.observe().facts.logical_processors
    assert bench.processor
    assert bench == host.bench()


def test_what_does_not_run_cannot_be_worked_in(host: MeasuringHost) -> None:
    with pytest.raises(HostRefused), host.run(some_work(EYES, eyes=SampleCount(samples=2))):
        raise AssertionError("there is no P1")


def test_the_same_work_with_the_same_seed_shows_the_same_samples_on_a_simulated_host(tmp_path: Path) -> None:
    def run(seed: int) -> list[tuple[str, Sample]]:
        host = SimulatedMeasuringHost(a_host(), tmp_path / "onboard.json", simulate)
        with ready(host):
            return seen(host, some_work(EYES, EARS, seed=seed, eyes=SampleCount(samples=20)))

    first = run(7)

    assert run(7) == first, "also in partitions that were made anew"
    assert run(8) != first


def test_a_simulated_component_needs_a_demand(tmp_path: Path) -> None:
    host = SimulatedMeasuringHost(a_host(), tmp_path / "onboard.json", simulate)
    work = some_work(a_component("nobody", simulation=None), nobody=SampleCount(samples=2))
    with ready(host), pytest.raises(HostRefused, match="does not say what it demands"), host.run(work):
        raise AssertionError("it has no demand")


def test_a_simulated_job_that_takes_longer_than_its_timeout_is_a_failed_sample(tmp_path: Path) -> None:
    slow = a_component("slow", run=a_run(timeout="10 ms"), simulation=a_simulation(work="50 ms"))
    host = SimulatedMeasuringHost(a_host(), tmp_path / "onboard.json", simulate)
    with ready(host):
        ((name, sample),) = seen(host, some_work(slow, slow=SampleCount(samples=1)))

    assert name == "slow"
    assert (sample.response_ms, sample.successful, sample.failure) == (None, False, "no answer within 10 ms")
