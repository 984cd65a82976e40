"""The simulated host as an oracle of what components need together: the same runs of its scheduler every time.

Each run is a simulation, so components come from a few pools whose pairs are worked out once: instances of one pool
share pairs, and are not independent. A third of the pools run on one logical processor, where pairs seldom save
anything, the others on two, where a pair now and then needs a point or two less than one of its two alone.
"""

import random
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from math import inf

from benchmarks.combining_models import CURVE, Drawn, Need, halving
from rarms_iac.planner.prediction.members import Alone
from rarms_iac.planner.prediction.periodic import demand_of
from rarms_iac.providers.simulated.scheduling.machine import BusyLoops, JobDemand, ModelMachine, VirtualMachine
from rarms_iac.providers.simulated.scheduling.simulation import simulate

POOLS = 12
IN_A_POOL = 14
JOBS = 30
WARM_UP = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Pool:
    """Components with what they need alone and by twos."""

    lps: int
    need: Need
    alone: Mapping[int, Alone]


def host(chance: random.Random, components: int) -> Drawn:
    """Some components of a pool."""
    number = chance.randrange(POOLS)
    chosen = chance.sample(range(IN_A_POOL), components)
    drawn = pool(number)

    def need(which: tuple[int, ...]) -> int:
        return drawn.need(tuple(sorted(chosen[one] for one in which)))

    alone = {at: drawn.alone[one] for at, one in enumerate(chosen)}
    return Drawn(need=need, alone=alone, processors=drawn.lps)


@cache
def pool(number: int) -> Pool:
    """The components of a pool: how they answer on average beside busy loops, with what they must."""
    chance, lps = random.Random(f"combining/pool/{number}"), 1 if number % 3 == 0 else 2
    demands, wanted = [], []
    for at in range(IN_A_POOL):
        work = chance.uniform(8, 30)
        waits = work * chance.choice((0.0, 0.3, 1.0, 2.0))
        demands.append(JobDemand(component=f"c{at:02}", work_ms=work, blocked_ms=waits, varies=5.0))
        wanted.append(waits + work / chance.uniform(0.15, 0.6))

    @cache
    def means(which: tuple[int, ...], reserve: int) -> tuple[float, ...]:
        return _means(tuple(demands[one] for one in which), lps, reserve, 4 * JOBS * max(wanted[one] for one in which))

    def meets(which: tuple[int, ...], reserve: int) -> bool:
        return all(seen <= wanted[one] for one, seen in zip(which, means(which, reserve), strict=True))

    need = cache(halving(meets))
    alone = {}
    for at in range(IN_A_POOL):
        points = [(float(cr), seen) for cr in CURVE if (seen := means((at,), cr)[0]) < inf]
        demand = demand_of(points, need((at,)))
        assert demand is not None, "a component that runs alone on all there is answers"
        alone[at] = Alone(demand=demand, task=None, processors=lps)
    return Pool(lps=lps, need=need, alone=alone)


def _means(demands: tuple[JobDemand, ...], lps: int, reserve: int, until_ms: float) -> tuple[float, ...]:
    """The mean response time (ms) of each; `inf`: it did not answer often enough.

    NOTE: of each the same jobs, whoever else runs: their work is drawn by component, so that company only adds to it.
    """
    machine = ModelMachine(
        lps=lps,
        machines=(
            VirtualMachine(name="p1", vps=lps, reserve=reserve, components=demands),
            VirtualMachine(name="p2", vps=lps, reserve=100 - reserve, loads=(BusyLoops(),)),
        ),
    )
    seen: dict[str, list[float]] = {demand.component: [] for demand in demands}
    for job in simulate(machine, seed=1, until_ms=until_ms):
        seen[job.component].append(job.response)
        if all(len(each) >= JOBS for each in seen.values()):
            break
    return tuple(_mean(seen[demand.component][WARM_UP:JOBS]) for demand in demands)


def _mean(late: list[float]) -> float:
    return sum(late) / len(late) if len(late) >= JOBS // 2 else inf
