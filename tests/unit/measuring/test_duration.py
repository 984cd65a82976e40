"""How long measuring will take: bounds from the settings that may be asked for, and from how each setting ends."""

from collections.abc import Mapping
from dataclasses import replace

import pytest

from rarms_iac.measuring.duration import DurationBounds, expected_duration, settings_to_run, with_part_of_budget
from rarms_iac.measuring.methods import Method, Search
from rarms_iac.measuring.strategies import Sweep
from rarms_iac.model.experiment import Budget, Experiment, experiment_of, experiments_of
from rarms_iac.model.quantities import show_duration
from rarms_iac.model.run import Elapsed, Run, SampleCount
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import Threshold
from tests.builders import a_component, a_run, a_simulation, a_system, at_least, at_most, milliseconds
from tests.builders_measured import a_series, a_setting

SEARCH = Search()


def an_experiment(*runs: Run, apt: Mapping[str, Threshold] | None = None) -> Experiment:
    components = [
        a_component(f"member-{number}", run=run, apt=apt, simulation=a_simulation()) for number, run in enumerate(runs)
    ]
    system = a_system(components=components)
    return experiment_of(system, system.hosts["onboard"], tuple(system.components), "busy-loop")


def bounds(experiment: Experiment, *recorded: Setting, method: Method = SEARCH) -> DurationBounds:
    return expected_duration(experiment, settings_to_run(method, recorded, 100), recorded)


def test_a_sweep_of_a_periodic_component_is_known_while_it_answers_in_its_period() -> None:
    run = a_run(every="100 ms", timeout="1 s", until=SampleCount(samples=50))

    found = bounds(an_experiment(run), method=Sweep(reserves=(10, 20, 30)))

    assert (found.least_settings, found.most_settings) == (3, 3)
    assert (found.least_ms, found.most_ms) == (15_000, 15_000)


def test_what_is_recorded_is_not_run_again() -> None:
    found = bounds(an_experiment(a_run()), a_setting(20), method=Sweep(reserves=(10, 20, 30)))

    assert (found.least_settings, found.most_settings) == (2, 2)


def test_jobs_one_after_the_other_are_as_fast_as_the_fastest_recorded() -> None:
    run = a_run(timeout="1 s", until=SampleCount(samples=100))
    slow, fast = a_series("member-0", [400.0] * 50), a_series("member-0", [80.0] * 50)

    found = bounds(an_experiment(run), a_setting(10, slow), a_setting(90, fast), method=Sweep(reserves=(10, 50, 90)))

    assert (found.least_ms, found.most_ms) == (8_000, 100_000)
    assert bounds(an_experiment(run), method=Sweep(reserves=(50,))).least_ms == 0, (
        "nothing is known of how fast they are"
    )


@pytest.mark.parametrize("method", [SEARCH, Sweep(reserves=(30,))])
def test_settings_take_what_earlier_ones_took_with_all_their_tries(method: Method) -> None:
    earlier = [replace(a_setting(reserve), spent_ms=spent) for reserve, spent in ((10, 90_000.0), (20, 30_000.0))]

    found = bounds(an_experiment(a_run(every="100 ms")), *earlier, method=method)

    assert (found.least_ms, found.most_ms) == (30_000 * found.least_settings, 90_000 * found.most_settings)
    assert found.measured == 2


def test_a_setting_that_lasts_a_time_lasts_that_and_one_job_more() -> None:
    run = a_run(timeout="2 s", until=Elapsed(time=milliseconds("20 s")))

    found = bounds(an_experiment(run), method=Sweep(reserves=(50,)))

    assert (found.least_ms, found.most_ms) == (20_000, 22_000)


@pytest.mark.parametrize(
    ("apt", "each_ms"),
    [
        ({"mean_response_time": at_most(50), "maximum_response_time": at_most(400)}, 400),
        ({"throughput": at_least(10)}, 100),
        ({"success_rate": at_least(95)}, 1000),
        ({"mean_response_time": at_most(3000)}, 1000),
    ],
)
def test_jobs_take_what_thresholds_allow_or_their_timeout(apt: dict[str, Threshold], each_ms: int) -> None:
    run = a_run(timeout="1 s", until=SampleCount(samples=100))

    found = bounds(an_experiment(run, apt=apt), method=Sweep(reserves=(20, 40)))

    assert found.most_ms == 2 * 100 * each_ms
    assert found.by_timeout == (each_ms == 1000)


