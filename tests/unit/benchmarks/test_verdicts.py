"""The benchmark of verdicts in small: series without a steady state are named, steady ones are not refused."""

import pytest

from benchmarks.verdicts import MEAN, RUN, SHAPES, series_of, steady, unsteady
from rarms_iac.statistics.steadiness import Unsteady
from rarms_iac.statistics.verdict import Met, Missed, judge
from tests.builders import at_most
from tests.effort import examples

APT = {"mean_response_time": at_most(round(1.1 * MEAN))}


@pytest.mark.parametrize("shape", SHAPES)
def test_a_series_without_a_steady_state_is_named_and_gets_no_verdict(shape: str) -> None:
    """A random walk is the hardest: what it moves by hardly shows in its neighbours."""
    tries = examples(20)
    found = [judge(series_of(unsteady(shape, seed)), APT, RUN) for seed in range(tries)]

    named = sum(isinstance(one, Unsteady) for one in found)
    verdicts = sum(isinstance(one, Met | Missed) for one in found)
    assert named >= 0.95 * tries - 1
    assert verdicts <= 0.01 * tries + 1


def test_steady_series_get_their_verdicts() -> None:
    tries = examples(40)
    refused = sum(isinstance(judge(series_of(steady(seed)), APT, RUN), Unsteady) for seed in range(tries))

    assert refused <= 0.02 * tries + 2
