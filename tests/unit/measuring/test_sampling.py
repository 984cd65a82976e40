"""Starts: a load that never pauses begins anew at random moments, and where starts differ, they are the samples."""

from pathlib import Path

import pytest

from rarms_iac.measuring.strategies import Sweep
from rarms_iac.model.experiment import Experiment, experiment_of
from rarms_iac.model.outcomes import Sufficient
from rarms_iac.providers.simulated.scheduling.simulation import SchedulerSimulation
from rarms_iac.statistics.error_probability import PERIODIC_STARTS
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


def test_a_setting_of_a_search_has_thirty_starts_of_periodic_jobs_beside_a_load_that_never_pauses(
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
        assert series.elapsed_ms == pytest.approx(50.0 * len(series.samples), rel=0.1), "what settles is no time of it"
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
