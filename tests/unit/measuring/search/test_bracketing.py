"""The default strategy on curves without noise: a bound for every curve, and what it reads off two settings."""

from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rarms_iac.measuring.search.bracketing import MOST
from rarms_iac.measuring.search.crossings import crossings_of
from rarms_iac.measuring.search.trials import Goal, Member, judge_settings
from rarms_iac.measuring.strategies import Search, strategy_of
from rarms_iac.model.experiment import Budget
from rarms_iac.model.outcomes import WIDTH, Conclusion, Measure, NotAchievable, NotResolved, Sufficient
from rarms_iac.model.series import Sample, Series, columns_of
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import Threshold
from tests.builders import a_run, at_least, at_most
from tests.effort import LONG, examples

JOBS = 2400
INDEXES: dict[str, Threshold] = {
    "mean_response_time": at_most(100),
    "p95_response_time": at_most(100),
    "maximum_response_time": at_most(100),
    "throughput": at_least(10),
}


def a_goal(index: str) -> Goal:
    return Goal(members=(Member(name="coi", apt={index: INDEXES[index]}, run=a_run()),), processors=2)


def a_setting(reserve: int, level: float, cpu_ms: float | None) -> Setting:
    """Jobs one after another that take the level, and hardly differ."""
    times = [level * (1.0 + 1e-6 * ((7 * number) % 5 - 2)) for number in range(JOBS)]
    jobs = tuple(
        Sample(began_ms=level * number, response_ms=time, successful=True) for number, time in enumerate(times)
    )
    cpu = None if cpu_ms is None else JOBS * cpu_ms
    # As columns, as a log gives them: what is worked out of them is kept.
    series = Series(component="coi", samples=columns_of(jobs), elapsed_ms=level * JOBS, cpu_ms=cpu)
    return Setting(reserve=reserve, series=(series,), seed=1)


def measured(
    strategy: str, goal: Goal, levels: Sequence[float], cpu_ms: float | None = None
) -> tuple[list[int], Conclusion]:
    """What `rarms measure --strategy` measures, where the level at CR 1, 2, ... is this, and how it ends."""
    agreeing = strategy_of(Search(strategy=strategy), goal, 100)
    done: list[Setting] = []
    while isinstance(step := agreeing.decide(done), Measure):
        assert len(done) <= 100
        done.append(a_setting(step.reserve, levels[step.reserve - 1], cpu_ms))
    return [setting.reserve for setting in done], step


def is_within_the_resolution(end: Conclusion, halved: Conclusion) -> bool:
    """Whether the default search ends as bisection does, and not farther from what is enough than its resolution."""
    match end, halved:
        case Sufficient(reserve=reserve, failed=failed), Sufficient(reserve=least):
            return least <= reserve < least + WIDTH and reserve - (failed or 0) <= WIDTH
        case _:
            return type(end) is type(halved) in (NotAchievable, NotResolved)


falling_levels = st.lists(st.floats(1.0, 1e4), min_size=1, max_size=6).flatmap(
    lambda values: st.lists(st.integers(1, 100), min_size=len(values) - 1, max_size=len(values) - 1).map(
        lambda places: [
            sorted(values, reverse=True)[sum(place <= reserve for place in places)] for reserve in range(1, 101)
        ]
    )
)


@pytest.mark.parametrize("before", [(3, 6, 9), (2, 3, 4, 5, 6, 7, 8, 9)])
@pytest.mark.parametrize("least", [12, 31, 62, 99])
def test_earlier_settings_do_not_mislead_search(before: Sequence[int], least: int) -> None:
    """A bracket that they left wider than a search's own would be is halved, and not taken down from its upper end."""
    goal = a_goal("mean_response_time")
    searching = strategy_of(Search(strategy="default"), goal, 100)
    levels = [200.0 - reserve if reserve < least else 90.0 - reserve / 10 for reserve in range(1, 101)]
    done = [a_setting(reserve, levels[reserve - 1], None) for reserve in before]
    while isinstance(step := searching.decide(done), Measure):
        done.append(a_setting(step.reserve, levels[step.reserve - 1], None))

    assert len(done) - len(before) < MOST
    assert isinstance(step, Sufficient)
    assert least <= step.reserve < least + WIDTH


