"""Estimates of the first pass: fitted percentiles, and the least setting that meets its thresholds by estimates."""

from fractions import Fraction
from math import log
from random import Random

import pytest

from rarms_iac.model.outcomes import Doubt, UncertainEstimate
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import AtLeast, AtMost, Threshold
from rarms_iac.statistics.curves import curve_of
from rarms_iac.statistics.first_look import (
    FEW,
    fitted_percentile,
    is_probable,
    least_estimated,
    point_estimate,
    uncertain_estimates,
)
from tests.builders import a_run, at_least, at_most
from tests.measured import a_series, noisy

RUN = a_run()
MEAN = {"coi": {"mean_response_time": AtMost(value=Fraction(100))}}


def look(reserve: int, mean: float) -> Setting:
    return Setting(reserve=reserve, series=(a_series(noisy(reserve, mean, count=60)),), first_pass=True)


def test_fitted_percentile_is_near_the_truth() -> None:
    found = []
    for seed in range(40):
        chance = Random(seed)
        found.append(fitted_percentile([10.0 + chance.expovariate(0.1) for _ in range(80)], 0.99))

    truth = 10.0 + 10.0 * log(100)
    assert sorted(found)[20] == pytest.approx(truth, rel=0.15)
    assert sorted(found)[4] > 0.6 * truth


@pytest.mark.parametrize("times", [[3.0], [3.0] * 50, [1.0, 2.0]])
def test_fitted_percentile_of_few_or_equal_times(times: list[float]) -> None:
    assert fitted_percentile(times, 0.999) == max(times)


def test_only_percentiles_beyond_the_samples_are_fitted() -> None:
    series = a_series(noisy(1, 50.0, count=100))

    assert [
        found.doubt
        for percent in (90, 95, 99)
        if (found := point_estimate(f"p{percent}_response_time", series, RUN)) is not None
    ] == [None, None, Doubt.TAIL]


def test_few_samples_hardly_show_extremes_and_shares() -> None:
    apt: dict[str, Threshold] = {
        "maximum_response_time": at_most(60),
        "success_rate": at_least(90),
        "mean_response_time": at_most(60),
    }
    few, many = a_series(noisy(1, 50.0, count=100)), a_series(noisy(1, 50.0, count=FEW))

    assert uncertain_estimates([few], {"coi": RUN}, {"coi": apt}) == (
        UncertainEstimate(component="coi", index="maximum_response_time", doubt=Doubt.EXTREME),
        UncertainEstimate(component="coi", index="success_rate", doubt=Doubt.SHARE),
    )
    assert uncertain_estimates([many], {"coi": RUN}, {"coi": apt}) == ()


def test_fitted_percentile_is_no_less_than_samples_show() -> None:
    found = point_estimate("p99_response_time", a_series([50.0] * 85 + [54.0] * 24 + [62.0] * 4), RUN)

    assert found is not None
    assert found.value >= 62.0


def test_least_estimated_meets_with_all_above() -> None:
    rises_once = [look(20, 130.0), look(30, 99.0), look(40, 104.0), look(50, 80.0), look(60, 70.0)]

    assert least_estimated(rises_once, {"coi": RUN}, MEAN) == 50
    assert least_estimated(rises_once[:1], {"coi": RUN}, MEAN) is None
    assert least_estimated(rises_once, {"coi": RUN}, {"coi": {}}) is None


def test_missing_index_meets_nothing() -> None:
    silent = Setting(reserve=50, series=(a_series([None] * 40),), first_pass=True)

    assert least_estimated([silent], {"coi": RUN}, MEAN) is None


def test_curves_have_no_setting_of_the_first_pass() -> None:
    assert curve_of([look(20, 130.0), look(50, 80.0)], "coi", "mean_response_time", RUN).points == ()


def test_setting_ends_once_its_side_is_probable() -> None:
    near, far = a_series([95.0, 106.0] * 20), a_series(noisy(2, 130.0, count=40))

    assert not is_probable(near, MEAN["coi"], RUN)
    assert is_probable(far, MEAN["coi"], RUN)
    assert is_probable(far, {"throughput": AtLeast(value=Fraction(20))}, RUN)
