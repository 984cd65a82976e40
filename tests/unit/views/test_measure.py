"""The summary of `rarms measure`: what is known of the setting below, what was not begun, and what the errors mean."""

from dataclasses import replace

from rarms_iac.app.experiments import ExperimentResult
from rarms_iac.measuring.setup import Experiment, experiment_of
from rarms_iac.model.measurement import Setting
from rarms_iac.model.outcomes import Stopped, Sufficient
from rarms_iac.model.system import System
from rarms_iac.views.console import render
from rarms_iac.views.measure import measure_json, summary_text
from tests.builders import a_component, a_run, a_simulation, a_system, at_most
from tests.builders_measured import a_series, a_setting
from tests.measured_robot import a_measured_setting
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
        conclusion=Sufficient(reserve=60, failed=59, error=0.01),
        settings=(at(59, mean_below), at(60, 95.0)),
        new=2,
        planned=None,
        log="measurements/onboard/vision/busy-loop.jsonl",
    )


def text(results: list[ExperimentResult], waiting: list[Experiment] | None = None) -> str:
    return render(summary_text(results, waiting or []), 120)


def test_a_setting_below_that_misses_is_not_enough() -> None:
    assert "59 % too little" in text([found(105.0)])
    assert '"undecided": false' in measure_json([found(105.0)], ())


def test_a_setting_below_that_the_samples_cannot_tell_is_within_the_noise() -> None:
    summary = text([found(100.2)])

    assert "59 % unresolved" in summary
    assert "too little" not in summary
    assert '"undecided": true' in measure_json([found(100.2)], ())


def test_a_setting_below_without_a_steady_state_is_called_so() -> None:
    drifting = a_setting(59, a_series("vision", [80.0 + at / 4 for at in range(200)]))

    assert "59 % unsteady" in text([replace(found(105.0), settings=(drifting, at(60, 95.0)))])


def test_settings_between_that_have_no_steady_state_are_told_beside_the_one_that_is_not_enough() -> None:
    drifting = a_setting(57, a_series("vision", [80.0 + at / 4 for at in range(200)]))
    one = replace(
        found(105.0),
        conclusion=Sufficient(reserve=60, failed=55, error=0.01, inconclusive=(56, 57)),
        settings=(at(55, 105.0), replace(drifting, reserve=56), drifting, at(60, 95.0)),
    )
    alone = replace(one, conclusion=Sufficient(reserve=60, failed=None, error=0.01, inconclusive=(57,)))

    assert "55 % too little, 56 and 57 % unsteady" in text([one])
    assert "60 %  1.2  57 % unsteady" in text([alone])
    assert '"untold": [\n        56,\n        57\n' in measure_json([one], ())
    check(measure_json([one], ()))


def test_what_the_errors_mean_stands_below_a_verdict_and_nowhere_else() -> None:
    stopped = ExperimentResult(
        experiment=an_experiment("vision"), conclusion=Stopped(), settings=(), new=0, planned=None, log="x"
    )

    assert "A verdict is wrong in at most 1 % of cases" in text([found(105.0)])
    assert "wrong in" not in text([stopped])


def test_of_a_maximum_no_error_is_told_that_nobody_knows() -> None:
    longest = {"maximum_response_time": at_most(500)}
    system = a_system(components=[a_component("vision", criticality=9, apt=longest, run=RUN, simulation=DEMAND)])
    one = replace(found(105.0), experiment=experiment_of(system, system.hosts["onboard"], ("vision",), "busy-loop"))

    summary = text([one])

    assert "is met so far" in summary
    assert "1 % of cases" not in summary


def test_whose_turn_an_early_end_left_out_is_named() -> None:
    summary = text([found(105.0)], [an_experiment("speech")])
    document = measure_json([found(105.0)], (), [an_experiment("speech")])

    assert [line.split()[0] for line in summary.splitlines()[1:3]] == ["vision", "speech"]
    assert "not begun" in summary.splitlines()[2]
    check(document)
    assert '"not_begun": [\n    [\n      "speech"' in document
