"""Combining: how many settings the default strategy asks for, beside measuring all pairs, and how often it is right.

`python -m benchmarks.combining [INSTANCES] [MODEL ...]` takes so many instances a model (36 unless said; the goals are
stated for 400 and more), spread evenly over n = 4 to 12 components. Seeds are fixed. Pairs only, beside all pairs by
the paper's walk (10, 20, ... %). What each component needs alone is known to both. Models: `combining_cases`. Each
instance is combined in all of `WAYS`, then half as many, of 4 to 8 components, with compounds of three, then each with
the reservation first. What is done is printed as it goes.

Where a model makes a pair need less than the proof assumes, its instances are counted apart, with those of them in
which an answer showed it.
"""

import os
import random
import sys
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import groupby
from statistics import NormalDist, median

from benchmarks.combining_cases import MODELS, NEVER, Instance, Value, best_value, instance, value_of, walked
from benchmarks.timing import Figure, report, table
from rarms_iac.model.system import Minimise
from rarms_iac.planner.combining.oracle import Members, PerformanceOracle
from rarms_iac.planner.combining.paper import Inquiry
from rarms_iac.planner.combining.questions import Best, Tuning, search, tuning_of
from rarms_iac.planner.prediction.members import NOTHING

REPEATS = 3
NOISE = 0.5  # per cent of CR: the spread of the reservation at which a repeat just meets all thresholds


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """How to go about it."""

    minimise: Minimise = Minimise.COMBINING
    predicts: bool = False
    noisy: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """How it went."""

    components: int
    asked: int  # settings, all repeats counted
    walked: int
    fits: bool
    optimal: bool
    contradicted: bool  # an answer contradicted the assumption
    breaks: bool  # the assumption is wrong there, seen or not
    near: bool = True  # who shares in the best does, and the total is within 1 point a compound
    near_the_truth: bool = True  # the same without any noise
    held: int = 0  # reservations of compounds that were said to hold
    wrong: int = 0  # of these, that do not

    @property
    def of_the_walk(self) -> float:
        return self.asked / self.walked


@dataclass(slots=True, kw_only=True)
class Repeating:
    """An oracle that runs each setting several times: it passes when all repeats do, and ends at the first that fails.

    A repeat passes beyond a reservation that varies about half a point below the least whole one that is enough.
    """

    case: Instance
    runs: int = 0
    _known: dict[tuple[Members, int], int] = field(default_factory=dict)  # repeats up to the first failure, or 0

    def worse(self, members: Members, reserve: int) -> frozenset[str]:
        self.runs += self.repeats(members, reserve)
        return frozenset() if self.passes(members, reserve) else frozenset(members)

    def passes(self, members: Members, reserve: int) -> bool:
        self.repeats(members, reserve)
        return self._known[members, reserve] == 0

    def repeats(self, members: Members, reserve: int) -> int:
        if (members, reserve) not in self._known:
            chance = random.Random(f"{self.case.model}/{self.case.seed}/{members}/{reserve}")
            enough = NormalDist(self.case.needs[members] - 0.5, NOISE).cdf(reserve)
            failed = [at for at in range(1, REPEATS + 1) if chance.random() >= enough]
            self._known[members, reserve] = failed[0] if failed else 0
        return self._known[members, reserve] or REPEATS

    def least(self, members: Members) -> int:
        """The least reservation that passes all repeats."""
        near = max(1, self.case.needs[members] - 8)
        return next((reserve for reserve in range(near, NEVER) if self.passes(members, reserve)), NEVER)