@pytest.mark.parametrize("strategy", ["default", "bisection"])
@pytest.mark.parametrize(("every", "asked"), [(None, 2), ("100 ms", 1)])
@pytest.mark.parametrize(("level", "end"), [(90.0, NotResolved), (200.0, NotAchievable)])
def test_impossible_budget_asks_only_the_maximum(
    strategy: str, every: str | None, asked: int, level: float, end: type[NotResolved | NotAchievable]
) -> None:
    """A p99.9 needs 8,363 samples; jobs of 90 ms on two processors give 667 in 30 s beside the 2,400 that there are."""
    member = Member(name="coi", apt={"p99.9_response_time": at_most(100)}, run=a_run(every=every))
    goal = Goal(members=(member,), processors=2, budget=Budget(most_ms=30_000))

    reserves, ended = measured(strategy, goal, [level] * 100, cpu_ms=90.0)

    assert (len(reserves), reserves[-1], type(ended)) == (asked, 100, end)


@settings(max_examples=examples(8), deadline=None)
@given(index=st.sampled_from(["mean_response_time", "throughput"]), levels=falling_levels, cpu=st.floats(0.01, 1e3))
def test_search_needs_one_setting_more_than_bisection(index: str, levels: list[float], cpu: float) -> None:
    goal = a_goal(index)

    reserves, end = measured("default", goal, levels, cpu)

    assert len(reserves) == len(set(reserves)) <= MOST
    assert is_within_the_resolution(end, measured("bisection", goal, levels, cpu)[1])


EDGES = [1, 2, 3, 14, 22, 44, 46, 47, 62, 88, 99, 100, 101]


@pytest.mark.parametrize("index", ["mean_response_time", "maximum_response_time"])
@pytest.mark.parametrize("edge", EDGES if LONG else EDGES[::2])
@pytest.mark.parametrize("good", [99.0, 30.0])
def test_flat_curve_with_cliff_takes_no_more_either(index: str, edge: int, good: float) -> None:
    levels = [good if reserve >= edge else 2000.0 for reserve in range(1, 101)]

    reserves, end = measured("default", a_goal(index), levels, 2.0)

    assert len(reserves) == len(set(reserves)) <= MOST
    assert is_within_the_resolution(end, measured("bisection", a_goal(index), levels, 2.0)[1])


@pytest.mark.parametrize("least", [3, 17, 30, 61, 80, 96])
def test_stretched_work_is_predicted_by_cpu_time(least: int) -> None:
    fixed, wanted = 20.0, 100.0
    work = (wanted - fixed) * (least - 0.5)

    reserves, end = measured(
        "default", a_goal("mean_response_time"), [fixed + work / reserve for reserve in range(1, 101)], work / 100
    )

    assert isinstance(end, Sufficient)
    assert least <= end.reserve <= least + 1
    assert len(reserves) <= 4


def test_a_setting_foretells_where_the_threshold_is_met() -> None:
    """15 ms of CPU time in 50 ms at 50 %: a + b / CR with b = 1500, so 40 ms are met at 75 %, and shown a bit above."""
    goal = a_goal("mean_response_time")
    slower = Goal(
        members=(Member(name="coi", apt={"mean_response_time": at_most(40)}, run=a_run()),), processors=goal.processors
    )

    (crossing,) = crossings_of(judge_settings([a_setting(50, 50.0, 15.0)], slower).trials, slower, 50, 101)

    assert 75 < crossing.at < 75.7
    assert not crossing.smooth


def test_periodic_component_needs_cpu_for_throughput() -> None:
    """2 ms of work every 33 ms: the rate is 30 a second at 50 %, and 24 a second may be had for a fifth less."""
    jobs = tuple(Sample(began_ms=33.0 * number, response_ms=4.0, successful=True) for number in range(JOBS))
    series = Series(component="coi", samples=jobs, elapsed_ms=33.0 * JOBS, cpu_ms=2.0 * JOBS)
    goal = Goal(members=(Member(name="coi", apt={"throughput": at_least(24)}, run=a_run()),), processors=2)

    (crossing,) = crossings_of(judge_settings([Setting(reserve=50, series=(series,))], goal).trials, goal, 0, 50)

    # What is waited for, 33 ms less 2 ms at 50 %, no CPU shortens: 1000 / 24 = 29 + 200 / CR.
    assert crossing.at == pytest.approx(200 / (1000 / 24 - 29), rel=0.05)
