"""Instances of combining, the best that there is by looking at all layouts, and what the simple ways take."""

import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from math import ceil, floor, inf

from rarms_iac.model.system import Minimise
from rarms_iac.planner.combining.layouts import Objective
from rarms_iac.planner.combining.oracle import Coi, Members, total
from rarms_iac.planner.prediction.belief import at_least
from rarms_iac.planner.prediction.members import NOTHING, Alone, Predictor, predictor_of, task_of
from rarms_iac.planner.prediction.periodic import MemberDemand, demand_of
from rarms_iac.providers.simulated.scheduling.machine import BusyLoops, JobDemand, ModelMachine, VirtualMachine
from rarms_iac.providers.simulated.scheduling.simulation import simulate

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
        mine = [tasks[member] for member in which]
        rate = sum(work / period for work, period, _ in mine)
        for at in sorted({deadline + k * period for _, period, deadline in mine for k in range(800 // period)}):
            demand = sum((floor((at - d) / p) + 1) * w for w, p, d in mine if at >= d)
            rate = max(rate, demand / at)
        return min(NEVER, ceil(round(100 * rate, 9)))

    alone = {}
    for at, (work, period, deadline) in enumerate(tasks):
        seen = work * chance.uniform(0.95, 1.05)
        demand = MemberDemand(waits_ms=0.0, work_ms=seen, enough=need((at,)), period_ms=period)
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
        found = [loops[member][1] + loops[member][0] / share for member in which]
        for _ in range(40):
            busy = [1 - loops[member][1] / seen for member, seen in zip(which, found, strict=True)]
            found = [
                loops[member][1] + loops[member][0] / share * (1 + sum(busy) - busy[at])
                for at, member in enumerate(which)
            ]
        return all(seen <= loops[member][2] * (1 + 1e-9) for member, seen in zip(which, found, strict=True))

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
        mine = [alone[member] for member in which]
        if len(which) == 1:
            return mine[0]
        least = max(mine) if len(which) == 2 else max(map(need, combinations(which, 2)))
        return min(NEVER, least + int(1.2 * share[which] * min(mine)))

    return Drawn(need=need, alone={})


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
        return drawn.need(tuple(sorted(chosen[member] for member in which)))

    alone = {at: drawn.alone[member] for at, member in enumerate(chosen)}
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
        return _means(
            tuple(demands[member] for member in which), lps, reserve, 4 * JOBS * max(wanted[member] for member in which)
        )

    def meets(which: tuple[int, ...], reserve: int) -> bool:
        return all(seen <= wanted[member] for member, seen in zip(which, means(which, reserve), strict=True))

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


MODELS = {"edf": edf, "fair": fair, "mixing": mixing, "host": host}


@dataclass(frozen=True, slots=True, kw_only=True)
class Instance:
    """Components with what each needs, what compounds need, what there is, and what predicts."""

    model: str
    seed: int
    processors: int  # of every partition
    cois: tuple[Coi, ...]
    needs: Mapping[Members, int]  # of all compounds up to `largest`
    largest: int
    capacity: int
    predictor: Predictor

    @property
    def order(self) -> tuple[Coi, ...]:
        """The most critical first."""
        return tuple(sorted(self.cois, key=lambda coi: -coi.criticality))

    @property
    def breaks(self) -> bool:
        """Whether a compound needs less than a part of it, so that the assumption of the proof is wrong."""
        known = {**{coi.members: coi.reserve for coi in self.cois}, **self.needs}
        return any(
            least < at_least(known[part] * self.processors, self.processors)
            for names, least in self.needs.items()
            for part in combinations(names, len(names) - 1)
        )

    def worse(self, members: Members, reserve: int) -> frozenset[str]:
        """The truth, as a `PerformanceOracle`."""
        return frozenset() if reserve >= self.needs[members] else frozenset(members)

    def objective(self, minimise: Minimise) -> Objective:
        return Objective(
            capacity=self.capacity,
            fits=lambda layout: total(layout) <= self.capacity,
            minimise=minimise,
            criticalities={coi.name: coi.criticality for coi in self.cois},
        )


@cache
def instance(model: str, components: int, seed: int, largest: int = 2) -> Instance:
    """One that has something to tune: the sum is more than there is."""
    chance = random.Random(f"combining/{model}/{components}/{seed}")
    drawn = MODELS[model](chance, components)
    levels = chance.sample(range(1, 100), components)
    cois = tuple(
        Coi(
            name=f"c{at:02}",
            members=(f"c{at:02}",),
            criticality=levels[at],
            processors=drawn.processors,
            reserve=drawn.need((at,)),
        )
        for at in range(components)
    )
    needs = {
        tuple(cois[member].name for member in which): drawn.need(which)
        for size in range(2, largest + 1)
        for which in combinations(range(components), size)
    }
    alone = {cois[at].name: member for at, member in drawn.alone.items()}
    predictor = predictor_of(alone) if alone else NOTHING
    return Instance(
        model=model,
        seed=seed,
        processors=drawn.processors,
        cois=cois,
        needs=needs,
        largest=largest,
        capacity=max(1, int(total(cois) * chance.uniform(0.75, 0.97))),
        predictor=predictor,
    )


def walked(least: int) -> int:
    """Settings of the paper's walk: up to the first that passes, all ten where none does."""
    return min(10, ceil(least / 10))


@dataclass(frozen=True, slots=True, kw_only=True)
class Value:
    """What layouts are compared on."""

    shared: tuple[int, ...]  # criticalities of those who share, the highest first
    total: int

    def key(self, minimise: Minimise) -> tuple[object, object]:
        return (self.shared, self.total) if minimise is Minimise.COMBINING else (self.total, self.shared)


def best_value(case: Instance, needs: Mapping[Members, int], minimise: Minimise) -> Value | None:
    """The value of the best layout if compounds need so much, by looking at all of them; None: none fits."""
    order = case.order
    number = {coi.name: at for at, coi in enumerate(order)}
    gains: dict[int, list[tuple[int, int]]] = {}  # by the highest bit: compounds that save something
    for names, least in needs.items():
        saved = sum(order[number[name]].cost for name in names) - least * case.processors
        if saved > 0 and least < NEVER:
            mask = sum(1 << number[name] for name in names)
            gains.setdefault(mask.bit_length() - 1, []).append((mask, saved))

    @cache
    def most_saved(remaining: int) -> int:
        """The most that compounds of just these save; far below 0 where they cannot all be in one."""
        if not remaining:
            return 0
        blocks = [block for block in gains.get(remaining.bit_length() - 1, []) if block[0] & remaining == block[0]]
        return max((saved + most_saved(remaining ^ mask) for mask, saved in blocks), default=-NEVER * NEVER)

    values = []
    for subset in range(1 << len(order)):
        reserved = total(order) - most_saved(subset)
        if reserved <= case.capacity:
            shared = tuple(order[at].criticality for at in range(len(order)) if subset >> at & 1)
            values.append(Value(shared=shared, total=reserved))
    return min(values, key=lambda value: value.key(minimise), default=None)


def value_of(case: Instance, cois: Sequence[Coi]) -> Value:
    """The same of a layout that was found."""
    by_name = {coi.name: coi.criticality for coi in case.cois}
    shared = tuple(
        sorted((by_name[name] for coi in cois if len(coi.members) > 1 for name in coi.members), reverse=True)
    )
    return Value(shared=shared, total=total(cois))
