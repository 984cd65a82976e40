"""The default strategy against an oracle that knows what compounds need: the optimum, its proof, what breaks it."""

import itertools
import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import pytest

from rarms_iac.model.claims import CoreSharing
from rarms_iac.model.system import Minimise
from rarms_iac.planner.combining.candidates import Node, candidates_of, informed, nodes_of
from rarms_iac.planner.combining.layouts import Objective
from rarms_iac.planner.combining.oracle import Coi, Members, total
from rarms_iac.planner.combining.paper import Inquiry
from rarms_iac.planner.combining.questions import (
    Best,
    NextSetting,
    NothingFits,
    most_questions,
    next_decision,
    search,
    tuning_of,
)
from rarms_iac.storage.datalog.decisions import TrailSetting


@dataclass
class Needs:
    """Knows what each compound needs; asked settings are written down."""

    needs: Mapping[Members, int]
    asked: list[tuple[Members, int]] = field(default_factory=list)
    noise: int = 0  # points below a need at which samples cannot tell

    def worse(self, members: Members, reserve: int) -> frozenset[str]:
        self.asked.append((members, reserve))
        return frozenset() if reserve >= self.needs[members] else frozenset(members)

    def unresolved(self, members: Members, reserve: int) -> bool:
        return self.needs[members] - self.noise <= reserve < self.needs[members]


@dataclass
class No:
    """Declines some."""

    to: frozenset[Members]

    def allows(self, members: Members, settings: int, gain: int) -> bool:
        return members not in self.to


def cois(**reserves: int) -> tuple[Coi, ...]:
    """The first is the most critical."""
    return tuple(
        Coi(name=name, members=(name,), criticality=10 * (len(reserves) - at), processors=1, reserve=reserve)
        for at, (name, reserve) in enumerate(reserves.items())
    )


def objective(of: Sequence[Coi], capacity: int, minimise: Minimise = Minimise.COMBINING) -> Objective:
    return Objective(
        capacity=capacity,
        fits=lambda layout: total(layout) <= capacity,
        minimise=minimise,
        criticalities={coi.name: coi.criticality for coi in of},
    )


def anyone(_members: Members) -> bool:
    return True


def partitions(of: Sequence[Coi]) -> Iterator[list[tuple[Coi, ...]]]:
    """Every way to put them into partitions."""
    if not of:
        yield []
        return
    first, rest = of[0], of[1:]
    for size in range(len(rest) + 1):
        for others in itertools.combinations(rest, size):
            remaining = [coi for coi in rest if coi not in others]
            for more in partitions(remaining):
                yield [(first, *others), *more]


def by_hand(of: Sequence[Coi], needs: Mapping[Members, int], capacity: int, minimise: Minimise) -> object:
    """The best value of all layouts, by looking at every one; None: none fits."""
    values = []
    for layout in partitions(of):
        shared = sorted((coi.criticality for block in layout if len(block) > 1 for coi in block), reverse=True)
        costs = [
            needs[tuple(sorted(coi.name for coi in block))] if len(block) > 1 else block[0].reserve for block in layout
        ]
        gains = all(
            cost < total(block) for cost, block in zip(costs, layout, strict=True) if len(block) > 1
        )  # what is not a gain is dropped
        if sum(costs) <= capacity and gains:
            first, second = (shared, sum(costs)) if minimise is Minimise.COMBINING else (sum(costs), shared)
            values.append((first, second, len(layout)))
    return min(values, default=None)


