"""A small share of `benchmarks.combining`: the optimum always, and far fewer settings than measuring all pairs."""

from statistics import median

import pytest

from benchmarks.combining import GUIDED, NOISY, PROOF, PROVED, run
from benchmarks.combining_cases import instance
from tests.effort import examples


@pytest.mark.parametrize("model", ["edf", "fair", "mixing"])
def test_pairs_are_combined_best_with_a_part_of_the_settings(model: str) -> None:
    cases = [instance(model, components, seed) for seed in range(examples(2)) for components in (4, 6, 7)]
    proved, guided = ([run(case, way) for case in cases] for way in (PROVED, GUIDED))

    assert all(result.optimal and not result.contradicted for result in (*proved, *guided))
    assert median(result.of_the_walk for result in proved) <= PROOF[model]
    assert sum(result.asked for result in guided) <= 1.1 * sum(result.asked for result in proved)


def test_with_noise_what_is_said_to_hold_does() -> None:
    done = [run(instance("mixing", components, seed), NOISY) for seed in range(examples(4)) for components in (4, 6, 8)]

    assert sum(result.held for result in done) > 10
    assert sum(result.wrong for result in done) <= max(1, 0.01 * sum(result.held for result in done))
    assert sum(result.near for result in done) >= 0.9 * len(done)


def test_compounds_of_three_are_found_where_they_are_best() -> None:
    done = [run(instance("mixing", components, seed, 3), GUIDED) for seed in range(3) for components in (4, 5)]

    assert all(result.optimal for result in done)
