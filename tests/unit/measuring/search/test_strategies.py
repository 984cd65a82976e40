"""Strategies on components without noise: what they measure, and what they find."""

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

import pytest

from rarms_iac.measuring.search import STRATEGIES
from rarms_iac.measuring.search.trials import (
    MOST_INCONCLUSIVE,
    Bracket,
    Goal,
    Member,
    SearchTrial,
    below_demand,
    bracket_of,
    judge_settings,
    settings_below,
)
from rarms_iac.measuring.strategies import Sweep, reserves_of
from rarms_iac.model.outcomes import WIDTH, Measure, Missed, NotAchievable, NotResolved, SearchDecision, Sufficient
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.run import Periodic, SampleCount
from rarms_iac.model.setting import Setting
from rarms_iac.statistics.distributions import ERROR
from tests.builders import a_run, at_most
from tests.effort import examples
from tests.measured import a_series, noisy

RUN = replace(a_run(), deadline=None)
LONG_RUN = replace(RUN, until=SampleCount(samples=60))
GOAL = Goal(members=(Member(name="coi", apt={"mean_response_time": at_most(100)}, run=RUN),), processors=2)


def judged(history: Sequence[SearchTrial], setting: Setting, goal: Goal) -> list[SearchTrial]:
    """All settings so far, with one more."""
    return list(judge_settings([*(trial.setting for trial in history), setting], goal).trials)


def the_trial(setting: Setting, goal: Goal) -> SearchTrial:
    (trial,) = judge_settings([setting], goal).trials
    return trial


def walk(strategy: str, least: int) -> tuple[list[int], SearchDecision]:
    """The settings a strategy measures, and its end, where the APT is met from a reservation on (101: never)."""
    history: list[SearchTrial] = []
    while True:
        step = STRATEGIES[strategy](history, GOAL)
        if not isinstance(step, Measure):
            return [trial.reserve for trial in history], step
        times = noisy(step.reserve, 80.0 if step.reserve >= least else 120.0, variation=0.01, count=100)
        history = judged(history, Setting(reserve=step.reserve, series=(a_series(times),)), GOAL)


def test_paper_walks_by_ten_until_pass() -> None:
    assert walk("paper", 62) == ([10, 20, 30, 40, 50, 60, 70], Sufficient(reserve=70, failed=60))
    assert walk("paper", 3) == ([10], Sufficient(reserve=10, failed=None))


def test_paper_ends_where_all_of_platform_misses() -> None:
    settings, step = walk("paper", 101)

    assert settings == [10, 20, 30, 40, 50, 60, 70, 80, 90, 100]
    assert step == NotAchievable(reserve=100)


def test_paper_says_not_achievable_only_if_shown() -> None:
    times = {reserve: noisy(reserve, 120.0 if reserve < 100 else 99.9, variation=0.1) for reserve in range(10, 101, 10)}
    history = judge_settings([Setting(reserve=each, series=(a_series(times[each]),)) for each in times], GOAL).trials

    assert isinstance(STRATEGIES["paper"](history, GOAL), NotResolved)


@pytest.mark.parametrize("least", [1, 2, 37, 99, 100])
def test_halving_finds_the_least_whole_per_cent(least: int) -> None:
    settings, step = walk("bisection", least)

    assert step == Sufficient(reserve=least, failed=least - 1 or None)
    assert len(settings) <= 8
    assert len(set(settings)) == len(settings)


def test_halving_ends_when_everything_is_too_little() -> None:
    settings, step = walk("bisection", 101)

    assert settings[-1] == 100
    assert isinstance(step, NotAchievable)


def test_error_of_setting_is_shared_by_its_members() -> None:
    """All meet their thresholds exactly, so each verdict `Missed` is wrong: too many would show with sixteen."""
    tries, count = examples(100), 16
    goal = Goal(
        members=tuple(
            Member(name=f"coi-{number}", apt={"mean_response_time": at_most(100)}, run=LONG_RUN)
            for number in range(count)
        ),
        processors=2,
    )
    wrong = 0
    for seed in range(tries):
        series = tuple(
            a_series(noisy(seed * count + number, 100.0, count=60), component=f"coi-{number}")
            for number in range(count)
        )
        verdicts = the_trial(Setting(reserve=50, series=series), goal).verdicts.values()
        wrong += any(isinstance(verdict, Missed) for verdict in verdicts)

    assert wrong <= ERROR * tries + 2.4 * (ERROR * (1 - ERROR) * tries) ** 0.5


