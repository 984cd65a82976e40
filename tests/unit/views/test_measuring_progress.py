from dataclasses import replace
from fractions import Fraction
from io import StringIO

from rarms_iac.measuring.setup import Experiment, experiment_of
from rarms_iac.model.measurement import Sample, Series, Setting
from rarms_iac.model.system import SampleCount
from rarms_iac.views.console import LiveTable, live_console, render
from rarms_iac.views.measure import MeasuringProgress, share_done
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


SETTING = Setting(reserve=62, series=(a_series(100),), beside=38)


def written(
    *, seconds_since_start: float, experiment: Experiment = EXPERIMENT, setting: Setting = SETTING
) -> list[str]:
    """The lines of a pipe about a setting that ends so long after the command began."""
    lines: list[str] = []
    now = [0.0]
    progress = MeasuringProgress(lambda line: lines.append(render(line, 200)), lambda: now[0])
    progress.experiment_started(experiment, ())
    progress.setting_started(experiment, 62, 1)
    now[0] = seconds_since_start
    progress.setting_ended(experiment, setting)
    progress.experiment_ended()
    return lines


def test_a_pipe_is_told_of_a_setting_where_the_last_line_is_long_ago() -> None:
    assert written(seconds_since_start=1.0) == []
    assert written(seconds_since_start=32.0) == [
        "vision at 62 %: 100 samples, mean_response_time 98 ms (97.8 to 98.2 ms), in 32 s\n"
    ]


def test_a_terminal_sees_the_running_setting_and_how_long_it_may_take() -> None:
    screen = StringIO()
    times = iter([0.0, 0.0, 4.0])
    live = LiveTable(live_console(screen, 100, colour=False))
    progress = MeasuringProgress(lambda _: None, lambda: next(times), live)

    progress.experiment_started(EXPERIMENT, ())
    progress.setting_started(EXPERIMENT, 62, 1)
    progress.looked(EXPERIMENT, 62, {"vision": a_series(50)})
    shown = screen.getvalue()
    progress.experiment_ended()

    assert "vision  62 %  ..." in shown
    assert "vision  62 %  50 samples, mean_response_time 98 ms, at most 12 s left" in shown
    assert screen.getvalue().endswith(("\x1b[?25h", "\x1b[1A\x1b[2K")), "the cursor is back, the table is gone"


def test_of_several_components_each_value_says_whose_it_is() -> None:
    apt = {"mean_response_time": at_most(Fraction(100))}
    run = a_run(until=SampleCount(samples=200))
    system = a_system(
        components=[a_component(name, apt=apt, run=run, simulation=a_simulation()) for name in ("speech", "vision")]
    )
    both = experiment_of(system, system.hosts["onboard"], ("speech", "vision"), "busy-loop")
    series = (replace(a_series(100), component="speech"), a_series(100))

    [line] = written(seconds_since_start=60, experiment=both, setting=Setting(reserve=62, series=series, beside=38))

    assert "speech mean_response_time 98 ms (97.8 to 98.2 ms); vision mean_response_time 98 ms" in line


def test_what_is_done_is_told_by_the_component_that_takes_longest() -> None:
    assert share_done(EXPERIMENT, {"vision": a_series(50)}) == 0.25
