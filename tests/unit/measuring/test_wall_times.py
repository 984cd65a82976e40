"""What is left of an experiment follows the settings of the command, by a clock of this machine."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import accumulate, cycle
from pathlib import Path

import pytest

from rarms_iac.app.control import MeasuringReporter, RemainingSettings
from rarms_iac.measuring.duration import WallTimes
from rarms_iac.measuring.strategies import SettingCount, Sweep
from rarms_iac.model.experiment import Experiment, experiment_of
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.run import SampleCount
from rarms_iac.model.setting import Setting
from tests.builders import a_component, a_host, a_run, a_simulation, a_system, at_most
from tests.unit.measuring.bench import Bench

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


def test_the_rest_follows_from_the_settings_so_far_though_the_host_is_simulated(tmp_path: Path) -> None:
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


def test_a_data_log_is_the_same_on_a_slow_machine(tmp_path: Path) -> None:
    logs = []
    for speed in (0.1, 70.0):
        folder, times = tmp_path / str(speed), WallTimes(clock=clock_of(speed).__next__)
        Bench(folder, experiment("vision")).measure(Sweep(reserves=(40, 50)), wall_times=times)
        (log,) = folder.glob("logs/*")
        logs.append(log.read_bytes())

    assert logs[0] == logs[1]


@pytest.mark.parametrize(("provider", "tells"), [(ProviderKind.SIMULATED, True), (ProviderKind.LINUX, False)])
def test_another_component_tells_nothing_of_this_one_unless_the_host_is_simulated(
    provider: ProviderKind, tells: bool
) -> None:
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
