"""Predictions choose the questions of the default strategy: never its answer where that is proved."""

import random
from collections.abc import Mapping
from dataclasses import replace

import pytest

from rarms_iac.model.system import Minimise
from rarms_iac.planner.combining.oracle import Coi, Members, SilentReporter
from rarms_iac.planner.combining.paper import Inquiry
from rarms_iac.planner.combining.questions import Best, NextSetting, Tuning, next_decision, search, tuning_of
from rarms_iac.storage.datalog.decisions import TrailSetting
from tests.unit.planner.combining.test_questions import Needs, anyone, cois, needs_of, objective

SEEDS = range(8)


def problem(seed: int, minimise: Minimise = Minimise.RESERVATION) -> tuple[Tuning, Mapping[Members, int]]:
    chance = random.Random(f"guided/{seed}")
    of: tuple[Coi, ...] = cois(**{name: chance.randint(8, 45) for name in "abcdef"})
    needs = needs_of(of, chance)
    capacity = int(sum(coi.cost for coi in of) * chance.uniform(0.9, 0.97))
    return tuning_of(of, objective(of, capacity, minimise), anyone, largest=2), needs


def guided(tuning: Tuning, needs: Mapping[Members, int], off: float, seed: int = 0) -> Tuning:
    """With predictions that are so far off (CR) on average; `off` below 0: by chance."""
    chance = random.Random(seed)
    predicted = {
        names: round(chance.uniform(5, 99) if off < 0 else least + chance.gauss(0, off))
        for names, least in needs.items()
    }
    return replace(tuning, predict=lambda names, _processors: predicted[names])


@pytest.mark.parametrize("minimise", list(Minimise))
@pytest.mark.parametrize("off", [0.0, 3.0, -1.0])
def test_wrong_predictions_do_not_change_the_answer(off: float, minimise: Minimise) -> None:
    for seed in SEEDS:
        tuning, needs = problem(seed, minimise)
        plain, _ = search(tuning, Inquiry(oracle=Needs(needs)))
        found, _ = search(guided(tuning, needs, off), Inquiry(oracle=Needs(needs)))

        assert type(found) is type(plain)
        assert isinstance(found, Best)
        assert isinstance(plain, Best)
        assert found.total == plain.total
        assert sorted(coi.members for coi in found.cois) == sorted(coi.members for coi in plain.cois)


def test_good_predictions_save_questions() -> None:
    asked = dict.fromkeys((0.5, -1.0), 0)
    for seed in SEEDS:
        tuning, needs = problem(seed)
        for off in asked:
            asked[off] += len(search(guided(tuning, needs, off), Inquiry(oracle=Needs(needs)))[1])

    assert asked[0.5] < 0.8 * asked[-1.0]


def test_far_fewer_settings_than_all_pairs() -> None:
    """docs/combining.md has the medians of large counts: 0.12 of the walk."""
    asked = walked = 0
    for seed in SEEDS:
        tuning, needs = problem(seed, Minimise.COMBINING)
        asked += len(search(tuning, Inquiry(oracle=Needs(needs)))[1])
        walked += sum(min(10, -(-least // 10)) for members, least in needs.items() if len(members) == 2)

    assert asked <= 0.2 * walked, (asked, walked)


class Hearing(SilentReporter):
    """A reporter that keeps the answers."""

    def __init__(self) -> None:
        self.answers: list[TrailSetting] = []

    def setting_answered(self, answer: TrailSetting) -> None:
        self.answers.append(answer)


def test_what_is_expected_is_told_with_every_question() -> None:
    tuning, needs = problem(0)
    step = next_decision(guided(tuning, needs, 0.0), ())

    assert isinstance(step, NextSetting)
    heard = Hearing()
    _, trail = search(guided(tuning, needs, 0.0), Inquiry(oracle=Needs(needs), reporter=heard))
    assert trail[0].predicted == step.predicted
    assert tuple(heard.answers) == trail, "a listener who stops it midway was told the same"


def test_the_same_answers_lead_to_the_same_questions() -> None:
    tuning, needs = problem(1)
    tuning = guided(tuning, needs, 2.0)
    whole, trail = search(tuning, Inquiry(oracle=Needs(needs)))

    for known in (1, len(trail) // 2, len(trail) - 1):
        assert search(tuning, Inquiry(oracle=Needs(needs)), trail[:known]) == (whole, trail)
