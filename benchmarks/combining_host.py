"""The simulated host as an oracle of what components need together: the same runs of its scheduler every time."""

import random
from collections.abc import Callable
from functools import cache
from math import inf

from rarms_iac.providers.simulated.scheduling.simulation import simulate
from rarms_iac.providers.simulated.scheduling.values import BusyLoops, Demand, Machine, VirtualMachine

NEVER = 101
LPS = 2
JOBS = 40
WARM_UP = 5


def needs(chance: random.Random, components: int) -> Callable[[tuple[int, ...]], int]:
    """What each set of components needs beside busy loops: the least CR, by halving; NEVER where none is enough."""
    demands = []
    for at in range(components):
        work = chance.uniform(8, 30)
        waits = work * chance.choice((0.0, 0.3, 1.0, 2.0))
        demands.append(Demand(component=f"c{at}", work_ms=work, blocked_ms=waits, varies=5.0))
    wanted = tuple(
        one.blocked_ms + one.work_ms / chance.uniform(0.15, 0.6) for one in demands
    )  # mean response times, ms

    @cache
    def meets(which: tuple[int, ...], reserve: int) -> bool:
        machine = Machine(
            lps=LPS,
            machines=(
                VirtualMachine(name="p1", vps=LPS, reserve=reserve, components=tuple(demands[one] for one in which)),
                VirtualMachine(name="p2", vps=LPS, reserve=100 - reserve, loads=(BusyLoops(),)),
            ),
        )
        seen: dict[str, list[float]] = {demands[one].component: [] for one in which}
        slowest = max(wanted[one] for one in which)
        for job in simulate(machine, seed=1, until_ms=4 * JOBS * slowest):
            seen[job.component].append(job.response)
            if all(len(each) >= JOBS for each in seen.values()):
                break
        return all(_mean(seen[demands[one].component]) <= wanted[one] for one in which)

    def need(which: tuple[int, ...]) -> int:
        low, high = 1, NEVER
        while low < high:
            middle = (low + high) // 2
            low, high = (low, middle) if meets(which, middle) else (middle + 1, high)
        return low

    return need


def _mean(responses: list[float]) -> float:
    late = responses[WARM_UP:]
    return sum(late) / len(late) if late else inf
