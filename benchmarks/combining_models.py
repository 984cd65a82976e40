"""Models of what components need together, and what measuring each of them alone tells of it.

What is told of a component alone is not exact, as no measurement is: work is off by 5 % (earliest deadline first), and
each mean response time by 3 % (fair sharing). Random mixing tells nothing at all.
"""

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from math import ceil, floor

from rarms_iac.planner.prediction.members import Alone, task_of
from rarms_iac.planner.prediction.periodic import Demand, demand_of

NEVER = 101
CURVE = range(10, 101, 10)

Need = Callable[[tuple[int, ...]], int]
"""What components, by ascending number, need together: a CR, or NEVER."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn:
    """What components need, and what each alone shows, by number."""

    need: Need
    alone: Mapping[int, Alone]
    processors: int = 1


def halving(meets: Callable[[tuple[int, ...], int], bool]) -> Need:
    """The least CR of 1 to 100 % that is enough."""

    def need(which: tuple[int, ...]) -> int:
        low, high = 1, NEVER
        while low < high:
            middle = (low + high) // 2
            low, high = (low, middle) if meets(which, middle) else (middle + 1, high)
        return low

    return need


def edf(chance: random.Random, components: int) -> Drawn:
    """Sporadic tasks with deadlines, run by earliest deadline: the least rate above the demand bound."""
    tasks = []
    for _ in range(components):
        period = chance.choice((20, 25, 40, 50, 80, 100, 200))
        tasks.append((period * chance.uniform(0.06, 0.30), period, period * chance.uniform(0.4, 1.0)))

    def need(which: tuple[int, ...]) -> int:
        mine = [tasks[one] for one in which]
        rate = sum(work / period for work, period, _ in mine)
        for at in sorted({deadline + k * period for _, period, deadline in mine for k in range(800 // period)}):
            demand = sum((floor((at - d) / p) + 1) * w for w, p, d in mine if at >= d)
            rate = max(rate, demand / at)
        return min(NEVER, ceil(round(100 * rate, 9)))

    alone = {}
    for at, (work, period, deadline) in enumerate(tasks):
        seen = work * chance.uniform(0.95, 1.05)
        demand = Demand(waits_ms=0.0, work_ms=seen, enough=need((at,)), period_ms=period)
        alone[at] = Alone(demand=demand, task=task_of(seen, period, deadline), processors=1)
    return Drawn(need=need, alone=alone)


def fair(chance: random.Random, components: int) -> Drawn:
    """Closed loops that compute and then wait; who computes at once shares evenly, and each has a mean response."""
    loops = []
    for _ in range(components):
        work = chance.uniform(5, 40)
        waits = work * chance.choice((0.2, 0.5, 1.0, 2.0, 4.0))
        loops.append((work, waits, waits + work / chance.uniform(0.08, 0.45)))

    def meets(which: tuple[int, ...], reserve: int) -> bool:
        share = reserve / 100
        found = [loops[one][1] + loops[one][0] / share for one in which]
        for _ in range(40):
            busy = [1 - loops[one][1] / seen for one, seen in zip(which, found, strict=True)]
            found = [loops[one][1] + loops[one][0] / share * (1 + sum(busy) - busy[at]) for at, one in enumerate(which)]
        return all(seen <= loops[one][2] * (1 + 1e-9) for one, seen in zip(which, found, strict=True))

    need = halving(meets)
    alone = {}
    for at, (work, waits, _) in enumerate(loops):
        points = [(float(cr), (waits + 100 * work / cr) * chance.uniform(0.97, 1.03)) for cr in CURVE]
        demand = demand_of(points, need((at,)))
        assert demand is not None
        alone[at] = Alone(demand=demand, task=None, processors=1)
    return Drawn(need=need, alone=alone)


def mixing(chance: random.Random, components: int) -> Drawn:
    """Anything from what the needier needs to a fifth more than the sum, evenly; of three, from their neediest pair."""
    alone = [chance.randint(8, 45) for _ in range(components)]
    sets = [which for size in (2, 3) for which in combinations(range(components), size)]
    share = {which: chance.random() for which in sets}

    @cache
    def need(which: tuple[int, ...]) -> int:
        mine = [alone[one] for one in which]
        if len(which) == 1:
            return mine[0]
        least = max(mine) if len(which) == 2 else max(map(need, combinations(which, 2)))
        return min(NEVER, least + int(1.2 * share[which] * min(mine)))

    return Drawn(need=need, alone={})
