"""A small share of the search's benchmark: its answers are certified and right."""

from statistics import fmean

from benchmarks.components import NOISES, component
from benchmarks.search import DEFAULT, HALVED, SHAPES, Result, results
from tests.effort import examples


def searched(each: int) -> list[Result]:
    """Seeds 1, 2, ... and the noise levels in turn."""
    tasks = [(shape, seed, NOISES[seed % len(NOISES)]) for shape in SHAPES for seed in range(1, each + 1)]
    return [result for task in tasks for result in results(task)]


def test_answers_are_certified_with_few_settings() -> None:
    found = searched(examples(2))
    guided = [result for result in found if result.strategy == DEFAULT]
    halved = [result for result in found if result.strategy == HALVED]

    assert all(result.certified for result in guided if result.found)
    assert sum(not result.right for result in guided) <= 0.03 * len(guided) + 1
    assert fmean(result.settings for result in guided) < fmean(result.settings for result in halved) - 1.2
    assert fmean(result.samples for result in guided) < 1.1 * fmean(result.samples for result in halved)


def test_every_shape_has_least_reservation_and_never_rises() -> None:
    for shape in SHAPES:
        truth = component(shape, 3, 0.05)
        assert 2 <= truth.least() <= 100
        assert not truth.meets(truth.least() - 1)
        assert all(later <= sooner * (1 + 1e-9) for sooner, later in zip(truth.level, truth.level[1:], strict=False))
