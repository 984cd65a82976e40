"""The summary of `rarms measure`: what is known of the setting below, what was not begun, and what the errors mean."""

from dataclasses import replace
from fractions import Fraction
from io import StringIO

import pytest

from rarms_iac.app.control import RemainingSettings
from rarms_iac.measuring.measure import MeasureOutcome
from rarms_iac.measuring.measure_request import ExperimentResult
from rarms_iac.model.experiment import Experiment, experiment_of
from rarms_iac.model.indexes import index_named, threshold_of
from rarms_iac.model.outcomes import Stopped, Sufficient, Swept
from rarms_iac.model.run import SampleCount
from rarms_iac.model.series import Sample, Series
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import System
from rarms_iac.views.console import live_console, render
from rarms_iac.views.json_output import json_of
from rarms_iac.views.measure import summary_text
from rarms_iac.views.progress import MeasuringProgress, share_done
from rarms_iac.views.table import LiveLine
from tests.builders import a_component, a_run, a_simulation, a_system, at_most
from tests.builders_measured import a_series, a_setting
from tests.robots import a_measured_setting
from tests.unit.views.test_json import check

RUN, DEMAND = a_run(), a_simulation()
SYSTEM: System = a_system(
    components=[
        a_component("speech", criticality=5, apt={"mean_response_time": at_most(90)}, run=RUN, simulation=DEMAND),
        a_component("vision", criticality=9, apt={"mean_response_time": at_most(100)}, run=RUN, simulation=DEMAND),
    ]
)


def an_experiment(name: str) -> Experiment:
    return experiment_of(SYSTEM, SYSTEM.hosts["onboard"], (name,), "busy-loop")


def at(reserve: int, mean: float) -> Setting:
    """200 jobs around this mean, with 5 % of noise: the interval is 0.7 % to each side."""
    return a_setting(reserve, *a_measured_setting("vision", reserve, lambda _: mean).series)


def found(mean_below: float) -> ExperimentResult:
    """Enough at 60 %, with this mean at 59 %, where the APT is 100 ms."""
    return ExperimentResult(
        experiment=an_experiment("vision"),
        conclusion=Sufficient(reserve=60, failed=59),
        settings=(at(59, mean_below), at(60, 95.0)),
        run_now=frozenset({59, 60}),
        planned=None,
        log="measurements/onboard/vision/busy-loop.jsonl",
    )


def outcome_of(result: ExperimentResult) -> MeasureOutcome:
    return MeasureOutcome(experiments=(result,), findings=())


def text(results: list[ExperimentResult], waiting: list[Experiment] | None = None) -> str:
    outcome = MeasureOutcome(experiments=tuple(results), findings=(), not_begun=tuple(waiting or ()))
    return render(summary_text(outcome, verbose=True), 120)


def test_a_setting_below_that_misses_is_not_enough() -> None:
    assert "1.18 LP too little" in text([found(105.0)])
    assert '"undecided": false' in json_of(outcome_of(found(105.0)))


def test_threshold_and_value_keep_unit_of_manifest() -> None:
    apt = {"mean_response_time": replace(at_most(100), unit="s")}
    system = a_system(components=[a_component("vision", criticality=9, apt=apt, run=RUN, simulation=DEMAND)])
    result = replace(found(105.0), experiment=experiment_of(system, system.hosts["onboard"], ("vision",), "busy-loop"))

    assert threshold_of(index_named("mean_response_time"), "0.1 s").unit == "s"
    assert "mean <= 0.1 s  0.0948 s" in text([result])


def test_undecided_lower_setting_is_within_noise() -> None:
    summary = text([found(100.2)])

    assert "1.18 LP not clear" in summary
    assert "too little" not in summary
    assert '"undecided": true' in json_of(outcome_of(found(100.2)))


def test_setting_below_without_steady_state_is_called_so() -> None:
    drifting = a_setting(59, a_series("vision", [80.0 + at / 4 for at in range(200)]))

    assert "1.18 LP unsteady" in text([replace(found(105.0), settings=(drifting, at(60, 95.0)))])


