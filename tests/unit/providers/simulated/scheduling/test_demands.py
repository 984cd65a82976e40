"""From the manifest's words to the model's demands."""

import pytest

from rarms_iac.model.loads import LOADS_WITHOUT_ENTRY, Browser, BusyLoop, CommandLoad
from rarms_iac.providers.simulated.measuring import demand_of, model_load
from rarms_iac.providers.simulated.scheduling.machine import BurstLoads, JobDemand
from tests.builders import a_component, a_run, a_simulation


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
