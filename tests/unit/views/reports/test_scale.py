"""The upright axis: everything is on it, its grid is decimal and exact, and its labels are few and round."""

from fractions import Fraction
from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.app.report_model import IndexCurve
from rarms_iac.model.indexes import find_index
from rarms_iac.model.quantities import show_number
from rarms_iac.model.system import AtMost
from rarms_iac.statistics.curves import curve_of
from rarms_iac.views.reports.scale import Scale, round_down, scale_of
from tests.builders import a_run
from tests.builders_measured import a_series, a_setting

VALUES = st.floats(min_value=0.001, max_value=1e6)


def what_is_shown(
    values: dict[int, float], threshold: Fraction | None = None, index: str = "mean_response_time"
) -> IndexCurve:
    settings = [a_setting(reserve, a_series(responses=[value] * 3)) for reserve, value in values.items()]
    found = find_index(index)
    assert found is not None
    apt = None if threshold is None else AtMost(value=threshold)
    curve = curve_of(settings, "vision", index, a_run())
    return IndexCurve(component="vision", index=found, threshold=apt, curve=curve, points=())


def the_scale(values: dict[int, float], index: str = "mean_response_time") -> Scale:
    return scale_of(what_is_shown(values, index=index))


@given(st.dictionaries(st.integers(1, 100), VALUES, min_size=1, max_size=6), st.none() | VALUES)
def test_axis_holds_values_threshold_and_grid(values: dict[int, float], threshold: float | None) -> None:
    apt = None if threshold is None else Fraction(str(round(threshold, 3))) or Fraction(1)

    shown = what_is_shown(values, apt)

    scale = scale_of(shown)

    curve = [*(point.value for point in shown.curve.points), *([] if apt is None else [float(apt)])]
    assert scale.low < scale.high
    assert scale.low <= min(curve) + 1e-9
    assert scale.high >= max(curve) - 1e-9
    assert scale.last - scale.first >= 100
    assert scale.low <= scale.first * scale.step <= scale.last * scale.step <= scale.high
    assert [0 <= scale.height(float(tick)) <= 1 for tick in scale.ticks()] == [True] * len(scale.ticks())
    assert 1 <= len(scale.ticks()) <= 12


def test_steep_curve_has_a_logarithmic_axis() -> None:
    assert the_scale({10: 700.0, 70: 88.0}).logarithmic
    assert not the_scale({10: 100.0, 70: 88.0}).logarithmic


def test_high_success_rate_shows_its_upper_end() -> None:
    assert (the_scale({10: 5.0}, index="success_rate").low, the_scale({10: 5.0}, index="success_rate").high) == (
        80,
        100,
    )


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (0.01234, "0.0123"), (88.123, "88.1"), (100.0, "100"), (1234.56, "1234.6"), (inf, "no bound")],
)
def test_three_digits_and_no_exponent(value: float, text: str) -> None:
    assert show_number(value) == text


def test_number_never_reads_as_another_one_beside_it() -> None:
    assert [show_number(value, 300.0) for value in (299.96, 300.04, 300.0, 300.0004, 298.0)] == [
        "299.96",
        "300.04",
        "300",
        "300.0004",
        "298",
    ]


@given(st.floats(min_value=1e-9, max_value=1e9))
def test_round_number_is_just_below(value: float) -> None:
    mantissa, exponent = round_down(value)

    assert mantissa in {1, 2, 5}
    assert value / 2.51 <= mantissa * 10.0**exponent <= value * (1 + 1e-6)