def test_unsteady_settings_are_told_beside_failures() -> None:
    drifting = a_setting(57, a_series("vision", [80.0 + at / 4 for at in range(200)]))
    member = replace(
        found(105.0),
        conclusion=Sufficient(reserve=60, failed=55, inconclusive=(56, 57)),
        settings=(at(55, 105.0), replace(drifting, reserve=56), drifting, at(60, 95.0)),
    )
    alone = replace(member, conclusion=Sufficient(reserve=60, failed=None, inconclusive=(57,)))

    assert "1.1 LP too little; 1.12 LP and 1.14 LP unsteady" in " ".join(text([member]).split())
    assert "vision: 60 % of its 2 VPs; 1.14 LP unsteady." in text([alone])
    assert '"inconclusive": [\n        56,\n        57\n' in json_of(outcome_of(member))
    check(json_of(outcome_of(member)))


def test_early_end_says_remaining_settings() -> None:
    result = replace(found(105.0), conclusion=Sufficient(reserve=60, failed=51, more_settings=8))

    assert "vision: run the same command to narrow it, up to 8 settings more" in " ".join(text([result]).split())
    assert '"more_settings": 8' in json_of(outcome_of(result))
    check(json_of(outcome_of(result)))


def test_unspent_saving_is_named() -> None:
    result = replace(found(105.0), conclusion=Sufficient(reserve=60, failed=51, down_to=52))

    assert "Could be down to 1.04 LP for vision." in " ".join(text([result]).split())
    assert '"down_to_lp": 1.04' in json_of(outcome_of(result))
    check(json_of(outcome_of(result)))


def test_errors_are_explained_below_verdicts_only() -> None:
    stopped = ExperimentResult(
        experiment=an_experiment("vision"),
        conclusion=Stopped(),
        settings=(),
        run_now=frozenset(),
        planned=None,
        log="x",
    )

    assert "99 % confidence each." in text([found(105.0)])
    assert "confidence" not in text([stopped])
    assert text([stopped]).endswith("Stopped before the first setting had ended.\n")


def test_a_search_that_was_stopped_promises_no_plan() -> None:
    """Other loads may not be measured yet, and then `plan` refuses."""
    stopped = replace(found(105.0), conclusion=Stopped(), planned=60)

    summary = " ".join(text([stopped]).split())

    assert "vision: stopped; 1.2 LP meets the threshold so far." in summary
    assert "a plan reserves" not in summary
    assert "Measured: 1 component, 2 settings so far." in summary
    assert "Next:" not in summary
    assert "vision: stopped; 1.2 LP is from an earlier run." in " ".join(
        text([replace(stopped, run_now=frozenset())]).split()
    )


def test_maximum_has_no_known_error() -> None:
    longest = {"maximum_response_time": at_most(500)}
    system = a_system(components=[a_component("vision", criticality=9, apt=longest, run=RUN, simulation=DEMAND)])
    outcome = replace(found(105.0), experiment=experiment_of(system, system.hosts["onboard"], ("vision",), "busy-loop"))

    summary = text([outcome])

    assert "A maximum or minimum is met so far." in summary
    assert "confidence" not in summary


def test_maximum_is_met_so_far() -> None:
    apt = {"maximum_response_time": at_most(500), "mean_response_time": at_most(500)}
    system = a_system(components=[a_component("vision", criticality=9, apt=apt, run=RUN, simulation=DEMAND)])
    outcome = replace(found(105.0), experiment=experiment_of(system, system.hosts["onboard"], ("vision",), "busy-loop"))

    assert "99 % confidence each; a maximum or minimum is met so far." in text([outcome])


def test_whose_turn_early_end_left_out_is_named() -> None:
    summary = text([found(105.0)], [an_experiment("speech")])
    document = json_of(MeasureOutcome(experiments=(found(105.0),), findings=(), not_begun=(an_experiment("speech"),)))

    assert [line.split()[0] for line in summary.splitlines()[1:3]] == ["vision", "speech"]
    assert "speech: not begun." in summary
    check(document)
    assert '"not_begun": [\n    "speech"' in document


