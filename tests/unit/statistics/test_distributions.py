"""Quantiles against printed tables."""

from math import inf

import pytest

from rarms_iac.statistics.distributions import beta_quantile, share_below, share_interval, student_quantile


@pytest.mark.parametrize(
    ("probability", "freedom", "value"),
    [(0.975, 1, 12.706), (0.975, 10, 2.228), (0.995, 30, 2.750), (0.95, 120, 1.658), (0.025, 10, -2.228)],
)
def test_student(probability: float, freedom: float, value: float) -> None:
    assert student_quantile(probability, freedom) == pytest.approx(value, abs=0.001)


def test_student_without_freedom_knows_nothing() -> None:
    assert student_quantile(0.975, 0.0) == inf


def test_beta_is_uniform_with_ones() -> None:
    assert share_below(0.3, 1.0, 1.0) == pytest.approx(0.3)
    assert beta_quantile(0.3, 1.0, 1.0) == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("successes", "trials", "bounds"), [(0, 10, (0.0, 0.3085)), (5, 10, (0.1871, 0.8129)), (10, 10, (0.6915, 1.0))]
)
def test_clopper_and_pearson(successes: float, trials: float, bounds: tuple[float, float]) -> None:
    assert share_interval(successes, trials, error=0.05) == pytest.approx(bounds, abs=0.0001)
