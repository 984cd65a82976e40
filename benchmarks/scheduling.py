"""How much faster than real time the simulated scheduler runs the paper's experiments, on one core.

The clock is the process's own processor time, so that other work on the machine does not count.
"""

import sys
import time
from itertools import islice

from benchmarks.timing import Figure, report
from rarms_iac.providers.simulated.scheduling.machine import BusyLoops, ModelMachine
from rarms_iac.providers.simulated.scheduling.simulation import simulate
from scripts.paper_experiments import FDP, PAIRS, RESERVES, bench, demands, playing

JOBS = 150
UNIT = "ms a simulated second"
EXPERIMENT_1 = 200.0
TEN_BROWSERS = 20.0


def cost(machine: ModelMachine) -> float:
    """Milliseconds of processor time for a second of simulated time."""
    simulation = simulate(machine, 1)
    begun = time.process_time()
    *_, last = islice(simulation, JOBS)
    return (time.process_time() - begun) * 1e6 / (last.began + last.response)


def figures() -> list[Figure]:
    fdp = demands()[FDP]
    slowest = max(cost(bench(fdp, (cr, 100 - cr), BusyLoops())) for cr in RESERVES)
    ten = max(cost(bench(fdp, pair, playing(10))) for pair in PAIRS)
    return [
        Figure(name="Experiment 1, slowest reserve", value=slowest, unit=UNIT, at_most=1000 / EXPERIMENT_1),
        Figure(name="  times real time", value=1000 / slowest),
        Figure(name="ten browsers, slowest pair", value=ten, unit=UNIT, at_most=1000 / TEN_BROWSERS),
        Figure(name="  times real time", value=1000 / ten),
    ]


if __name__ == "__main__":
    sys.exit(report(figures()))