def needs_of(of: Sequence[Coi], chance: random.Random) -> dict[Members, int]:
    """Of every compound: at least what its parts need, sometimes more than their sum."""
    found: dict[Members, int] = {(coi.name,): coi.reserve for coi in of}
    for size in range(2, len(of) + 1):
        for block in itertools.combinations(of, size):
            names = tuple(sorted(coi.name for coi in block))
            floor = max(found[tuple(name for name in names if name != omitted)] for omitted in names)
            found[names] = floor + chance.randint(0, max(1, (total(block) - floor) * 5 // 4))
    return found


@pytest.mark.parametrize("seed", range(40))
def test_questions_are_bounded(seed: int) -> None:
    """With predictions at random; after each answer the bound of the others is at least one less."""
    chance = random.Random(seed)
    of = cois(**{name: chance.randint(10, 60) for name in "abcde"[: chance.randint(2, 5)]})
    oracle = Needs(needs_of(of, chance))
    predicted: dict[Members, int] = {}

    def predict(members: Members, _processors: int) -> int:
        return predicted.setdefault(members, chance.randint(1, 100))

    minimise = chance.choice(list(Minimise))
    tuning = replace(tuning_of(of, objective(of, chance.randint(60, 150), minimise), anyone), predict=predict)
    answers: list[TrailSetting] = []
    bounds = [most_questions(tuning.candidates)]
    while isinstance(step := next_decision(tuning, answers), NextSetting):
        worse = tuple(sorted(oracle.worse(step.members, step.reserve)))
        answers.append(TrailSetting(components=step.members, reserve=step.reserve, worse=worse))
        bounds.append(most_questions(informed(tuning.candidates, answers)))

    assert all(later < earlier for earlier, later in itertools.pairwise(bounds)), bounds


@pytest.mark.parametrize("minimise", list(Minimise))
@pytest.mark.parametrize("seed", range(12))
def test_the_answer_is_the_best_of_all_layouts(seed: int, minimise: Minimise) -> None:
    chance = random.Random(seed)
    of = cois(**{name: chance.randint(5, 45) for name in "abcde"[: 3 + seed % 3]})
    needs = needs_of(of, chance)
    capacity = int(total(of) * chance.uniform(0.6, 1.0))
    oracle = Needs(needs)
    found, trail = search(tuning_of(of, objective(of, capacity, minimise), anyone), Inquiry(oracle=oracle))

    best = by_hand(of, needs, capacity, minimise)
    assert found.proved
    assert len(set(oracle.asked)) == len(oracle.asked) == len(trail)
    if best is None:
        assert isinstance(found, NothingFits)
        return
    assert isinstance(found, Best)
    shared = sorted(
        (own.criticality for own in of for coi in found.cois if own.name in coi.members and len(coi.members) > 1),
        reverse=True,
    )
    first, second = (shared, found.total) if minimise is Minimise.COMBINING else (found.total, shared)
    assert (first, second, len(found.cois)) == best
    assert all(coi.reserve == needs[coi.members] for coi in found.cois)


def test_what_fits_already_is_not_asked_for() -> None:
    of = cois(a=40, b=30)
    assert isinstance(next_decision(tuning_of(of, objective(of, 70), anyone), ()), Best)


def test_interrupted_search_reaches_the_same_end() -> None:
    of = cois(a=40, b=30, c=25, d=20)
    needs = needs_of(of, random.Random(3))
    tuning = tuning_of(of, objective(of, 90), anyone)
    whole, trail = search(tuning, Inquiry(oracle=Needs(needs)))

    assert trail
    for known in range(len(trail)):
        oracle = Needs(needs)
        again, all_of_it = search(tuning, Inquiry(oracle=oracle), trail[:known])
        assert (again, all_of_it) == (whole, trail)
        assert len(oracle.asked) == len(trail) - known


def test_forbidden_compounds_are_never_asked() -> None:
    of = cois(a=40, b=30, c=25)
    oracle = Needs(needs_of(of, random.Random(1)))
    search(tuning_of(of, objective(of, 80), lambda members: "c" not in members), Inquiry(oracle=oracle))

    assert {members for members, _ in oracle.asked} == {("a", "b")}


def test_a_combination_that_is_declined_is_left_out() -> None:
    of = cois(a=40, b=30, c=25)
    oracle = Needs({("b", "c"): 30, ("a", "c"): 42, ("a", "b"): 45, ("a", "b", "c"): 50})
    inquiry = Inquiry(oracle=oracle, consent=No(frozenset({("b", "c")})))
    found, _ = search(tuning_of(of, objective(of, 80), anyone), inquiry)

    assert isinstance(found, Best)
    assert [coi.members for coi in found.cois] == [("a", "c"), ("b",)]
    assert not found.proved, "the one that was declined may be better"


def test_where_nothing_fits_that_is_proved() -> None:
    of = cois(a=60, b=50)
    found, trail = search(tuning_of(of, objective(of, 70), anyone), Inquiry(oracle=Needs({("a", "b"): 80})))

    assert isinstance(found, NothingFits)
    assert found.proved
    assert max(answer.reserve for answer in trail) <= 109


@pytest.mark.parametrize("seed", range(6))
def test_layouts_that_cannot_fit_are_dropped_unmeasured(seed: int) -> None:
    """A compound that is asked about is in some layout that fits, if each needs as little as it was known to."""
    chance = random.Random(f"dropped/{seed}")
    of = cois(**{name: chance.randint(10, 45) for name in "abcde"})
    capacity = int(total(of) * chance.uniform(0.7, 0.9))
    tuning = tuning_of(of, objective(of, capacity), anyone)
    _, trail = search(tuning, Inquiry(oracle=Needs(needs_of(of, chance))))
    assert trail

    layouts = [[tuple(sorted(coi.name for coi in block)) for block in layout] for layout in partitions(of)]
    alone = {coi.members: coi.reserve for coi in of}
    for at, question in enumerate(trail):
        known = informed(tuning.candidates, trail[:at]).by_mask.values()
        least = alone | {candidate.coi.members: candidate.low for candidate in known if candidate.is_gain}
        possible = [
            layout for layout in layouts if question.components in layout and all(block in least for block in layout)
        ]
        assert min(sum(least[block] for block in layout) for layout in possible) <= capacity


def test_where_no_layout_can_fit_nothing_is_measured() -> None:
    of = cois(a=40, b=30, c=25)
    found, trail = search(tuning_of(of, objective(of, 39), anyone), Inquiry(oracle=Needs({})))

    assert isinstance(found, NothingFits)
    assert found.proved
    assert trail == (), "40 % are needed at least, with any sharing"


def test_undecided_samples_prove_no_other_layout() -> None:
    """74 % is the least: with a and b 75 %, and less, if what its samples could not tell were enough for them."""
    of = cois(a=40, b=30, c=25)
    needs = {("a", "b"): 50, ("a", "c"): 44, ("b", "c"): 36, ("a", "b", "c"): 94}

    def found(noise: int) -> Best:
        aim = objective(of, 80, Minimise.RESERVATION)
        best, _ = search(tuning_of(of, aim, anyone), Inquiry(oracle=Needs(needs, noise=noise)))
        assert isinstance(best, Best)
        return best

    assert found(0).proved
    assert not found(12).proved
    assert [(doubt.components, doubt.shown < doubt.unresolved) for doubt in found(12).doubts] == [(("a", "b"), True)]
    assert found(12).total == found(0).total == 74, "what was found stays what it is"


def test_undecided_settings_do_not_prove_misfit() -> None:
    of = cois(a=40, b=30)
    aim = objective(of, 55)

    def nothing(noise: int) -> NothingFits:
        found, _ = search(tuning_of(of, aim, anyone), Inquiry(oracle=Needs({("a", "b"): 60}, noise=noise)))
        assert isinstance(found, NothingFits)
        return found

    assert nothing(0).proved
    assert not nothing(8).proved
    (doubt,) = nothing(8).doubts
    assert doubt.components == ("a", "b")
    assert doubt.shown <= 55 < doubt.unresolved < 60


def test_an_answer_that_contradicts_another_voids_the_proof() -> None:
    of = cois(a=40, b=30)
    tuning = tuning_of(of, objective(of, 60), anyone)
    answers = [
        TrailSetting(components=("a", "b"), reserve=45, worse=()),
        TrailSetting(components=("a", "b"), reserve=50, worse=("a",)),
    ]
    step = next_decision(tuning, answers)

    assert isinstance(step, NextSetting)
    assert step.reserve > 50, "the safe side: what failed counts"
    ended = next_decision(tuning, [*answers, TrailSetting(components=("a", "b"), reserve=51, worse=())])
    assert isinstance(ended, Best)
    assert not ended.proved
    assert (
        ended.contradictions[0].message
        == "a+b met its thresholds with 45 % of its VPs, but missed a threshold with 50 %"
    )


def test_cheaper_compound_voids_the_proof() -> None:
    of = cois(a=40, b=38, c=36)
    answers = [
        TrailSetting(components=("b", "c"), reserve=60, worse=("b",)),
        TrailSetting(components=("a", "b", "c"), reserve=50, worse=()),
    ]
    step = next_decision(tuning_of(of, objective(of, 61), anyone), answers)

    assert isinstance(step, NextSetting), "50 % was seen to be enough for all three: their least is still asked for"
    assert step.members == ("a", "b", "c")
    done = [*answers, TrailSetting(components=("a", "b", "c"), reserve=49, worse=("a",))]
    ended = next_decision(tuning_of(of, objective(of, 61), anyone), done)
    assert isinstance(ended, Best)
    (contradiction,) = ended.contradictions
    assert contradiction.message == "a+b+c needs less than its part b+c"


def test_compound_may_need_two_points_less() -> None:
    of = tuple(replace(coi, processors=2) for coi in cois(a=40, b=30))
    tuning = tuning_of(of, objective(of, 80), anyone)
    found, trail = search(tuning, Inquiry(oracle=Needs({("a", "b"): 39})))
    assert isinstance(found, Best)
    assert (found.proved, found.total) == (True, 78)
    assert min(answer.reserve for answer in trail) == 38, "that less is not enough was seen"

    below = [TrailSetting(components=("a", "b"), reserve=37, worse=())]
    ended, _ = search(tuning, Inquiry(oracle=Needs({("a", "b"): 37})), below)
    (contradiction,) = ended.contradictions
    assert contradiction.message == "a+b needs less than its part a"
    assert not ended.proved


def test_other_measurements_count_with_an_answer() -> None:
    """The two least critical cannot fit as assumed; their data log says that they need less than one of them alone."""
    of = cois(a=40, b=30, c=20)
    tuning = tuning_of(of, objective(of, 60), anyone)
    recorded = [
        TrailSetting(components=("a", "b"), reserve=40, worse=()),
        TrailSetting(components=("b", "c"), reserve=20, worse=()),
    ]

    without, asked = search(tuning, Inquiry(oracle=Needs({("a", "b"): 40, ("a", "b", "c"): 80})))
    found, trail = search(
        tuning, Inquiry(oracle=Needs({("a", "b"): 40, ("a", "b", "c"): 80, ("b", "c"): 20})), recorded=recorded
    )

    assert isinstance(without, Best)
    assert isinstance(found, Best)
    assert (without.proved, [coi.members for coi in without.cois]) == (True, [("a", "b"), ("c",)])
    assert trail[: len(asked)] == asked, "the same questions first, so that a search that was stopped asks them again"
    assert recorded[1] in trail[len(asked) :]
    assert len({(answer.components, answer.reserve) for answer in trail}) == len(trail), "nothing is told twice"
    assert (found.proved, [coi.members for coi in found.cois]) == (False, [("a",), ("b", "c")])
    (contradiction,) = found.contradictions
    assert contradiction.message == "b+c needs less than its part b"


def nodes(of: Sequence[Coi]) -> dict[str, Node]:
    return {node.name: node for node in nodes_of(candidates_of(of, anyone, most=100), {})}


def test_compound_is_searched_down_to_known_misses() -> None:
    of = tuple(replace(coi, missed=missed) for coi, missed in zip(cois(a=40, b=30), (34, None), strict=True))
    found, trail = search(tuning_of(of, objective(of, 60), anyone), Inquiry(oracle=Needs({("a", "b"): 36})))

    assert isinstance(found, Best)
    assert (found.proved, found.total, found.cois[0].missed) == (True, 36, None)
    assert min(answer.reserve for answer in trail) == 35
    assert nodes(of)["a+b"].low == 35


def test_of_many_only_least_critical_are_looked_at() -> None:
    of = cois(**{f"n{at:02}": 10 for at in range(16)})
    pair = ("n14", "n15")
    found, trail = search(tuning_of(of, objective(of, 155), anyone), Inquiry(oracle=Needs({pair: 12})))

    assert isinstance(found, Best)
    assert {answer.components for answer in trail} == {pair}
    assert found.proved, "combining as little as possible, no layout with a more critical one comes before"


def test_the_candidate_graph_has_compounds_with_their_intervals() -> None:
    graph = nodes(cois(a=40, b=30, c=20))

    assert (graph["a"].parts, graph["a"].low, graph["a"].high) == ((), 40, 40)
    assert (graph["a+b"].low, graph["a+b"].high) == (40, 69)
    assert graph["a+b+c"].parts == ("a", "b", "c")


def test_single_threads_can_share_a_core() -> None:
    arm, base = (
        replace(coi, sharing=CoreSharing(threads=2, used=2), host_lp=8, missed=29) for coi in cois(arm=40, base=40)
    )

    (both,) = candidates_of([arm, base], anyone, most=100).by_mask.values()

    assert (arm.processors, arm.cost, arm.at_least) == (1, 80, 30)
    assert (both.coi.processors, both.coi.taken_processors) == (2, 2)
    assert (both.low, both.highest) == (13, 79), "30 % of one of two processors, less 2; and less than 160 % on two"


def test_least_known_compound_is_asked_by_cores() -> None:
    """Three threads take two cores, as four do."""
    of = [
        replace(coi, processors=processors, sharing=CoreSharing(threads=2, used=2), host_lp=8)
        for coi, processors in zip(cois(a=40, b=40, c=25, d=25), (1, 2, 2, 2), strict=True)
    ]
    pairs = {("a", "b"), ("c", "d")}
    tuning = tuning_of(of, objective(of, 200, Minimise.RESERVATION), lambda members: members in pairs)
    widths = {each.coi.members: each.highest - each.low for each in tuning.candidates.by_mask.values()}

    assert widths == {("a", "b"): 14, ("c", "d"): 13}
    assert next_decision(tuning, ()) == NextSetting(members=("a", "b"), reserve=32, predicted=None)
