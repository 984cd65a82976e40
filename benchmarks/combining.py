"""Combining pairs: how many settings the default strategy asks for, beside measuring all pairs.

`python -m benchmarks.combining [INSTANCES] [LARGEST]` takes so many instances a model (36 unless said; the goals are
stated for 400 and more), spread evenly over n = 4 to LARGEST components (12), and a few of the simulated host itself.
Seeds are fixed. Pairs only, as the baselines: all pairs by the paper's walk (10, 20, ... %), and all pairs by
bisection of 1 to 100 %. What the components need alone is known to all of them. No noise: the oracle says the truth.

Not here: a prediction that guides the questions, noise, and the strategy with compounds of three.
"""

import random
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from math import ceil, floor
from statistics import median

from benchmarks.combining_host import needs
from benchmarks.timing import Figure, report
from rarms_iac.model.system import Minimise
from rarms_iac.planner.combining.layouts import Objective
from rarms_iac.planner.combining.paper import Asking, tune_performance_to_use_less_resource
from rarms_iac.planner.combining.questions import Best, search, tuning_of
from rarms_iac.planner.combining.values import Coi, Members, total

INSTANCES = 36
SMALLEST, LARGEST = 4, 12
NEVER = 101
HOST_LARGEST, HOST_SHARE = 6, 3  # of the simulated host itself: small ones, and one in three
GOALS = {"edf": 0.35, "fair": 0.45, "mixing": 0.35, "host": 0.35}

Need = Callable[[tuple[int, ...]], int]
"""What components, by number, need together: a CR, or NEVER."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Instance:
    """Components with what each needs, what each pair needs, and what there is."""

    model: str
    cois: tuple[Coi, ...]
    pairs: Mapping[Members, int]
    capacity: int

    def worse(self, members: Members, reserve: int) -> frozenset[str]:
        """The truth, as a `PerformanceOracle`; of more than two it is not asked."""
        return frozenset() if reserve >= self.pairs[members] else frozenset(members)


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """How it went on one instance."""

    model: str
    components: int
    asked: int
    walked: int
    halved: int
    optimal: bool
    proved: bool
    greedy: str  # of the paper, repeated over pairs: optimal, fits, or fails
    greedy_asked: int

    @property
    def of_the_walk(self) -> float:
        return self.asked / self.walked

    @property
    def of_halving(self) -> float:
        return self.asked / self.halved


def edf(chance: random.Random, components: int) -> Need:
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

    return need


def fair(chance: random.Random, components: int) -> Need:
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

    def need(which: tuple[int, ...]) -> int:
        low, high = 1, NEVER
        while low < high:
            middle = (low + high) // 2
            low, high = (low, middle) if meets(which, middle) else (middle + 1, high)
        return low

    return need


def mixing(chance: random.Random, components: int) -> Need:
    """Anything from what the needier needs to a fifth more than the sum, evenly."""
    alone = [chance.randint(8, 45) for _ in range(components)]
    share = {pair: chance.random() for pair in combinations(range(components), 2)}

    def need(which: tuple[int, ...]) -> int:
        mine = [alone[one] for one in which]
        if len(which) == 1:
            return mine[0]
        return min(NEVER, max(mine) + int(1.2 * share[which[0], which[1]] * min(mine)))

    return need


MODELS: Mapping[str, Callable[[random.Random, int], Need]] = {"edf": edf, "fair": fair, "mixing": mixing, "host": needs}


@cache
def instance(model: str, components: int, seed: int) -> Instance:
    """One that has something to tune: the sum is more than there is."""
    chance = random.Random(f"combining/{model}/{components}/{seed}")
    need = cache(MODELS[model](chance, components))
    levels = chance.sample(range(1, 100), components)
    cois = tuple(
        Coi(name=f"c{at:02}", members=(f"c{at:02}",), criticality=levels[at], processors=1, reserve=need((at,)))
        for at in range(components)
    )
    pairs: dict[Members, int] = {
        (cois[one].name, cois[other].name): need((one, other)) for one, other in combinations(range(components), 2)
    }
    capacity = max(1, int(total(cois) * chance.uniform(0.75, 0.97)))
    return Instance(model=model, cois=cois, pairs=pairs, capacity=capacity)


def walked(least: int) -> int:
    """Settings of the paper's walk: up to the first that passes, all ten where none does."""
    return min(10, ceil(least / 10))


def halved(least: int) -> int:
    """Settings of halving 1 to 100 %, and the answer that there is none."""
    low, high, settings = 1, NEVER, 0
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if least <= middle else (middle + 1, high)
        settings += 1
    return settings