def run(case: Instance, way: Way) -> Result:
    """The default strategy on one instance."""
    oracle = Repeating(case=case) if way.noisy else None
    tuning = replace(
        tuning_of(case.cois, case.objective(way.minimise), lambda _members: True, largest=case.largest),
        predictor=case.predictor if way.predicts else NOTHING,
    )
    asking: PerformanceOracle = case if oracle is None else oracle
    found, trail = search(tuning, Inquiry(oracle=asking))
    needs = case.needs if oracle is None else {names: oracle.least(names) for names in case.needs}
    best = best_value(case, needs, way.minimise)
    truly = best if oracle is None else best_value(case, case.needs, way.minimise)
    reached = value_of(case, found.cois) if isinstance(found, Best) else None
    compounds = [coi for coi in found.cois if len(coi.members) > 1] if isinstance(found, Best) else []
    possible = [names for names, coi in _candidates(tuning).items()]
    return Result(
        components=len(case.cois),
        asked=len(trail) if oracle is None else oracle.runs,
        walked=sum(_walked(case, names, oracle) for names in (case.needs if case.largest == 2 else possible)),
        fits=best is not None,
        optimal=reached == best,
        contradicted=bool(found.contradictions),
        breaks=case.breaks,
        near=_near(reached, best, len(compounds) * case.processors),
        near_the_truth=_near(reached, truly, len(compounds) * case.processors),
        held=len(compounds),
        wrong=sum(compound.reserve < case.needs[compound.members] for compound in compounds),
    )


def _candidates(tuning: Tuning) -> Mapping[Members, object]:
    return {candidate.coi.members: candidate for candidate in tuning.candidates.by_mask.values()}


def _walked(case: Instance, names: Members, oracle: Repeating | None) -> int:
    if oracle is None:
        return walked(case.needs[names])
    runs = 0
    for reserve in range(10, 101, 10):
        runs += oracle.repeats(names, reserve)
        if oracle.passes(names, reserve):
            break
    return runs


def _near(reached: Value | None, best: Value | None, points: int) -> bool:
    """The same components share, and the totals are so near."""
    if reached is None or best is None:
        return reached == best
    return reached.shared == best.shared and abs(reached.total - best.total) <= points


INSTANCES = 36
SIZES = range(4, 13)
PROOF = {"edf": 0.35, "fair": 0.45, "mixing": 0.35, "host": 0.35}

