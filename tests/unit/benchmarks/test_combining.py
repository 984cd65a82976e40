"""A small share of `benchmarks.combining`: the optimum always, and far fewer settings than measuring all pairs."""

from statistics import median

import pytest

from benchmarks.combining import GOALS, instance, result
from rarms_iac.model.system import Minimise
from tests.effort import examples


@pytest.mark.parametrize("model", ["edf", "fair", "mixing"])
def test_pairs_are_combined_best_with_a_third_of_the_settings(model: str) -> None:
    cases = [(components, seed) for seed in range(examples(2)) for components in (4, 6, 7)]
    done = [result(instance(model, *case), Minimise.COMBINING) for case in cases]

    assert all(one.optimal and one.proved for one in done)
    assert median(one.of_the_walk for one in done) <= GOALS[model]