ONE_COMPONENT = a_system(
    components=[
        a_component(
            "vision",
            apt={"mean_response_time": at_most(Fraction(100))},
            run=a_run(until=SampleCount(samples=200)),
            simulation=a_simulation(),
        )
    ]
)
ONE_EXPERIMENT = experiment_of(ONE_COMPONENT, ONE_COMPONENT.hosts["onboard"], ("vision",), "busy-loop")


def series_of(count: int) -> Series:
    samples = tuple(Sample(began_ms=100.0 * at, response_ms=97.0 + at % 3, successful=True) for at in range(count))
    return Series(component="vision", samples=samples, elapsed_ms=100.0 * count)


SETTING = Setting(reserve=62, series=(series_of(100),), beside=38)


def written(
    *,
    seconds_since_start: float,
    experiment: Experiment = ONE_EXPERIMENT,
    setting: Setting = SETTING,
    after: RemainingSettings | None = None,
) -> list[str]:
    """The lines of a pipe about a setting that ends so long after the command began."""
    lines: list[str] = []
    now = [0.0]
    progress = MeasuringProgress(lambda line: lines.append(render(line, 200)), lambda: now[0])
    progress.experiment_started(experiment, ())
    progress.setting_started(experiment, 62, None)
    now[0] = seconds_since_start
    progress.setting_ended(experiment, setting, after)
    progress.experiment_ended()
    return lines


def test_pipe_hears_of_a_setting_after_silence() -> None:
    assert written(seconds_since_start=1.0) == []
    assert written(seconds_since_start=32.0) == [
        "vision with busy-loop at 1.24 LP: 100 samples, mean_response_time 98 ms (89.1 to 106.9 ms), in 32 s\n"
    ]


def test_pipe_hears_of_a_long_setting() -> None:
    lines: list[str] = []
    times = iter([0.0, 0.0, 59.0, 61.0, 90.0])
    progress = MeasuringProgress(lambda line: lines.append(render(line, 200)), lambda: next(times))

    progress.setting_started(ONE_EXPERIMENT, 62, None)
    for _ in range(3):
        progress.samples_came(ONE_EXPERIMENT, 62, {"vision": series_of(50)})

    assert lines == ["vision with busy-loop at 1.24 LP: 50 samples, mean 98 ms, after 61 s, still running\n"]


@pytest.mark.parametrize(
    ("least", "most", "text"),
    [
        (0, 3, ", at most about 36 s left"),
        (2, 2, ", about 24 s left"),
        (1, 3, ", 12 s to about 36 s left"),
        (0, 0, ""),
    ],
)
def test_setting_says_how_long_the_rest_takes(least: int, most: int, text: str) -> None:
    after = RemainingSettings(least=least, most=most, setting_seconds=12.0)

    (line,) = written(seconds_since_start=32.0, after=after)

    assert line.endswith(f", in 32 s{text}\n")


@pytest.mark.parametrize(("now", "text"), [(4.0, "8 s to about 44 s left"), (40.0, "at most about 36 s left")])
def test_running_setting_counts_down_by_those_before_it(now: float, text: str) -> None:
    screen = StringIO()
    times = iter([0.0, 0.0, now])
    progress = MeasuringProgress(lambda _: None, lambda: next(times), LiveLine(live_console(screen, 100, colour=False)))

    progress.setting_started(ONE_EXPERIMENT, 62, RemainingSettings(least=1, most=4, setting_seconds=12.0))
    progress.samples_came(ONE_EXPERIMENT, 62, {"vision": series_of(50)})
    shown = screen.getvalue()
    progress.experiment_ended()

    assert f"vision  busy-loop  1.24 LP  {text}, mean 98 ms, 50 samples" in shown


def test_repeated_setting_says_what_it_adds() -> None:
    lines: list[str] = []
    times = iter([0.0, 0.0, 12.0, 12.4])
    progress = MeasuringProgress(lambda line: lines.append(render(line, 200)), lambda: next(times))

    progress.setting_started(ONE_EXPERIMENT, 62, None)
    for _ in range(2):
        progress.setting_disturbed(ONE_EXPERIMENT, 62, "the load got less")

    again = "vision with busy-loop at 1.24 LP is measured again, because it was disturbed: the load got less."
    assert lines == [f"{again} This adds about 12 s.\n", f"{again}\n"]