def best_value(case: Instance, minimise: Minimise) -> object:
    """The value of the best layout of pairs, by looking at all of them; None: none fits."""
    order = sorted(case.cois, key=lambda one: -one.criticality)
    number = {one.name: at for at, one in enumerate(order)}
    gain = {
        tuple(sorted((number[one], number[other]))): order[number[one]].cost + order[number[other]].cost - least
        for (one, other), least in case.pairs.items()
        if least < NEVER
    }

    @cache
    def most_saved(left: int) -> int:
        """The most that pairs of just these save; far below 0 where they cannot all be paired."""
        if not left:
            return 0
        first = left.bit_length() - 1
        rest = left ^ (1 << first)
        found = -NEVER * NEVER
        for other in range(first):
            saved = gain.get((other, first), 0)
            if rest >> other & 1 and saved > 0:
                found = max(found, saved + most_saved(rest ^ (1 << other)))
        return found

    values = []
    for left in range(1 << len(order)):
        reserved = total(order) - most_saved(left)
        if reserved <= case.capacity:
            shared = tuple(order[at].criticality for at in range(len(order)) if left >> at & 1)
            values.append((shared, reserved) if minimise is Minimise.COMBINING else (reserved, shared))
    return min(values, default=None)


def value_of(case: Instance, cois: Sequence[Coi], minimise: Minimise) -> object:
    """The same of a layout that was found."""
    by_name = {one.name: one.criticality for one in case.cois}
    shared = tuple(
        sorted((by_name[name] for one in cois if len(one.members) > 1 for name in one.members), reverse=True)
    )
    return (shared, total(cois)) if minimise is Minimise.COMBINING else (total(cois), shared)


def result(case: Instance, minimise: Minimise) -> Result:
    """The default strategy on one instance, beside everything else."""
    objective = Objective(
        capacity=case.capacity,
        fits=lambda layout: total(layout) <= case.capacity,
        minimise=minimise,
        criticalities={one.name: one.criticality for one in case.cois},
    )
    tuning = tuning_of(case.cois, objective, lambda _members: True, largest=2)
    found, trail = search(tuning, Asking(oracle=case))
    best = best_value(case, minimise)
    reached = value_of(case, found.cois, minimise) if isinstance(found, Best) else None
    paper = _greedy(case)
    greedy = "fits" if total(paper[0]) <= case.capacity else "fails"
    return Result(
        model=case.model,
        components=len(case.cois),
        asked=len(trail),
        walked=sum(map(walked, case.pairs.values())),
        halved=sum(map(halved, case.pairs.values())),
        optimal=reached == best,
        proved=not found.breaks,
        greedy="optimal" if greedy == "fits" and value_of(case, paper[0], minimise) == best else greedy,
        greedy_asked=paper[1],
    )


def _greedy(case: Instance) -> tuple[tuple[Coi, ...], int]:
    """The paper's procedure until it fits; what is combined is not combined again, as only pairs are known."""
    cois, asked = case.cois, 0
    while total(cois) > case.capacity:
        free = tuple(one for one in cois if len(one.members) == 1)
        rest = total(cois) - total(free)
        done = tune_performance_to_use_less_resource(free, max(0, case.capacity - rest), Asking(oracle=case))
        asked += len(done.trail)
        if not done.combinations:
            break
        cois = (*done.cois, *(one for one in cois if len(one.members) > 1))
    return cois, asked


def main(words: Sequence[str]) -> int:
    instances = int(words[0]) if words else INSTANCES
    largest = int(words[1]) if len(words) > 1 else LARGEST
    sizes = range(SMALLEST, largest + 1)
    figures: list[Figure] = []
    for minimise in Minimise:
        for model in MODELS:
            most = HOST_LARGEST if model == "host" else largest
            share = HOST_SHARE if model == "host" else 1
            chosen = [size for size in sizes if size <= most]
            cases = [(size, seed) for seed in range(-(-instances // len(sizes) // share)) for size in chosen]
            done = [result(instance(model, size, seed), minimise) for size, seed in cases]
            figures += _figures(minimise, model, done)
    return report(figures)


def _figures(minimise: Minimise, model: str, done: Sequence[Result]) -> list[Figure]:
    ratios = [one.of_the_walk for one in done]
    few = [one for one in done if one.components == SMALLEST]
    print(
        f"{minimise.value} first, {model}: {len(done)} instances, "
        f"settings {sum(one.asked for one in done)} (all pairs by the walk {sum(one.walked for one in done)}, "
        f"by halving {sum(one.halved for one in done)}); of the walk: worst {max(ratios):.2f}; "
        f"of halving: median {median(one.of_halving for one in done):.2f}; "
        f"n = 4: median {median(one.of_the_walk for one in few):.2f} of the walk"
    )
    counted = {kind: sum(one.greedy == kind for one in done) for kind in ("optimal", "fits", "fails")}
    print(
        f"  the paper's greedy: {counted['optimal']} optimal, {counted['fits']} that fit otherwise or use another "
        f"reservation, {counted['fails']} that do not fit, in {sum(one.greedy_asked for one in done)} settings"
    )
    name = f"{minimise.value} first, {model}"
    missed = sum(not (one.optimal and one.proved) for one in done)
    return [
        Figure(name=f"{name}: median of the walk", value=median(ratios), at_most=GOALS[model]),
        Figure(name=f"{name}: not optimal or not proved", value=missed, unit="", at_most=0),
    ]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
