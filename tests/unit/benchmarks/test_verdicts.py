"""A small share of the verdicts' benchmark: no more wrong than declared, and what is not steady is named."""

import pytest

from benchmarks.verdicts import RUN, as_likely, sequential, series_of, steady, unsteady, wrong
from rarms_iac.model.system import Threshold
from rarms_iac.statistics.steadiness import Unsteady
from rarms_iac.statistics.verdict import judge
from tests.builders import at_most
from tests.effort import examples


@pytest.mark.parametrize("kind", ["mean_response_time", "success_rate", "p95_response_time"])
def test_verdicts_are_wrong_no_more_often_than_they_declare(kind: str) -> None:
    count = examples(60)

    given, false, declared = wrong(kind, count, sequential)

    assert given > 0
    assert as_likely(false, count, declared) > 0.01


@pytest.mark.parametrize("shape", ["drift", "level shifts", "slow wave"])
def test_what_is_not_steady_gets_no_verdict(shape: str) -> None:
    apt: dict[str, Threshold] = {"mean_response_time": at_most(110)}

    verdicts = [judge(series_of(unsteady(shape, seed)), apt, RUN) for seed in range(examples(5))]

    assert sum(not isinstance(verdict, Unsteady) for verdict in verdicts) <= 0.05 * len(verdicts)


def test_what_is_steady_is_hardly_ever_refused() -> None:
    tries = examples(30)
    apt: dict[str, Threshold] = {"mean_response_time": at_most(110)}

    refused = sum(isinstance(judge(series_of(steady(seed)), apt, RUN), Unsteady) for seed in range(tries))

    assert refused <= 0.02 * tries + 2


def test_the_binomial_test_by_hand() -> None:
    assert as_likely(1, 2, 0.5) == pytest.approx(0.75)
    assert as_likely(0, 100, 0.01) == 1.0