def unsteady(strategy: str, least: int, silent: range, level: float = 80.0) -> tuple[list[int], SearchDecision]:
    """A search where settings in this range never become steady: jobs take half of the level, and later all of it."""
    history: list[SearchTrial] = []
    while isinstance(step := STRATEGIES[strategy](history, GOAL), Measure):
        assert len(history) < 40
        mean = 80.0 if step.reserve >= least else 120.0
        times = noisy(step.reserve, mean, variation=0.01, count=100)
        if step.reserve in silent:
            times = [time * level / mean * (0.5 if at < 50 else 1.0) for at, time in enumerate(times)]
        history = judged(history, Setting(reserve=step.reserve, series=(a_series(times),)), GOAL)
    return [trial.reserve for trial in history], step


@pytest.mark.parametrize(
    ("strategy", "silent"),
    [
        ("default", range(45, 46)),
        ("default", range(40, 60)),
        ("bisection", range(50, 51)),
        ("bisection", range(40, 60)),
    ],
)
def test_unsteady_setting_continues_below(strategy: str, silent: range) -> None:
    settings, step = unsteady(strategy, 20, silent)

    assert isinstance(step, Sufficient)
    assert set(settings) & set(silent)
    assert 20 <= step.reserve < 20 + WIDTH
    assert step.failed in settings
    assert 0 < step.reserve - step.failed <= 3
    assert len(set(settings)) == len(settings)


@pytest.mark.parametrize("strategy", ["default", "bisection"])
def test_unsteady_answer_moves_up_and_is_no_fail(
    strategy: str,
) -> None:
    settings, step = unsteady(strategy, 45, range(40, 51), level=100.0)

    assert isinstance(step, Sufficient)
    assert step.reserve == 51
    assert step.failed is None or step.failed < 40
    assert len(set(settings)) == len(settings) <= 20


@pytest.mark.parametrize("strategy", ["default", "bisection"])
@pytest.mark.parametrize("level", [90.0, 150.0])
def test_component_that_never_is_steady_takes_few_settings(strategy: str, level: float) -> None:
    settings, step = unsteady(strategy, 1, range(1, 101), level)

    assert step == NotResolved(reason="at 100 % of its VPs coi did not reach a steady state")
    assert len(settings) <= MOST_INCONCLUSIVE + 1


def test_lower_pass_stands_below_unsteady_setting() -> None:
    times = noisy(1, 80.0, variation=0.01, count=100)
    passing = the_trial(Setting(reserve=20, series=(a_series(times),)), GOAL)
    broken = [time * (0.5 if at < 50 else 1.0) for at, time in enumerate(times)]
    silent = the_trial(Setting(reserve=45, series=(a_series(broken),)), GOAL)

    assert silent.inconclusive
    assert not silent.failed
    assert bracket_of([passing, silent], GOAL) == Bracket(highest_failed=0, lowest_passed=20)
    assert bracket_of([silent], GOAL) == Bracket(highest_failed=0, lowest_passed=None, inconclusive=(45,))
    assert settings_below([passing, silent], 60) == (None, (45,))


@pytest.mark.parametrize("strategy", ["default", "bisection"])
def test_nothing_below_demand_is_asked(strategy: str) -> None:
    run = replace(RUN, arrival=Periodic(period=Milliseconds(Fraction(100))))
    goal = replace(GOAL, members=(Member(name="coi", apt={"mean_response_time": at_most(90)}, run=run),))
    history: list[SearchTrial] = []
    while isinstance(step := STRATEGIES[strategy](history, goal), Measure):
        level, demand_lp = (80.0 if step.reserve >= 68 else 95.0), 1.3
        times = noisy(step.reserve, level, variation=0.01, count=100)
        series = replace(a_series(times), cpu_ms=demand_lp * 100 * len(times))
        history = judged(history, Setting(reserve=step.reserve, series=(series,)), goal)

    assert isinstance(step, Sufficient)
    assert 68 <= step.reserve <= 69
    assert all(trial.reserve > 64 for trial in history[1:]), "1.3 LP of two processors are 65 %"
    assert below_demand(history, goal) == 64


def test_member_that_misses_fails_setting_with_any_others() -> None:
    goal = Goal(
        members=tuple(Member(name=name, apt={"mean_response_time": at_most(100)}, run=RUN) for name in ("a", "b")),
        processors=2,
    )
    rising = a_series([50.0 + at for at in range(100)], component="a")
    slow = a_series(noisy(1, 120.0, variation=0.01, count=100), component="b")
    quick = a_series(noisy(1, 80.0, variation=0.01, count=100), component="b")

    assert the_trial(Setting(reserve=45, series=(rising, slow)), goal).failed
    assert the_trial(Setting(reserve=45, series=(rising, quick)), goal).inconclusive


def test_coarse_curve_is_clipped_to_the_host() -> None:
    assert reserves_of(Sweep(), 100) == (10, 20, 30, 40, 50, 60, 70, 80, 90, 100)
    assert reserves_of(Sweep(), 47) == (10, 20, 30, 40, 47)
    assert reserves_of(Sweep(), 0) == (10,), "a setting that the host refuses, with its reason"
