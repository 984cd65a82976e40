"""Steady states, warm-ups, and series that have neither."""

import pytest

from rarms_iac.model.outcomes import Unsteady
from rarms_iac.statistics.steady_state import find_steady_part
from tests.effort import examples
from tests.measured import noisy


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_steady_series_are_hardly_ever_refused(correlation: float) -> None:
    tries = examples(100)
    refused = sum(
        isinstance(find_steady_part(noisy(seed, 100.0, variation=0.15, correlation=correlation, count=400)), Unsteady)
        for seed in range(tries)
    )

    assert refused <= 0.02 * tries + 3 * (0.02 * 0.98 * tries) ** 0.5


def test_a_warm_up_is_cut_off() -> None:
    found = find_steady_part([300.0] * 30 + noisy(4, 100.0, count=970))

    assert isinstance(found, int)
    assert 30 <= found <= 60


def test_a_series_that_never_varies_is_steady() -> None:
    assert find_steady_part([7.0] * 500) == 0
