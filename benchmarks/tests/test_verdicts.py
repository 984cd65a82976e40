"""The benchmark of verdicts in small: wrong no more often than stated; no steady state, no verdict."""

import pytest

from benchmarks.verdicts import (
    APT,
    BEFORE,
    FAR,
    KINDS,
    MEAN,
    NEAR,
    RARE_CASES,
    RUN,
    SHAPES,
    WAYS,
    as_likely,
    case,
    effort,
    falsely_met,
    limit_at,
    met_at_a_look,
    sequential_in,
    series_of,
    too_much_beyond,
    unsteady,
    unsteady_shares,
    wrong,
)
from rarms_iac.model.indexes import INDEXES
from rarms_iac.model.outcomes import Met, Missed, Unsteady
from rarms_iac.statistics.distributions import ERROR
from rarms_iac.statistics.verdicts import judge
from tests.effort import examples

UNLIKELY = 0.01


@pytest.mark.parametrize("distance", [NEAR, FAR])
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("kind", KINDS)
def test_verdicts_are_wrong_within_declared_error(kind: str, way: str, distance: float) -> None:
    """Of series at their thresholds, and of verdicts further away from them."""
    tries = examples(20)
    given, false = wrong(kind, tries, WAYS[way], distance)

    assert as_likely(false, given if distance == FAR else tries, ERROR) > UNLIKELY


@pytest.mark.parametrize("longest", [True, False])
def test_beyond_extreme_are_no_more_jobs_than_granted(longest: bool) -> None:
    tries = examples(20)

    assert as_likely(too_much_beyond(tries, longest=longest), tries, ERROR) > UNLIKELY


def test_two_modes_need_slow_jobs_seen() -> None:
    """2 % of jobs take twice as long: in 45 % of runs the first 40 show none of them."""
    series, apt = effort("two modes", 2)
    samples, _ = sequential_in(series, apt, RUN)

    assert samples > 40


@pytest.mark.parametrize("data", BEFORE)
def test_a_clear_setting_ends_early_with_any_data(data: str) -> None:
    series, _ = effort(data, 1)
    samples, verdict = sequential_in(series, {"mean_response_time": limit_at(10 * MEAN)}, RUN)

    assert isinstance(verdict, Met)
    assert samples <= 160


def test_every_bounded_index_has_a_kind() -> None:
    extremes = {"maximum_response_time", "minimum_response_time"}

    assert {kind.partition(" ")[0] for kind in KINDS} == ({*INDEXES} - extremes) | {"p95_response_time"}


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_has_cases_of_both_sides(kind: str) -> None:
    assert {case(kind, seed).met for seed in range(20)} == {True, False}


def test_shorter_lengths_name_as_many() -> None:
    """docs/measuring.md has the table: of 1,000 samples one in ten is not named."""
    tries = examples(8)
    missed, verdicts = zip(*(unsteady_shares(shape, tries, 1000) for shape in SHAPES), strict=True)

    assert sum(missed) / len(SHAPES) <= 10 + 100 / tries
    assert sum(verdicts) / len(SHAPES) <= 10 + 100 / tries


@pytest.mark.parametrize("shape", SHAPES)
def test_unsteady_series_gets_no_verdict(shape: str) -> None:
    """A random walk is the hardest: what it moves by hardly shows in its neighbours."""
    tries = examples(20)
    found = [judge(series_of(unsteady(shape, seed)), APT, RUN) for seed in range(tries)]

    named = sum(isinstance(verdict, Unsteady) for verdict in found)
    verdicts = sum(isinstance(verdict, Met | Missed) for verdict in found)
    assert named >= 0.95 * tries - 1
    assert verdicts <= 0.01 * tries + 1


@pytest.mark.parametrize(("kind", "index"), RARE_CASES)
def test_rare_slow_jobs_are_met_on_a_condition_alone(kind: str, index: str) -> None:
    met, unconditional = falsely_met(kind, index, examples(10))

    assert unconditional == 0
    assert met or index != "mean_response_time", "without the condition these would be wrong"


def test_settings_of_a_search_need_not_share_error() -> None:
    searches = 40 * examples(10)
    found = met_at_a_look(searches, 3, 4000, 0.001 / 0.15)

    assert as_likely(found, searches, ERROR) > 0.01
