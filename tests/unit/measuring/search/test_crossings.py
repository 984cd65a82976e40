"""How well a setting shows where the answer lies, and what may yet be enough."""

from dataclasses import replace
from itertools import accumulate
from random import Random

import pytest

from rarms_iac.measuring.search.crossings import down_to, is_known
from rarms_iac.measuring.search.first_pass import search_by_estimates
from rarms_iac.measuring.search.trials import Goal, Member
from rarms_iac.measuring.strategies import Search, strategy_of
from rarms_iac.model.experiment import Budget
from rarms_iac.model.outcomes import Measure, Sufficient
from rarms_iac.model.series import Sample, Series, columns_of
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import Threshold
from rarms_iac.statistics.distributions import next_look
from tests.builders import a_run, at_least, at_most

WORK_MS = 20.0
GOALS: dict[str, Threshold] = {
    "mean_response_time": at_most(45),
    "p95_response_time": at_most(56.5),
    "throughput": at_least(1000 / 45),
}


def a_goal(index: str = "mean_response_time", precision: float = 0.03) -> Goal:
    member = Member(name="coi", apt={index: GOALS[index]}, run=a_run())
    return Goal(members=(member,), processors=1, precision=precision, budget=Budget(most_ms=1e9))


def a_setting(reserve: int, jobs: int, *, fixed_ms: float = 0.0, steep: float = 1.0) -> Setting:
    """Jobs of 20 ms of work that vary by 15 %: 44.4 ms on average with 45 %."""
    chance = Random(reserve)
    level = fixed_ms + steep * (100 * WORK_MS / reserve - fixed_ms)
    times = [level * max(0.1, chance.gauss(1.0, 0.15)) for _ in range(jobs)]
    began = [0.0, *accumulate(times[:-1])]
    samples = [Sample(began_ms=at, response_ms=time, successful=True) for at, time in zip(began, times, strict=True)]
    cpu_ms = sum(times) / level * WORK_MS
    series = Series(component="coi", samples=columns_of(samples), elapsed_ms=sum(times), cpu_ms=cpu_ms)
    return Setting(reserve=reserve, series=(series,), seed=1, spent_ms=sum(times))


@pytest.mark.parametrize("index", GOALS)
def test_setting_at_threshold_is_known_soon(index: str) -> None:
    others = (a_setting(80, 200),)
    assert is_known(a_setting(44, 1800), others, a_goal(index))
    assert not is_known(a_setting(44, 60), others, a_goal(index))


def test_without_precision_nothing_is_known() -> None:
    assert not is_known(a_setting(44, 1800), (), a_goal(precision=0.0))


def test_setting_above_the_answer_goes_on() -> None:
    """It will pass: it is no time to end it."""
    assert not is_known(a_setting(48, 600), (a_setting(80, 200),), a_goal())


def test_flat_curve_is_not_known_by_its_work() -> None:
    """A tenth as steep as the processor time of its jobs would make it."""
    near = a_setting(44, 1800, fixed_ms=45.0, steep=0.1)
    assert is_known(near, (), a_goal())
    assert not is_known(near, (a_setting(60, 1800, fixed_ms=45.0, steep=0.1),), a_goal())


def test_time_above_the_reservation_still_shows_the_slope() -> None:
    """A host gave 5 % more than is reserved: 42.3 ms with 45 %, so that about 43 % meet 45 ms."""
    setting = replace(a_setting(45, 25, steep=1 / 1.05), first_pass=True)

    decision = search_by_estimates([setting], a_goal(), 100)

    assert isinstance(decision, Measure)
    assert 40 <= decision.reserve <= 44


@pytest.mark.parametrize(("jobs", "least"), [(60, 43), (1800, None)])
def test_lower_answer_is_named_where_budget_ended(jobs: int, least: int | None) -> None:
    goal = a_goal()
    lower, answer = a_setting(44, jobs), a_setting(50, 1800)
    found = down_to((lower, answer), Sufficient(reserve=50, failed=44), goal)
    assert (found is None) == (least is None)
    assert found is None or found <= 45


def test_precision_makes_a_search_shorter() -> None:
    def jobs_of(precision: float) -> tuple[int, int]:
        goal = a_goal(precision=precision)
        searching = strategy_of(Search(), goal, 100)
        done: list[Setting] = []
        while isinstance(step := searching.decide(done), Measure):
            others = [each for each in done if each.reserve != step.reserve]
            jobs = next_look(sum(len(each.series[0].samples) for each in done if each.reserve == step.reserve))
            done = [*others, a_setting(step.reserve, jobs)]
        assert isinstance(step, Sufficient)
        return sum(len(each.series[0].samples) for each in done), step.reserve

    (few, near), (many, least) = jobs_of(0.1), jobs_of(0.0)
    assert few < many
    assert least <= near <= least + 6


@pytest.mark.parametrize("confirms", [True, False])
def test_confirmed_answer_still_names_the_lower_one(*, confirms: bool) -> None:
    """An answer that another load asked for is that load's to narrow."""
    settings = (a_setting(44, 60), a_setting(50, 1800))
    ended = strategy_of(Search(floor=50, confirms=confirms), a_goal(), 100).decide(settings)
    assert isinstance(ended, Sufficient)
    assert (ended.down_to is not None) is confirms


def test_first_pass_goes_on_below_settings_for_another_threshold() -> None:
    settings = [replace(a_setting(reserve, 60), first_pass=True) for reserve in (70, 90, 80, 75, 72, 71, 73)]
    walked = []
    while isinstance(decision := search_by_estimates(settings, a_goal(), 100), Measure):
        walked.append(decision.reserve)
        settings.append(replace(a_setting(decision.reserve, 60), first_pass=True))

    assert isinstance(decision, Sufficient)
    assert 43 <= decision.reserve <= 50
    assert len(walked) <= 5