PROVED, GUIDED = Way(), Way(predicts=True)
NOISY = Way(predicts=True, noisy=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A part of the benchmark: each instance of it is gone about in all of these ways."""

    name: str
    ways: Mapping[str, Way]
    goals: Mapping[str, Mapping[str, float]]  # by way, then by model: the most that the median of the walk may be
    sizes: range  # components
    largest: int = 2  # components of a compound
    one_in: int = 1  # of the instances asked for

    def models(self, chosen: Sequence[str]) -> list[str]:
        """The simulated host works pairs out only."""
        return [model for model in chosen if self.largest == 2 or model != "host"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """What was run on one instance, by way."""

    model: str
    results: dict[str, Result]


WAYS = {"proof": PROVED, "prediction": GUIDED, "noise": NOISY}
PARTS = (
    Part(name="combining", ways=WAYS, goals={"proof": PROOF, "prediction": dict.fromkeys(PROOF, 0.20)}, sizes=SIZES),
    Part(
        name="up to three",
        ways={"proof": PROVED, "prediction": GUIDED},
        goals={"proof": {}, "prediction": {}},
        sizes=range(4, 9),
        largest=3,
        one_in=2,
    ),
    Part(
        name="reservation first",
        ways={name: replace(WAYS[name], minimise=Minimise.RESERVATION) for name in ("proof", "prediction")},
        goals={"proof": PROOF, "prediction": PROOF},
        sizes=SIZES,
    ),
)


def done(part: Part, model: str, components: int, seed: int) -> Done:
    case = instance(model, components, seed, part.largest)
    return Done(model=model, results={name: run(case, way) for name, way in part.ways.items()})


def main(words: Sequence[str]) -> int:
    instances = int(words[0]) if words else INSTANCES
    chosen = [model for model in MODELS if model in words[1:] or not words[1:]]
    figures: list[Figure] = []
    with ProcessPoolExecutor(max_workers=min(2, os.cpu_count() or 1)) as workers:
        for part in PARTS:
            seeds = range(-(-instances // part.one_in // len(part.sizes)))
            cases = [
                (part, model, size, seed) for model in part.models(chosen) for seed in seeds for size in part.sizes
            ]
            results = workers.map(done, *zip(*cases, strict=True), chunksize=3)
            for model, group in groupby(results, key=lambda result: result.model):
                found = list(_figures(part, model, list(group)))
                figures += found
                print(table(found), flush=True)
    spent = os.times()
    print(f"processor time: {spent.user + spent.system + spent.children_user + spent.children_system:.0f} s")
    return report(figures)


def _figures(part: Part, model: str, instances: Sequence[Done]) -> Iterable[Figure]:
    """The figures of a part on one model; what has no goal is printed."""
    name = f"{model}, {part.name}"
    fit = sum(instance.results["proof"].fits for instance in instances)
    print(f"\n{name}: {len(instances)} instances, of which {fit} can be made to fit")
    by_way = {way: [instance.results[way] for instance in instances] for way in part.ways}
    for way, results in by_way.items():
        _print_settings(way, results)
    for way, goals in part.goals.items():
        walked = median(result.of_the_walk for result in by_way[way])
        yield Figure(name=f"{name}, {way}: median of the walk", value=walked, at_most=goals.get(model))
        yield from _not_the_best(f"{name}, {way}", by_way[way], with_limit=way == "prediction" and bool(goals))
    if "noise" in by_way:
        yield from _with_noise(name, by_way["noise"])


def _print_settings(way: str, results: Sequence[Result]) -> None:
    ratios = [result.of_the_walk for result in results]
    few = [result.of_the_walk for result in results if result.components == min(SIZES)]
    asked, walked = (sum(getattr(result, field) for result in results) for field in ("asked", "walked"))
    print(
        f"  {way}: {asked} settings (walk {walked}); of the walk: median {median(ratios):.2f}, worst "
        f"{max(ratios):.2f}, with 4 components {median(few):.2f}"
    )


def _not_the_best(name: str, results: Sequence[Result], *, with_limit: bool) -> Iterable[Figure]:
    """Where the assumption holds the end is the best there is; where it does not, that is said or counted."""
    sound = [result for result in results if not result.breaks]
    missed = sum(not result.optimal for result in sound)
    yield Figure(name=f"{name}: not the best, of {len(sound)}", value=missed, unit="", at_most=0)
    if broken := [result for result in results if result.breaks]:
        silent = sum(not result.optimal and not result.contradicted for result in broken)
        print(
            f"  {name}: the assumption is wrong in {len(broken)} more; an answer showed it in "
            f"{sum(result.contradicted for result in broken)}, where nothing was claimed; {silent} were called proved "
            "and are not the best"
        )
    if with_limit:
        part = sum(not result.optimal for result in results) / len(results)
        yield Figure(name=f"{name}: not the best, of all", value=100 * part, unit="%", at_most=5)
        yield Figure(name=f"{name}: the same, upper limit", value=100 * _upper(part, len(results)), unit="%", at_most=7)


def _upper(part: float, number: int) -> float:
    """The upper limit of a proportion with 97.5 % (E. Wilson, 1927)."""
    z = 1.96
    middle = part + z * z / 2 / number
    wide = z * (part * (1 - part) / number + z * z / 4 / number**2) ** 0.5
    return float((middle + wide) / (1 + z * z / number))


def _with_noise(name: str, results: Sequence[Result]) -> Iterable[Figure]:
    held, wrong = sum(result.held for result in results), sum(result.wrong for result in results)
    far = sum(not result.near for result in results)
    print(
        f"  noise of {NOISE} % CR, {REPEATS} of {REPEATS} repeats: {held} reservations are said to hold, {wrong} do "
        f"not; {sum(not result.near_the_truth for result in results)} of {len(results)} are another layout, or further "
        f"off, than without noise; {sum(result.contradicted for result in results)} times answers disagreed"
    )
    yield Figure(name=f"{name}, noise: another layout", value=100 * far / len(results), unit="%", at_most=10)
    yield Figure(name=f"{name}, noise: do not hold", value=100 * wrong / max(1, held), unit="%", at_most=1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