def test_members_that_run_together_end_with_the_slowest() -> None:
    quick = a_run(every="10 ms", timeout="10 ms", until=SampleCount(samples=50))
    slow = a_run(every="100 ms", timeout="100 ms", until=SampleCount(samples=50))

    found = bounds(an_experiment(quick, slow), method=Sweep(reserves=(50,)))

    assert (found.least_ms, found.most_ms) == (5_000, 5_000)


@pytest.mark.parametrize(
    ("strategy", "most", "least_ms", "each_ms"),
    [("paper", 10, 4_000, 20_000), ("default", 8, 20_000, 600_000)],
)
def test_a_search_asks_for_one_setting_at_least(strategy: str, most: int, least_ms: int, each_ms: int) -> None:
    """The paper's may end at its first look, and ends at `until`; else that is where it begins to be judged."""
    run = a_run(every="100 ms", timeout="1 s", until=SampleCount(samples=200))

    found = bounds(an_experiment(run), method=Search(strategy=strategy))

    assert (found.least_settings, found.most_settings) == (1, most)
    assert (found.least_ms, found.most_ms) == (least_ms, most * each_ms)


def test_a_search_takes_as_many_samples_as_its_thresholds_need() -> None:
    run = a_run(every="100 ms", timeout="1 s")

    found = bounds(an_experiment(run, apt={"p99_response_time": at_most(80)}), method=Search())

    assert found.least_ms == 83_300


def beside_three_loads(run: Run, budget_ms: float) -> list[Experiment]:
    component = a_component("loop", run=run, apt={"p95_response_time": at_most(12)}, simulation=a_simulation())
    system = a_system(components=[component])
    experiments = experiments_of(system, system.hosts["onboard"], ("loop",), ("busy-loop", "bursts-20", "bursts-100"))
    return [replace(each, budget=Budget(most_ms=budget_ms)) for each in experiments]


def test_a_load_leaves_of_the_budget_what_those_after_it_need_and_has_what_those_before_left() -> None:
    """164 samples and, beside the busy loop, 29 further starts of 0.5 s; each settles for 3 s."""
    busy, _, last = beside_three_loads(a_run(every="20 ms"), 40_000.0)
    last = replace(last, budget=replace(last.budget, spent_ms={23: 30_000.0, 24: 39_000.0}))

    assert with_part_of_budget(busy, 100.0).budget.at(23) == pytest.approx(40_000 - 2 * 6_280)
    parts = with_part_of_budget(last, 100.0).budget
    assert [parts.at(reserve) for reserve in (23, 24, 25)] == pytest.approx([10_000, 6_280, 40_000])
    assert expected_duration(busy, settings_to_run(SEARCH, (), 100), window_ms=100.0).least_ms == 20_780


def test_a_budget_that_is_too_short_is_shared_as_the_loads_need_it() -> None:
    budgets = [with_part_of_budget(each, 100.0).budget for each in beside_three_loads(a_run(every="20 ms"), 16_670.0)]

    assert [budget.least_ms for budget in budgets] == pytest.approx([10_390, 3_140, 3_140])
    assert budgets[0].most_ms == pytest.approx(budgets[0].least_ms)


@pytest.mark.parametrize(
    ("milliseconds_", "text"),
    [(40, "0.04 s"), (25_000, "25 s"), (420_000, "7 min"), (7_200_000, "2 h"), (9_600_000, "2 h 40 min")],
)
def test_a_duration_is_told_in_the_unit_that_fits(milliseconds_: float, text: str) -> None:
    assert show_duration(milliseconds_) == text


def test_the_first_setting_may_show_only_how_many_processors_are_used() -> None:
    for method in (Search(), Sweep(reserves=(40, 50))):
        plain, shows = (settings_to_run(method, (), 100, shows_processors=each) for each in (False, True))
        assert shows.most == plain.most + 1
    paper = Search(strategy="paper")
    assert settings_to_run(paper, (), 100, shows_processors=True) == settings_to_run(paper, (), 100)
