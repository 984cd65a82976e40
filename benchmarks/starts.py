"""What settles after a load begins anew, by windows; and how often bounds over starts that lock a phase are wrong.

`python -m benchmarks.starts [COMPONENTS]`: random components beside busy loops on the model, whose loads
begin anew every 3 s. A window's figure is how far its mean response time lies from that of the windows from the
twentieth on, over all components.
"""

import random
import sys
from collections import defaultdict
from collections.abc import Sequence
from statistics import fmean

from benchmarks.timing import Figure, report
from benchmarks.verdicts import series_of
from rarms_iac.model.loads import BusyLoop
from rarms_iac.model.outcomes import Met
from rarms_iac.model.series import Series
from rarms_iac.model.system import Threshold
from rarms_iac.providers.simulated.scheduling.machine import WINDOW_MS, JobDemand, ModelMachine, VirtualMachine
from rarms_iac.providers.simulated.scheduling.simulation import SchedulerSimulation
from rarms_iac.statistics.error_probability import ERROR, PERIODIC_STARTS
from rarms_iac.statistics.setting_time import RESTART_WINDOWS
from rarms_iac.statistics.verdicts import judge_look
from tests.builders import a_run, at_most

COMPONENTS = 40
SETTLED_BY = 20
"""Windows after which nothing of a start is left."""

BETWEEN = 30 * WINDOW_MS
RESTARTS = 100
RUN = a_run(every="10 ms", timeout="1 min")
PHASES = (5.05, 5.05, 5.05, 5.05, 5.05, 5.05, 5.6, 6.13)
"""Mean response times in ms by the phase that a component locks into for a start: six of eight are alike."""


def away_by_window(seed: int) -> dict[int, float]:
    """How far each window after a start lies from what is settled, as a part of it."""
    chance = random.Random(f"starts/{seed}")
    work, reserve = 10 ** chance.uniform(-0.3, 0.7), chance.choice((10, 30, 50, 70))
    period = work * 100 / reserve * chance.uniform(1.3, 3.0)
    demand = JobDemand(
        component="coi",
        work_ms=work,
        blocked_ms=chance.choice((0.0, work)),
        varies=5.0,
        period_ms=period if seed % 2 else None,
    )
    p1 = VirtualMachine(name="P1", vps=1, reserve=reserve, components=(demand,))
    beside = chance.choice((100 - reserve, 100 - reserve / 2))  # the most on Hyper-V, and all that P1 leaves
    p2 = VirtualMachine(name="P2", vps=2, reserve=beside, weight=10_000, loads=(BusyLoop(),))
    machine = SchedulerSimulation(ModelMachine(lps=2, machines=(p1, p2), interrupts=1.0), seed)
    windows: dict[int, list[float]] = defaultdict(list)
    now, began, starts = 0.0, 0.0, 0
    for job in machine:
        now = max(now, job.began + job.response)
        if now >= 2 * BETWEEN and now - began > BETWEEN:
            starts += 1
            if starts > RESTARTS:
                break
            machine.restart_loads()
            began = now
        elif starts:
            windows[int((now - began) // WINDOW_MS)].append(job.response)
    settled = fmean(response for window, seen in windows.items() if window >= SETTLED_BY for response in seen)
    return {window: fmean(seen) / settled - 1.0 for window, seen in windows.items() if window < SETTLED_BY}


def locked(seed: int, starts: int, jobs: int) -> Series:
    """Return a component that locks into one phase of its load for each start."""
    chance = random.Random(f"locked/{seed}")
    times = [level * chance.uniform(0.999, 1.001) for _ in range(starts) for level in [chance.choice(PHASES)] * jobs]
    series = series_of(times)
    return Series(
        component=series.component,
        samples=series.samples,
        elapsed_ms=series.elapsed_ms,
        starts=tuple(jobs * number for number in range(1, starts)),
    )


def wrongly_met(apt: dict[str, Threshold], count: int, counts: Sequence[int]) -> int:
    """Of so many components just on the wrong side: which are said to meet it with any of these numbers of starts."""
    return sum(
        any(isinstance(judge_look(locked(seed, starts, 25), apt, RUN), Met) for starts in counts)
        for seed in range(count)
    )


def figures(count: int) -> list[Figure]:
    """By window, and the share of wrong verdicts."""
    by_window: dict[int, list[float]] = defaultdict(list)
    for seed in range(count):
        for window, away in away_by_window(seed).items():
            by_window[window].append(away)
    rows = [
        Figure(
            name=f"window {window} after a start: away from what is settled",
            value=100 * abs(fmean(by_window[window])),
            unit="%",
            at_most=8 if window >= RESTART_WINDOWS else None,
        )
        for window in sorted(by_window)
    ]
    mean = fmean(PHASES) * 0.999
    apt: dict[str, Threshold] = {"mean_response_time": at_most(f"{mean:.4f}")}
    wrong = wrongly_met(apt, 10 * count, (PERIODIC_STARTS, 64, 128, 400))
    return [
        *rows,
        Figure(name="phases that lock, just on the wrong side: met", value=10 * wrong / count, unit="%", at_most=1),
        Figure(name="  declared", value=100 * ERROR, unit="%"),
    ]


if __name__ == "__main__":
    sys.exit(report(figures(int(sys.argv[1]) if len(sys.argv) > 1 else COMPONENTS)))
