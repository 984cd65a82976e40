"""What `rarms measure` says of components that have no steady state where their search begins.

At some reservations each job takes a little longer than the one before, without an end.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac.manifest.text.positions import FirstLine
from rarms_iac.measuring.findings import findings_of
from rarms_iac.measuring.measure_request import ExperimentResult
from rarms_iac.measuring.performance import shortfall_at, why_unsteady
from rarms_iac.model.experiment import Experiment, experiment_of
from rarms_iac.model.outcomes import Missed, Sufficient, Unsteady
from rarms_iac.model.setting import Setting
from rarms_iac.providers.simulated.measuring import Simulate
from rarms_iac.providers.simulated.scheduling.machine import JobDone, ModelMachine
from rarms_iac.providers.simulated.scheduling.simulation import SchedulerSimulation
from tests.builders import a_component, a_run, a_simulation, a_system, at_most
from tests.fluid import fluid
from tests.unit.measuring.bench import Bench

GROWS = 0.001
"""The part by which a job takes longer than the one before."""
FIRST, NEAR = range(41, 50), range(47, 56)


def an_experiment(work: str, varies: str, limit: int) -> Experiment:
    component = a_component(
        "coi",
        apt={"mean_response_time": at_most(limit)},
        run=a_run(),
        simulation=a_simulation(work=work, varies=varies),
        reserve=None,
        processors=2,
    )
    system = a_system(components=[component])
    return experiment_of(system, system.hosts["onboard"], ("coi",), "busy-loop")


def growing(reserves: range) -> Simulate:
    """The fluid model, but for what is said above of these reservations of P1."""

    def simulate(machine: ModelMachine, seed: int) -> Iterator[JobDone]:
        [reserve] = [each.reserve for each in machine.machines if each.components]
        later = 0.0
        for number, job in enumerate(fluid(machine, seed)):
            longer = GROWS * number * job.response if reserve in reserves else 0.0
            yield replace(job, began=job.began + later, response=job.response + longer)
            later += longer

    return simulate


def searched(
    experiment: Experiment, folder: Path, silent: range = FIRST, scheduler: Simulate | None = None
) -> ExperimentResult:
    bench = Bench(folder, experiment)
    return bench.measure(bench.search("default"), simulate=scheduler or growing(silent))


def unsteady(settings: tuple[Setting, ...]) -> set[int]:
    return {setting.reserve for setting in settings if any(map(why_unsteady, setting.series))}


FAR_BELOW: Mapping[str, tuple[str, str, int, int]] = {
    "15 ms for 100 ms": ("15 ms", "10 %", 100, 15),
    "10 ms for 90 ms": ("10 ms", "10 %", 90, 12),
    "14 ms for 93 ms": ("14 ms", "5 %", 93, 15),
    "16 ms for 80 ms": ("16 ms", "5 %", 80, 20),
}
"""Work, how it varies, threshold in ms, and the CR that the work alone needs."""


@pytest.mark.parametrize("case", FAR_BELOW)
def test_first_setting_without_steady_state_costs_no_reservation(case: str, tmp_path: Path) -> None:
    work, varies, limit, needed = FAR_BELOW[case]
    experiment = an_experiment(work, varies, limit)
    ended = searched(experiment, tmp_path)

    assert unsteady(ended.settings) <= {45}
    assert isinstance(ended.conclusion, Sufficient)
    assert needed <= ended.conclusion.reserve <= needed + 2
    assert ended.conclusion.failed is not None
    assert ended.conclusion.reserve - ended.conclusion.failed <= 3
    assert not isinstance(shortfall_at(ended.conclusion.failed, ended.settings, experiment), Unsteady)
    assert ended.conclusion.inconclusive == ()
    assert len(ended.settings) <= 9
    found = findings_of(experiment, ended.conclusion, ended.settings, FirstLine(""))
    assert "RARMS267" not in {finding.code for finding in found}


def test_unsteady_neighbourhood_is_unknown(tmp_path: Path) -> None:
    experiment = an_experiment("15 ms", "10 %", 28)
    ended = searched(experiment, tmp_path, NEAR)
    end = ended.conclusion

    assert isinstance(end, Sufficient)
    assert end.inconclusive
    assert set(end.inconclusive) <= unsteady(ended.settings)
    assert end.failed not in unsteady(ended.settings)
    assert all((end.failed or 0) < level < end.reserve for level in end.inconclusive)
    found = findings_of(experiment, end, ended.settings, FirstLine(""))
    (told,) = [finding for finding in found if finding.code == "RARMS267"]
    assert f"coi: {end.reserve} % of its VPs is enough" in told.detail
    assert f"coi at {end.inconclusive[-1]} % of its VPs: its response times still changed within" in told.detail
    assert str(told.advice) == "Look for what grows in coi while it runs. Or leave it."


def test_first_quick_jobs_are_not_believed(tmp_path: Path) -> None:
    """40 samples of 3 ms are over before the load beside them has missed anything: 1 % seemed enough, for 303 ms."""
    experiment = an_experiment("3 ms", "0 %", 4)
    log = tmp_path / "settled"
    log.mkdir()
    ended = searched(experiment, log, scheduler=SchedulerSimulation)

    assert isinstance(ended.conclusion, Sufficient)
    assert ended.conclusion.reserve >= 35
    lower = [setting for setting in ended.settings if setting.reserve < 30]
    assert all(isinstance(shortfall_at(setting.reserve, ended.settings, experiment), Missed) for setting in lower)
