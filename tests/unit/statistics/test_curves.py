"""The curve: monotone, straight between settings, nothing outside."""

from dataclasses import replace

import pytest

from rarms_iac.model.setting import Setting, join_settings
from rarms_iac.statistics.curves import Curve, components_not_shown, curve_of, highest_missed, holds, least_reserve
from tests.builders import a_run, at_least, at_most
from tests.measured import a_series, noisy

RUN = replace(a_run(), deadline=None)


def measured(values: dict[int, float], index: str = "mean_response_time") -> Curve:
    settings = [
        Setting(reserve=reserve, series=(a_series(noisy(reserve, value, variation=0.001)),))
        for reserve, value in values.items()
    ]
    return curve_of(settings, "coi", index, RUN)


def test_it_is_straight_between_settings_and_nothing_outside() -> None:
    curve = measured({20: 400.0, 40: 200.0})

    middle = curve.value_at(30)
    assert middle is not None
    assert middle.value == pytest.approx(300.0, rel=0.001)
    assert curve.value_at(19) is None
    assert curve.value_at(41) is None


def test_unordered_setting_is_pooled() -> None:
    curve = measured({20: 400.0, 40: 200.0, 60: 210.0})
    points, shown = curve.points, curve.estimate_at(60)

    assert points[1].value == pytest.approx(205.0, rel=0.03)
    assert points[1].value >= points[2].value
    assert shown is not None
    assert shown.value == pytest.approx(210.0, rel=0.01), "what was measured stays known"
    assert curve.estimate_at(50) is None


def test_least_reservation_is_on_the_safe_side() -> None:
    curve = measured({20: 400.0, 40: 200.0})

    assert least_reserve([(curve, at_most(300))]) == 40
    assert least_reserve([(curve, at_most(206))]) == 40
    assert least_reserve([(curve, at_most(199))]) is None


def test_all_members_and_all_indexes_must_hold() -> None:
    fast, slow = measured({20: 100.0, 30: 90.0, 40: 50.0}), measured({20: 400.0, 30: 300.0, 40: 200.0})

    assert least_reserve([(fast, at_most(95)), (slow, at_most(350))]) == 30


def test_named_component_stays_when_more_is_measured() -> None:
    """Its 205 ms at 60 % are made 202.5 on the curve by what is measured later, at 70 %: it had missed 200 ms alone."""
    slow, fast = {40: 400.0, 60: 205.0}, replace(measured({40: 400.0, 60: 150.0}), component="fast")

    for points in (slow, slow | {70: 202.0}, slow | {70: 208.0}):
        apts = [(measured(points), at_most(200)), (fast, at_most(200))]
        assert components_not_shown(apts, 60) == ("coi",)
        assert components_not_shown(apts, 40) == ("coi", "fast")
    assert components_not_shown([(fast, at_most(200))], 60) == ()


def test_component_missing_only_on_curve_is_named() -> None:
    rising = measured({40: 190.0, 60: 260.0})

    assert components_not_shown([(rising, at_most(200))], 40) == ("coi",)


def test_highest_sure_miss_lies_below_noise() -> None:
    settings = [
        Setting(reserve=reserve, series=(a_series(noisy(reserve, mean, variation=0.25)),))
        for reserve, mean in {20: 400.0, 28: 330.0, 30: 303.0, 32: 296.0, 40: 200.0}.items()
    ]
    curve = curve_of(settings, "coi", "mean_response_time", RUN)

    assert highest_missed([(curve, at_most(300))]) == 28
    assert least_reserve([(curve, at_most(300))]) == 40
    assert highest_missed([(curve, at_most(300)), (measured({39: 90.0, 40: 50.0}), at_most(60))]) == 39
    assert highest_missed([(curve, at_most(900))]) == 0


def test_less_cpu_holds_for_more() -> None:
    steady = [
        Setting(reserve=reserve, series=(a_series(noisy(reserve, level)),))
        for reserve, level in ((20, 100.0), (60, 80.0))
    ]
    rising = Setting(reserve=40, series=(a_series([90.0 + number for number in range(200)]),))
    curve = curve_of([*steady, rising], "coi", "mean_response_time", RUN)

    assert [point.reserve for point in curve.points] == [20, 60]
    assert curve.inconclusive == (40,)
    assert least_reserve([(curve, at_most(95))]) == 60
    assert least_reserve([(curve, at_most(200))]) == 20
    assert curve.safe_value_at(40) == curve.safe_value_at(20)


def test_short_setting_borrows_a_lower_bound() -> None:
    long, short = noisy(1, 100.0, variation=0.15, count=4000), noisy(2, 99.0, variation=0.15, count=40)
    curve = curve_of(
        [Setting(reserve=reserve, series=(a_series(times),)) for reserve, times in ((50, short), (40, long))],
        "coi",
        "mean_response_time",
        RUN,
    )

    assert holds(curve, at_most(104), 40)
    assert holds(curve, at_most(104), 50)
    assert curve.estimates[1].upper > 104


def test_a_bound_that_more_cpu_contradicts_is_none() -> None:
    """110 ms for sure with 60 % cannot be 100 ms for sure with 40 %: one of the two is wrong."""
    curve = measured({40: 100.0, 60: 110.0, 80: 90.0})

    assert least_reserve([(curve, at_most(105))]) == 80


def test_jitter_has_bound_only_where_it_was_measured() -> None:
    curve = measured({40: 100.0, 60: 300.0}, "jitter")
    at = [curve.safe_value_at(reserve) for reserve in (40, 50, 60)]

    assert at[1] == float("inf")
    assert at[0] is not None
    assert at[2] is not None
    assert at[0] < at[2]


def test_a_throughput_is_read_from_below() -> None:
    curve = measured({20: 400.0, 40: 200.0}, "throughput")  # 2.5 and 5 jobs a second

    assert least_reserve([(curve, at_least("3.75"))]) == 40
    assert least_reserve([(curve, at_least("5.01"))]) is None


def test_unordered_maximum_is_not_averaged() -> None:
    """120 ms were seen at 40 %, so they may be had at 20 %, too; and they are not made less by 100 ms seen there."""
    longest = {20: 100.0, 40: 120.0, 60: 90.0}
    settings = [
        Setting(reserve=reserve, series=(a_series([80.0] * 50 + [value]),)) for reserve, value in longest.items()
    ]
    maximum = curve_of(settings, "coi", "maximum_response_time", RUN)
    shortest = [
        Setting(reserve=setting.reserve, series=(a_series([200.0] * 50 + [60.0 + setting.reserve]),))
        for setting in settings
    ]
    minimum = curve_of(shortest, "coi", "minimum_response_time", RUN)

    assert [(point.value, point.upper) for point in maximum.points] == [(120.0, 120.0), (120.0, 120.0), (90.0, 90.0)]
    assert least_reserve([(maximum, at_most(119))]) == 60
    assert [point.value for point in minimum.points] == [80.0, 100.0, 120.0], "more CPU may make it worse"


def test_repeated_maximum_is_not_averaged() -> None:
    settings = [Setting(reserve=40, series=(a_series([*[90.0] * 60, longest]),)) for longest in (130.0, 100.0)]

    curve = curve_of(join_settings(settings, simulated=False), "coi", "maximum_response_time", RUN)

    assert [(point.value, point.upper) for point in curve.points] == [(130.0, 130.0)]
    assert least_reserve([(curve, at_most(120))]) is None
