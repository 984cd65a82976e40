"""One instance, one way of going about it: what it took, and whether the end is right."""

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import ceil
from statistics import NormalDist

from benchmarks.combining_cases import Instance, Value, best_value, halved, value_of, walked
from benchmarks.combining_models import NEVER
from rarms_iac.model.system import Minimise
from rarms_iac.planner.combining.candidates import informed
from rarms_iac.planner.combining.guiding import needs_less, outlook_of
from rarms_iac.planner.combining.oracle import Asked, Coi, Members, PerformanceOracle, total
from rarms_iac.planner.combining.paper import Asking, tune_performance_to_use_less_resource
from rarms_iac.planner.combining.questions import Best, Tuning, search, tuning_of
from rarms_iac.planner.prediction.belief import Outlook, belief_of
from rarms_iac.planner.prediction.members import NOTHING

REPEATS = 3
NOISE = 0.5  # per cent of CR: the spread of the reservation at which a repeat just meets all thresholds
TRIED = 4  # compounds an instance whose prediction is compared with the truth


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """How to go about it."""

    minimise: Minimise = Minimise.COMBINING
    predicts: bool = False
    probability: float | None = None
    noisy: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Miss:
    """A prediction of a compound that it was not fitted to, beside the truth; CRs."""

    predicted: int
    low: int  # it was expected to need more with 90 %, and less than `high` with 90 %
    high: int
    need: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """How it went."""

    components: int
    asked: int  # settings, all repeats counted
    walked: int
    halved: int
    fits: bool
    optimal: bool
    told: bool  # an answer contradicted the assumption
    breaks: bool  # the assumption is wrong there, seen or not
    stopped: bool  # at a probability, short of the proof
    near: bool = True  # who shares in the best does, and the total is within 1 point a compound
    near_the_truth: bool = True  # the same without any noise
    held: int = 0  # reservations of compounds that were said to hold
    wrong: int = 0  # of these, that do not
    misses: tuple[Miss, ...] = ()

    @property
    def of_the_walk(self) -> float:
        return self.asked / self.walked

    @property
    def of_halving(self) -> float:
        return self.asked / self.halved


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
        return next((one for one in range(near, NEVER) if self.passes(members, one)), NEVER)


def run(case: Instance, way: Way) -> Result:
    """The default strategy on one instance."""
    oracle = Repeating(case=case) if way.noisy else None
    tuning = replace(
        tuning_of(case.cois, case.objective(way.minimise), lambda _members: True, largest=case.largest),
        predictor=case.predictor if way.predicts else NOTHING,
        probability=way.probability,
    )
    asking: PerformanceOracle = case if oracle is None else oracle
    found, trail = search(tuning, Asking(oracle=asking))
    needs = case.needs if oracle is None else {names: oracle.least(names) for names in case.needs}
    best = best_value(case, needs, way.minimise)
    truly = best if oracle is None else best_value(case, case.needs, way.minimise)
    reached = value_of(case, found.cois) if isinstance(found, Best) else None
    compounds = [coi for coi in found.cois if len(coi.members) > 1] if isinstance(found, Best) else []
    possible = [names for names, one in _candidates(tuning).items()]
    return Result(
        components=len(case.cois),
        asked=len(trail) if oracle is None else oracle.runs,
        walked=sum(_walked(case, names, oracle) for names in (case.needs if case.largest == 2 else possible)),
        halved=sum(halved(case.needs[names]) for names in (case.needs if case.largest == 2 else possible)),
        fits=best is not None,
        optimal=reached == best,
        told=bool(found.breaks),
        breaks=case.breaks,
        stopped=isinstance(found, Best) and found.stopped_at is not None,
        near=_near(reached, best, len(compounds) * case.processors),
        near_the_truth=_near(reached, truly, len(compounds) * case.processors),
        held=len(compounds),
        wrong=sum(compound.reserve < case.needs[compound.members] for compound in compounds),
        misses=tuple(_misses(tuning, trail, case)) if way.predicts else (),
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


def _misses(tuning: Tuning, trail: Sequence[Asked], case: Instance) -> list[Miss]:
    """Compounds as they would be predicted had they not been asked about, but all others."""
    known, predictor = informed(tuning.candidates, trail), tuning.predictor
    less = needs_less(known)
    outlooks = {mask: outlook_of(candidate, predictor, less) for mask, candidate in known.by_mask.items()}
    seen = {mask: one for mask, one in outlooks.items() if known.by_mask[mask].was_asked}
    most = {mask: int(one.together) for mask, one in outlooks.items()}  # beyond it is no gain, however far
    some = random.Random(f"misses/{case.seed}").sample(sorted(outlooks), min(TRIED, len(outlooks)))
    misses = []
    for mask in some:
        others = [one for each, one in seen.items() if each != mask]
        bare = replace(outlooks[mask], low=_least(outlooks[mask]), passed=None, failed=None)
        expected = belief_of(len(predictor.ways), others).of(bare)
        misses.append(
            Miss(
                predicted=min(most[mask], expected.quantile(0.5)),
                low=min(most[mask], expected.quantile(0.1)),
                high=min(most[mask], expected.quantile(0.9)),
                need=min(most[mask], case.needs[known.by_mask[mask].coi.members]),
            )
        )
    return misses


def _least(outlook: Outlook) -> int:
    return max(1, ceil(outlook.neediest) - outlook.slack)


@dataclass(frozen=True, slots=True, kw_only=True)
class Greedy:
    """The paper's procedure, repeated over pairs until it fits."""

    asked: int
    ends: str  # optimal, fits, or fails


def greedy(case: Instance) -> Greedy:
    """What is combined is not combined again, as only pairs are known."""
    cois: tuple[Coi, ...] = case.cois
    asked = 0
    while total(cois) > case.capacity:
        free = tuple(coi for coi in cois if len(coi.members) == 1)
        rest = total(cois) - total(free)
        done = tune_performance_to_use_less_resource(free, max(0, case.capacity - rest), Asking(oracle=case))
        asked += len(done.trail)
        if not done.combinations:
            return Greedy(asked=asked, ends="fails")
        cois = (*done.cois, *(coi for coi in cois if len(coi.members) > 1))
    best = best_value(case, case.needs, Minimise.COMBINING)
    return Greedy(asked=asked, ends="optimal" if value_of(case, cois) == best else "fits")
