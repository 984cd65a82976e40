"""How long measuring will take: the forecast, the budget of each load, and the rest by what settings took so far."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import accumulate, cycle
from pathlib import Path

import pytest

from rarms_iac.app.control import MeasuringReporter, RemainingSettings
from rarms_iac.measuring.duration import (
    Announced,
    WallTimes,
    describe_settings,
    least_ms,
    settings_to_run,
    time_of_settings,
    with_part_of_budget,
)
from rarms_iac.measuring.strategies import Method, Search, SettingCount, Sweep
from rarms_iac.model.experiment import Budget, Experiment, experiment_of, experiments_of
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.run import Elapsed, Run, SampleCount
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import Threshold
from rarms_iac.texts.quantities import show_duration
from tests.builders import a_component, a_host, a_run, a_simulation, a_system, at_most, milliseconds
from tests.builders_measured import a_series, a_setting
from tests.unit.measuring.bench import Bench

SEARCH = Search()


def an_experiment(*runs: Run, apt: Mapping[str, Threshold] | None = None) -> Experiment:
    components = [
        a_component(f"member-{number}", run=run, apt=apt, simulation=a_simulation()) for number, run in enumerate(runs)
    ]
    system = a_system(components=components)
    return experiment_of(system, system.hosts["onboard"], tuple(system.components), "busy-loop")


def told(experiment: Experiment, *recorded: Setting, method: Method = SEARCH, seconds: Sequence[float] = ()) -> str:
    """What is said of the settings and their time, on a host that is not simulated."""
    real = replace(experiment, host=replace(experiment.host, provider=ProviderKind.LINUX))
    count = settings_to_run(method, recorded, 100)
    line = describe_settings(real, count, time_of_settings(real, count, recorded, seconds, 0.0))
    return line.partition("onboard: ")[2].removesuffix(".")


PERIODIC = a_run(every="100 ms", timeout="1 s", until=SampleCount(samples=50))
SWEEP = Sweep(reserves=(10, 20, 30))
TRIED = [replace(a_setting(reserve), spent_ms=spent) for reserve, spent in ((10, 90_000.0), (20, 30_000.0))]
SLOW, FAST = a_series("member-0", [400.0] * 50), a_series("member-0", [80.0] * 50)


@pytest.mark.parametrize(
    ("run", "method", "recorded", "expected"),
    [
        (PERIODIC, SWEEP, (), "3 settings, at least 15 s"),
        (PERIODIC, SWEEP, (a_setting(20),), "2 settings, at least 10 s"),
        (PERIODIC, SWEEP, TRIED, "1 setting, 30 s to about 90 s"),
        (a_run(until=SampleCount(samples=100)), SWEEP, (), "3 settings"),
        (
            a_run(until=SampleCount(samples=100)),
            SWEEP,
            (a_setting(10, SLOW), a_setting(20, FAST)),
            "1 setting, at least 8 s",
        ),
        (a_run(until=Elapsed(time=milliseconds("20 s"))), SWEEP, (), "3 settings, at least 60 s"),
        (PERIODIC, Search(strategy="paper"), (), "1 to 10 settings, at least 4 s"),
        (PERIODIC, SEARCH, (), "1 to 8 settings, 5 s to about 1 h 20 min"),
    ],
)
def test_the_forecast_has_settings_and_time(
    run: Run, method: Method, recorded: Sequence[Setting], expected: str
) -> None:
    assert told(an_experiment(run), *recorded, method=method) == expected


def test_the_forecast_knows_samples_members_and_command() -> None:
    quick, slow = (a_run(every=every, until=SampleCount(samples=50)) for every in ("10 ms", "100 ms"))
    many = an_experiment(a_run(every="100 ms"), apt={"p99_response_time": at_most(80)})

    assert told(an_experiment(quick, slow), method=SWEEP) == "3 settings, at least 15 s"
    assert told(many).startswith("1 to 8 settings, 83 s to about ")
    assert told(many, method=SWEEP, seconds=(2.0, 3.0)) == "3 settings, 6 s to about 9 s"


def beside_three_loads(run: Run, budget_ms: float) -> list[Experiment]:
    component = a_component("loop", run=run, apt={"p95_response_time": at_most(12)}, simulation=a_simulation())
    system = a_system(components=[component])
    experiments = experiments_of(system, system.hosts["onboard"], ("loop",), ("busy-loop", "bursts-20", "bursts-100"))
    return [replace(each, budget=Budget(most_ms=budget_ms)) for each in experiments]


def test_load_leaves_budget_to_later_ones() -> None:
    """164 samples and, beside the busy loop, 29 further starts of 0.5 s; each settles for 3 s."""
    busy, _, last = beside_three_loads(a_run(every="20 ms"), 40_000.0)
    last = replace(last, budget=replace(last.budget, spent_ms={23: 30_000.0, 24: 39_000.0}))

    assert with_part_of_budget(busy, 100.0).budget.at(23) == pytest.approx(40_000 - 2 * 6_280)
    parts = with_part_of_budget(last, 100.0).budget
    assert [parts.at(reserve) for reserve in (23, 24, 25)] == pytest.approx([10_000, 6_280, 40_000])
    assert least_ms(busy, busy.load, 100.0) == pytest.approx(20_780)


def test_short_budget_is_shared_by_need() -> None:
    budgets = [with_part_of_budget(each, 100.0).budget for each in beside_three_loads(a_run(every="20 ms"), 16_670.0)]

    assert [budget.least_ms for budget in budgets] == pytest.approx([10_390, 3_140, 3_140])
    assert budgets[0].most_ms == pytest.approx(budgets[0].least_ms)


@pytest.mark.parametrize(
    ("milliseconds_", "text"),
    [(40, "0.04 s"), (25_000, "25 s"), (420_000, "7 min"), (7_200_000, "2 h"), (9_600_000, "2 h 40 min")],
)
def test_duration_is_told_in_unit_that_fits(milliseconds_: float, text: str) -> None:
    assert show_duration(milliseconds_) == text


def test_first_setting_may_show_only_processors() -> None:
    for method in (Search(), Sweep(reserves=(40, 50))):
        plain, shows = (settings_to_run(method, (), 100, shows_processors=each) for each in (False, True))
        assert shows.most == plain.most + 1
    paper = Search(strategy="paper")
    assert settings_to_run(paper, (), 100, shows_processors=True) == settings_to_run(paper, (), 100)


FOUR = SettingCount(least=0, most=4, ends_early=True)
SYSTEM = a_system(
    components=[
        a_component(
            name,
            apt={"mean_response_time": at_most(84)},
            run=a_run(until=SampleCount(samples=100)),
            simulation=a_simulation(work="40 ms", varies="2 %"),
        )
        for name in ("speech", "vision")
    ]
)


def experiment(name: str) -> Experiment:
    return experiment_of(SYSTEM, SYSTEM.hosts["onboard"], (name,), "busy-loop")


class Listener(MeasuringReporter):
    """Keeps what is left, at each start and end of a setting."""

    def __init__(self) -> None:
        self.heard: list[RemainingSettings | None] = []

    def setting_started(
        self, experiment: Experiment, reserve: ReservePercent, remaining: RemainingSettings | None
    ) -> None:
        self.heard.append(remaining)

    def setting_ended(self, experiment: Experiment, setting: Setting, remaining: RemainingSettings | None) -> None:
        self.heard.append(remaining)


def clock_of(*settings: float) -> Iterator[float]:
    """Seconds at the start and the end of each setting: this one takes so long, and nothing passes between."""
    return accumulate(taken for seconds in cycle(settings) for taken in (0.0, seconds))


def test_remaining_time_follows_from_earlier_settings(tmp_path: Path) -> None:
    listener = Listener()
    times = WallTimes(clock=clock_of(2.0, 4.0, 9.0).__next__)

    Bench(tmp_path, experiment("vision")).measure(
        Sweep(reserves=(40, 50, 60)),
        count=SettingCount(least=3, most=3, ends_early=False),
        reporter=listener,
        wall_times=times,
    )

    assert listener.heard == [
        None,
        RemainingSettings(least=2, most=2, setting_seconds=2.0),
        RemainingSettings(least=2, most=2, setting_seconds=2.0),
        RemainingSettings(least=1, most=1, setting_seconds=3.0),
        RemainingSettings(least=1, most=1, setting_seconds=3.0),
        RemainingSettings(least=0, most=0, setting_seconds=5.0),
    ]


def test_recorded_settings_are_equal_on_a_slow_machine(tmp_path: Path) -> None:
    logs = []
    for speed in (0.1, 70.0):
        folder, times = tmp_path / str(speed), WallTimes(clock=clock_of(speed).__next__)
        bench = Bench(folder, experiment("vision"))
        bench.measure(Sweep(reserves=(40, 50)), wall_times=times)
        logs.append(bench.book.known.runs)

    assert logs[0] == logs[1]


@pytest.mark.parametrize(("provider", "tells"), [(ProviderKind.SIMULATED, True), (ProviderKind.LINUX, False)])
def test_other_component_tells_nothing_unless_simulated(provider: ProviderKind, tells: bool) -> None:
    host = a_host(provider=provider)
    speech, vision = (replace(experiment(name), host=host) for name in ("speech", "vision"))
    times = WallTimes()
    times.add(speech, 3.0)

    expected = RemainingSettings(least=1, most=4, setting_seconds=3.0)
    assert times.remaining(vision, FOUR, 0, running=1) == (expected if tells else None)
    elsewhere = replace(vision, host=replace(host, name="spare"))
    assert times.remaining(elsewhere, FOUR, 0, running=1) == (expected if tells else None), (
        "this machine simulates both hosts"
    )

    times.add(vision, 7.0)

    assert times.remaining(vision, FOUR, 0, running=1) == replace(expected, setting_seconds=7.0)


def test_passed_bound_is_said_once() -> None:
    said: list[str] = []
    announced = Announced(work="The proof on onboard", most_ms=20 * 60_000, say=said.append)
    announced.add(15 * 60_000)
    announced.look(5 * 60_000)
    assert said == []

    announced.look(6 * 60_000)
    announced.add(11 * 60_000)

    assert said == ["The proof on onboard takes longer than the announced 20 min."]
