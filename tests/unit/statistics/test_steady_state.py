"""Steady states, warm-ups, and series that have neither."""

import random

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


@pytest.mark.parametrize("shape", ["drift", "shift", "wave", "walk"])
def test_a_series_without_a_steady_state_is_named_with_a_reason(shape: str) -> None:
    chance = random.Random(shape)
    noise = noisy(5, 1.0, variation=0.05, correlation=0.3, count=2000)
    level, values = 100.0, []
    for number, deviation in enumerate(noise):
        match shape:
            case "drift":
                level = 100.0 + 0.01 * number  # 1 % in 100 samples
            case "shift":
                level = 100.0 + (8.0 if number > 1300 else 0.0)
            case "wave":
                level = 100.0 + 5.0 * ((number // 400) % 2)
            case _:
                level += 0.3 * chance.gauss(0.0, 1.0)
        values.append(level * deviation)

    found = find_steady_part(values)

    assert isinstance(found, Unsteady)
    assert "still changed" in found.reason


def test_a_series_that_never_varies_is_steady() -> None:
    assert find_steady_part([7.0] * 500) == 0
