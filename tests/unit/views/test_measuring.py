from dataclasses import replace
from fractions import Fraction

from rarms_iac.measuring.setup import experiment_of
from rarms_iac.model.measurement import Sample, Series, Setting
from rarms_iac.model.system import SampleCount
from rarms_iac.views.measuring import MeasuringProgress, done_of
from rarms_iac.views.progress import WRITE_OVER
from tests.builders import a_component, a_run, a_simulation, a_system, at_most

SYSTEM = a_system(
    components=[
        a_component(
            "vision",
            apt={"mean_response_time": at_most(Fraction(100))},
            run=a_run(until=SampleCount(samples=200)),
            simulation=a_simulation(),
        )
    ]
)
EXPERIMENT = experiment_of(SYSTEM, SYSTEM.hosts["onboard"], ("vision",), "busy-loop")


def a_series(count: int) -> Series:
    samples = tuple(Sample(began_ms=100.0 * at, response_ms=97.0 + at % 3, successful=True) for at in range(count))
    return Series(component="vision", samples=samples, elapsed_ms=100.0 * count)


def told(*, lively: bool, width: int = 100) -> str:
    """What is written about one setting that is looked at once, four seconds after it began."""
    written: list[str] = []
    times = iter([0.0, 4.0, 8.0])
    progress = MeasuringProgress(written.append, lambda: next(times), lively=lively, width=width)
    progress.experiment_started(EXPERIMENT, ())
    progress.setting_started(EXPERIMENT, 62, 1)
    progress.looked(EXPERIMENT, 62, {"vision": a_series(50)})
    if not lively:
        next(times)
    progress.setting_ended(EXPERIMENT, Setting(reserve=62, series=(a_series(100),), beside=38))
    progress.experiment_ended()
    return "".join(written)


def test_a_pipe_is_told_whole_lines_and_nothing_twice() -> None:
    assert told(lively=False).splitlines() == [
        "vision on onboard against busy-loop",
        "   62 %  100 samples, mean_response_time 98 ms (97.8 to 98.2 ms), in 8.0 s",
    ]


def test_a_terminal_sees_the_running_setting_and_how_long_it_may_take() -> None:
    lines = told(lively=True).split(WRITE_OVER)

    assert lines[1] == "   62 %  ..."
    assert lines[2] == "   62 %  50 samples, mean 98 ms, at most 12 s left"
    assert lines[3].startswith("   62 %  100 samples")


def test_a_narrow_terminal_sees_the_time_left_before_the_rest() -> None:
    line = told(lively=True, width=38).split(WRITE_OVER)[2]

    assert line == "   62 %  50 sample, at most 12 s left"


def test_of_several_components_each_value_says_whose_it_is() -> None:
    apt = {"mean_response_time": at_most(Fraction(100))}
    run = a_run(until=SampleCount(samples=200))
    system = a_system(
        components=[a_component(name, apt=apt, run=run, simulation=a_simulation()) for name in ("speech", "vision")]
    )
    both = experiment_of(system, system.hosts["onboard"], ("speech", "vision"), "busy-loop")
    series = (replace(a_series(100), component="speech"), a_series(100))
    written: list[str] = []

    MeasuringProgress(written.append, lambda: 0.0, lively=False, width=100).setting_ended(
        both, Setting(reserve=62, series=series, beside=38)
    )

    said = " ".join("".join(written).split())
    assert "speech mean_response_time 98 ms (97.8 to 98.2 ms); vision mean_response_time 98 ms" in said


def test_what_is_done_is_told_by_the_component_that_takes_longest() -> None:
    assert done_of(EXPERIMENT, {"vision": a_series(50)}) == 0.25
