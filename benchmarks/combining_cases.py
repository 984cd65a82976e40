"""Instances of combining, the best that there is by looking at all layouts, and what the simple ways take."""

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from math import ceil

from benchmarks.combining_host import host
from benchmarks.combining_models import NEVER, edf, fair, mixing
from rarms_iac.model.system import Minimise
from rarms_iac.planner.combining.layouts import Objective
from rarms_iac.planner.combining.oracle import Coi, Members, total
from rarms_iac.planner.prediction.belief import at_least
from rarms_iac.planner.prediction.members import NOTHING, Predictor, predictor_of

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
        tuple(cois[one].name for one in which): drawn.need(which)
        for size in range(2, largest + 1)
        for which in combinations(range(components), size)
    }
    alone = {cois[at].name: one for at, one in drawn.alone.items()}
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


def halved(least: int) -> int:
    """Settings of halving 1 to 100 %, and the answer that there is none."""
    low, high, settings = 1, NEVER, 0
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if least <= middle else (middle + 1, high)
        settings += 1
    return settings


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
    def most_saved(left: int) -> int:
        """The most that compounds of just these save; far below 0 where they cannot all be in one."""
        if not left:
            return 0
        blocks = [one for one in gains.get(left.bit_length() - 1, []) if one[0] & left == one[0]]
        return max((saved + most_saved(left ^ mask) for mask, saved in blocks), default=-NEVER * NEVER)

    values = []
    for left in range(1 << len(order)):
        reserved = total(order) - most_saved(left)
        if reserved <= case.capacity:
            shared = tuple(order[at].criticality for at in range(len(order)) if left >> at & 1)
            values.append(Value(shared=shared, total=reserved))
    return min(values, key=lambda value: value.key(minimise), default=None)


def value_of(case: Instance, cois: Sequence[Coi]) -> Value:
    """The same of a layout that was found."""
    by_name = {coi.name: coi.criticality for coi in case.cois}
    shared = tuple(
        sorted((by_name[name] for coi in cois if len(coi.members) > 1 for name in coi.members), reverse=True)
    )
    return Value(shared=shared, total=total(cois))
