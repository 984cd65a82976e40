"""When samples count: the host has settled, and the load has begun often enough."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from rarms_iac.measuring.sampling import PATIENCE_FACTOR, Contender, Settling, wants_all_processors
from rarms_iac.measuring.strategies import Sweep
from rarms_iac.model.experiment import Experiment, experiment_of
from rarms_iac.model.loads import LOADS_WITHOUT_ENTRY, Browser, BusyLoop, Interference
from rarms_iac.model.outcomes import Sufficient
from rarms_iac.model.series import Sample
from rarms_iac.providers.simulated.scheduling.simulation import SchedulerSimulation
from rarms_iac.statistics.distributions import PERIODIC_STARTS
from rarms_iac.statistics.steady_state import MEMORY_FACTOR
from tests.builders import a_component, a_run, a_simulation, a_system, at_most
from tests.unit.measuring.bench import Bench


def an_experiment(load: str) -> Experiment:
    component = a_component(
        "coi",
        apt={"mean_response_time": at_most(60)},
        run=a_run(every="50 ms"),
        simulation=a_simulation(work="10 ms", varies="5 %"),
        reserve=None,
        processors=2,
    )
    system = a_system(components=[component])
    return experiment_of(system, system.hosts["onboard"], ("coi",), load)


def test_search_setting_has_thirty_load_starts(
    tmp_path: Path,
) -> None:
    bench = Bench(tmp_path, an_experiment("busy-loop"))
    ended = bench.measure(bench.search("default"), simulate=SchedulerSimulation)

    assert isinstance(ended.conclusion, Sufficient)
    for setting in bench.book.known.settings:
        (series,) = setting.series
        assert len(series.starts) >= PERIODIC_STARTS - 1
        assert list(series.starts) == sorted(set(series.starts))
        assert 0 < series.starts[0] < series.starts[-1] < len(series.samples)
        assert max(sample.began_ms for sample in series.samples) < series.elapsed_ms
        assert series.elapsed_ms == pytest.approx(50.0 * len(series.samples), rel=0.1), (
            "the time to settle is not part of it"
        )
        assert setting.host_ms > series.elapsed_ms + 3000


@pytest.mark.parametrize("load", ["busy-loop", "bursts-20"])
def test_a_sweep_starts_its_load_once(tmp_path: Path, load: str) -> None:
    bench = Bench(tmp_path, an_experiment(load))
    ended = bench.measure(Sweep(reserves=(60,)), simulate=SchedulerSimulation)

    assert [series.starts for setting in ended.settings for series in setting.series] == [()]


def test_bursts_draw_their_gaps_and_start_once(tmp_path: Path) -> None:
    bench = Bench(tmp_path, an_experiment("bursts-20"))
    ended = bench.measure(bench.search("default"), simulate=SchedulerSimulation)

    assert {series.starts for setting in ended.settings for series in setting.series} == {()}


LEAST = 100.0 * MEMORY_FACTOR
P1 = Contender(components=("quick",), processors=0.5, excess_forbids_verdict=True)


@dataclass
class Running:
    """Work whose consumption is set by hand."""

    now: float = 0.0
    consumed: dict[str, float] = field(default_factory=dict)

    def used_processors(self, partition: str) -> None:
        """Not seen."""

    def restart_load(self) -> bool:
        return False

    def elapsed_ms(self) -> float:
        return self.now

    def cpu_ms(self, component: str) -> float | None:
        return self.consumed.get(component)

    def samples(self) -> Iterator[tuple[str, Sample]]:
        return iter(())

    def count_from_now(self) -> None:
        """Not asked for."""

    def evidence(self) -> None:
        """It counts nothing."""


def going_on(settling: Settling, running: Running, until: float, processors: float) -> None:
    """Jobs of 10 ms, consuming so much meanwhile."""
    while running.now < until:
        running.now += 10.0
        running.consumed["quick"] = running.consumed.get("quick", 0.0) + 10.0 * processors
        settling.record_job(running, "quick")


def test_scheduler_memory_passes_for_quick_jobs() -> None:
    settling, running = Settling(scheduler_window_ms=100.0, contenders=(P1,)), Running()
    going_on(settling, running, LEAST - 10.0, 0.4)

    assert not settling.is_over(running.now)
    going_on(settling, running, LEAST, 0.4)
    assert settling.is_over(running.now)
    assert settling.excess_message() == ""


def test_unearned_surplus_is_waited_for() -> None:
    settling, running = Settling(scheduler_window_ms=100.0, contenders=(P1,)), Running()
    going_on(settling, running, 2 * LEAST, 1.0)

    assert not settling.is_over(running.now)
    going_on(settling, running, 2.5 * LEAST, 0.5)
    assert not settling.is_over(running.now), "half of the last while is from before"
    going_on(settling, running, 3 * LEAST + 10.0, 0.5)
    assert settling.is_over(running.now)
    assert settling.excess_message() == ""


@pytest.mark.parametrize("excess_forbids_verdict", [True, False])
def test_lasting_surplus_ends_without_verdict(excess_forbids_verdict: bool) -> None:
    contender = Contender(components=("quick",), processors=0.5, excess_forbids_verdict=excess_forbids_verdict)
    settling, running = Settling(scheduler_window_ms=100.0, contenders=(contender,)), Running()
    going_on(settling, running, (PATIENCE_FACTOR + 1) * LEAST, 0.8)

    assert settling.is_over(running.now)
    assert ("quick still consumed 0.8 LP with 0.5 LP reserved" in settling.excess_message()) is excess_forbids_verdict


def test_job_that_takes_longer_is_looked_at_whole() -> None:
    settling, running = Settling(scheduler_window_ms=100.0, contenders=(P1,)), Running()
    for now, consumed in ((500.0, 500.0), (500.0 + 4 * LEAST, 500.0 + 2 * LEAST)):
        running.now, running.consumed["quick"] = now, consumed
        settling.record_job(running, "quick")
        assert settling.is_over(running.now) is (now > LEAST)


def test_long_jobs_are_not_waited_for_endlessly() -> None:
    settling, running = Settling(scheduler_window_ms=100.0, contenders=(P1,)), Running()
    for number in range(1, PATIENCE_FACTOR + 2):
        running.now, running.consumed["quick"] = number * 1.5 * LEAST, number * 1.5 * LEAST
        settling.record_job(running, "quick")
        assert settling.is_over(running.now) is (running.now > PATIENCE_FACTOR * LEAST)

    assert "still consumed 1 LP" in settling.excess_message()


def test_where_consumption_cannot_be_told_time_decides() -> None:
    settling, running = Settling(scheduler_window_ms=100.0, contenders=(P1,)), Running(now=LEAST)
    settling.record_job(running, "quick")

    assert settling.is_over(running.now)


@pytest.mark.parametrize(
    ("load", "contends"),
    [
        (BusyLoop(), True),
        (BusyLoop(threads=2), True),
        (BusyLoop(threads=1), False),
        (Browser(instances=9), False),
        (LOADS_WITHOUT_ENTRY["bursts-100"], False),
    ],
)
def test_only_load_that_wants_all_makes_consumption_witness(load: Interference, contends: bool) -> None:
    assert wants_all_processors(load, 2) is contends
    assert not wants_all_processors(None, 2)