def test_terminal_sees_the_running_setting() -> None:
    screen = StringIO()
    times = iter([0.0, 0.0, 4.0])
    live = LiveLine(live_console(screen, 100, colour=False))
    progress = MeasuringProgress(lambda _: None, lambda: next(times), live)

    progress.experiment_started(ONE_EXPERIMENT, ())
    progress.setting_started(ONE_EXPERIMENT, 62, None)
    progress.samples_came(ONE_EXPERIMENT, 62, {"vision": series_of(50)})
    shown = screen.getvalue()
    progress.experiment_ended()

    assert "vision  busy-loop  1.24 LP  ..." in shown
    assert "vision  busy-loop  1.24 LP  at most 476 s left in this setting, mean 98 ms, 50 samples" in shown
    assert screen.getvalue().endswith(("\x1b[?25h", "\x1b[1A\x1b[2K")), "the cursor is back, the table is gone"


def test_values_name_their_component() -> None:
    apt = {"mean_response_time": at_most(Fraction(100))}
    run = a_run(until=SampleCount(samples=200))
    system = a_system(
        components=[a_component(name, apt=apt, run=run, simulation=a_simulation()) for name in ("speech", "vision")]
    )
    both = experiment_of(system, system.hosts["onboard"], ("speech", "vision"), "busy-loop")
    series = (replace(series_of(100), component="speech"), series_of(100))

    [line] = written(seconds_since_start=60, experiment=both, setting=Setting(reserve=62, series=series, beside=38))

    assert "speech mean_response_time 98 ms (89.1 to 106.9 ms); vision mean_response_time 98 ms" in line


def test_slowest_component_tells_progress() -> None:
    assert share_done(ONE_EXPERIMENT, 30, {"vision": series_of(50)}) == pytest.approx(5_000 / 600_000)


def test_sweep_shows_value_bounds_and_verdict() -> None:
    swept = replace(found(105.0), conclusion=Swept(), settings=(at(60, 95.0), at(59, 105.0)))
    rows = [line.split() for line in text([swept]).splitlines()[:4]]

    assert " ".join(rows[0]).startswith("vision with busy-loop on onboard: mean_response_time <= 100 ms.")
    assert rows[1] == ["reservation", "CR", "measured", "bounds", "verdict"]
    assert (rows[2][:6], rows[2][-1]) == (["1.18", "LP", "59", "%", "105.1", "ms"], "missed")
    assert (rows[3][:4], rows[3][-1]) == (["1.2", "LP", "60", "%"], "met")
    assert [row[7] for row in rows[2:]] == ["to", "to"], "the bounds"


def test_deciding_threshold_is_marked() -> None:
    apt = {"mean_response_time": at_most(100), "p95_response_time": at_most(400)}
    system = a_system(components=[a_component("vision", criticality=9, apt=apt, run=RUN, simulation=DEMAND)])
    experiment = experiment_of(system, system.hosts["onboard"], ("vision",), "busy-loop")

    shown = text([replace(found(105.0), experiment=experiment)])

    assert "mean <= 100 ms, decides" in shown
    assert "p95 <= 400 ms " in shown


def test_stopped_first_pass_shows_its_estimate() -> None:
    """A plan reserves by the estimates of the settings so far, which no verdict shows yet."""
    stopped = replace(
        found(105.0), conclusion=Stopped(), is_provisional=True, provisional_lp=Fraction(6, 5), run_now=frozenset({60})
    )

    summary = " ".join(text([stopped]).split())

    assert "vision mean <= 100 ms 94.8 ms 1.2 LP busy-loop" in summary
    assert "vision: stopped; 1.2 LP is the estimate of the settings so far." in summary
    assert "a plan reserves" not in summary
    assert "Measured: 1 component, 2 settings so far, 1 of them by an earlier run." in summary
