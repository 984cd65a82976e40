"""How far the answers of one component lie apart over twelve seeds: 0.5 ms of work and 40 ms of waiting, a flat curve.

`python -m laboratory.benchmarks.spread` measures it by the default strategy beside a busy loop on the simulated one.
"""

import sys
import tempfile
from pathlib import Path
from typing import cast

from laboratory.benchmarks.measuring import Recorded
from laboratory.benchmarks.timing import Figure, report
from rarms_iac.measuring.loop import measure_settings
from rarms_iac.measuring.methods import Search, strategy_of
from rarms_iac.measuring.partitions import host_resources
from rarms_iac.measuring.reporter import MeasuringReporter
from rarms_iac.measuring.setting_run import MeasuringContext
from rarms_iac.measuring.settings_log import SettingsLog
from rarms_iac.measuring.setup import experiment_of
from rarms_iac.measuring.strategies import goal_of
from rarms_iac.model.outcomes import Sufficient
from rarms_iac.providers.simulated.measuring import SimulatedMeasuringHost
from rarms_iac.providers.simulated.scheduling.simulation import simulate
from tests.builders import a_component, a_host, a_run, a_simulation, a_system, at_most

SEEDS = range(1, 13)
MOST_APART = 3
THRESHOLDS = {"p90_response_time": 65, "mean_response_time": 45}  # ms; the mean truly takes 40.5


def answer(index: str, seed: int) -> int | None:
    """The reservation found with a seed, in per cent; None: there is no answer."""
    apt = {index: at_most(THRESHOLDS[index])}
    component = a_component(
        "coi", apt=apt, run=a_run(), processors=1, simulation=a_simulation(work="0.5 ms", blocked="40 ms")
    )
    system = a_system(components=[component])
    experiment = experiment_of(system, system.hosts["onboard"], ("coi",), "busy-loop")
    with tempfile.TemporaryDirectory() as folder:
        host = SimulatedMeasuringHost(a_host(), Path(folder) / "host.json", simulate)
        with host.lock("benchmark"):
            context = MeasuringContext(
                host=host,
                resources=lambda: host_resources(a_host(), host.observe(), "robot"),
                seed=seed,
                reporter=MeasuringReporter(),
                should_stop=lambda: False,
            )
            strategy = strategy_of(Search(), goal_of(experiment), 100)
            ended = measure_settings(experiment, strategy, cast("SettingsLog", Recorded()), context)
    return ended.conclusion.reserve if isinstance(ended.conclusion, Sufficient) else None


def figures() -> list[Figure]:
    """The answers' spread for each threshold, with the answers."""
    rows: list[Figure] = []
    for index in THRESHOLDS:
        found = [answer(index, seed) for seed in SEEDS]
        reserves = [reserve for reserve in found if reserve is not None]
        name = f"{index}: {' '.join('none' if each is None else str(each) for each in found)}"
        rows += [
            Figure(name=f"{name}; apart", value=max(reserves) - min(reserves), unit="points", at_most=MOST_APART),
            Figure(name="  without an answer", value=found.count(None), unit="", at_most=0),
        ]
    return rows


if __name__ == "__main__":
    sys.exit(report(figures()))
