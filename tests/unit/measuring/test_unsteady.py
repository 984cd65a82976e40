"""What `rarms measure` says of components that have no steady state where their search begins.

On the simulated host a component of one thread has a processor for itself until the load beside it has been kept
waiting for a whole window: at 45 % for about a second, and for ever longer up to 50 %. A component whose jobs are short
is at its end of 200 samples before it is steady.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from rarms_iac.measuring.conclusions import Sufficient
from rarms_iac.measuring.measured import shown_at, steady
from rarms_iac.measuring.measuring import Ended, NoPlaces, Surroundings, measure
from rarms_iac.measuring.reporter import Silent
from rarms_iac.measuring.room import room_of
from rarms_iac.measuring.search import STRATEGIES
from rarms_iac.measuring.setup import Experiment, experiment_of
from rarms_iac.measuring.strategies import Agreeing, Searching, Verifying, goal_of
from rarms_iac.measuring.telling import findings_of
from rarms_iac.model.measurement import Setting
from rarms_iac.model.system import SampleCount
from rarms_iac.providers.simulated.measuring import SimulatedMeasuringHost
from rarms_iac.providers.simulated.scheduling.simulation import simulate
from rarms_iac.statistics.curves import LeastReserve, curves_of, least_reserve
from tests.builders import a_component, a_host, a_run, a_simulation, a_system, at_most


@dataclass
class Notes:
    """A log of settings in memory."""

    kept: list[Setting] = field(default_factory=list)

    def settings(self) -> tuple[Setting, ...]:
        return tuple(self.kept)

    def add(self, setting: Setting) -> None:
        self.kept.append(setting)


def an_experiment(work: str, varies: str, limit: int) -> Experiment:
    component = a_component(
        "coi",
        apt={"mean_response_time": at_most(limit)},
        run=a_run(until=SampleCount(samples=200)),
        simulation=a_simulation(work=work, varies=varies),
        reserve=None,
    )
    system = a_system(components=[component])
    return experiment_of(system, system.hosts["onboard"], ("coi",), "busy-loop")


def searched(experiment: Experiment, folder: Path, strategy: str = "default") -> Ended:
    host = SimulatedMeasuringHost(a_host(), folder / "onboard.json", simulate)
    goal = goal_of(experiment)
    search = Searching(goal=goal, next_step=STRATEGIES[strategy], most=100)
    with host.lock("a test"):
        around = Surroundings(
            host=host,
            room=lambda: room_of(a_host(), host.observe(), "robot"),
            seed=1,
            reporter=Silent(),
            should_stop=lambda: False,
        )
        return measure(experiment, Agreeing(search=search, verifying=Verifying(goal=goal, most=100)), Notes(), around)


def unsteady(settings: tuple[Setting, ...]) -> set[int]:
    return {setting.reserve for setting in settings if any(map(steady, setting.series))}


FAR_BELOW: Mapping[str, tuple[str, str, int, int]] = {
    "15 ms for 100 ms": ("15 ms", "10 %", 100, 15),
    "10 ms for 90 ms": ("10 ms", "10 %", 90, 12),
    "14 ms for 93 ms": ("14 ms", "5 %", 93, 15),
    "16 ms for 80 ms": ("16 ms", "5 %", 80, 20),
}
"""Work, how it varies, threshold in ms, and the CR that the work alone needs."""


@pytest.mark.parametrize("case", FAR_BELOW)
def test_a_first_setting_without_a_steady_state_costs_no_reservation(case: str, tmp_path: Path) -> None:
    work, varies, limit, needed = FAR_BELOW[case]
    experiment = an_experiment(work, varies, limit)
    ended = searched(experiment, tmp_path)

    assert unsteady(ended.settings) == {45}
    assert isinstance(ended.conclusion, Sufficient)
    assert needed <= ended.conclusion.reserve <= needed + 2
    assert ended.conclusion.failed is not None
    assert ended.conclusion.reserve - ended.conclusion.failed <= 3
    assert shown_at(ended.conclusion.failed, ended.settings, experiment) != "no steady state"
    assert ended.conclusion.untold == ()
    assert len(ended.settings) <= 9
    assert list(findings_of(experiment, ended.conclusion, ended.settings, NoPlaces())) == []


def test_once_one_was_unsteady_no_setting_ends_early(tmp_path: Path) -> None:
    ended = searched(an_experiment("15 ms", "10 %", 100), tmp_path)

    assert [len(setting.series[0].samples) for setting in ended.settings] == [200] * len(ended.settings)


def test_where_nothing_close_below_is_steady_it_says_that_it_does_not_know(tmp_path: Path) -> None:
    experiment = an_experiment("15 ms", "10 %", 28)
    ended = searched(experiment, tmp_path)
    end = ended.conclusion

    assert isinstance(end, Sufficient)
    assert end.untold
    assert set(end.untold) <= unsteady(ended.settings)
    assert end.failed not in unsteady(ended.settings)
    assert all((end.failed or 0) < one < end.reserve for one in end.untold)
    (told,) = findings_of(experiment, end, ended.settings, NoPlaces())
    assert told.code == "RARMS267"
    assert f"coi: {end.reserve} % is enough" in told.detail
    assert f"coi at {end.untold[-1]} %: its response times still changed within 200 samples" in told.detail
    assert told.advice == (
        "To find out whether less is enough, measure longer: `rarms measure coi --again --samples 2000`."
    )


@pytest.mark.parametrize("limit", [28, 100])
def test_a_plan_reserves_what_the_search_found(limit: int, tmp_path: Path) -> None:
    experiment = an_experiment("15 ms", "10 %", limit)
    ended = searched(experiment, tmp_path)
    apts = {"coi": experiment.members[0].apt}

    assert isinstance(ended.conclusion, Sufficient)
    assert least_reserve(curves_of(ended.settings, experiment.runs, apts)) == LeastReserve(
        reserve=ended.conclusion.reserve, interpolated=False
    )
