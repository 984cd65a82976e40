"""Performance indexes and the family of percentiles."""

from fractions import Fraction

import pytest

from rarms_iac.model.indexes import INDEXES, find_index, percentile_of
from rarms_iac.model.quantities import Unit


def test_every_index_is_found_by_its_own_name() -> None:
    assert [find_index(name) for name in INDEXES] == list(INDEXES.values())
    assert all(index.name == name and index.description for name, index in INDEXES.items())


@pytest.mark.parametrize(
    ("name", "direction", "unit"),
    [
        ("mean_response_time", "at_most", Unit.TIME),
        ("jitter", "at_most", Unit.TIME),
        ("success_rate", "at_least", Unit.SHARE),
        ("throughput", "at_least", Unit.RATE),
        ("deadline_miss_rate", "at_most", Unit.SHARE),
        ("p95_response_time", "at_most", Unit.TIME),
    ],
)
def test_index_knows_unit_and_good_side(name: str, direction: str, unit: Unit) -> None:
    index = find_index(name)

    assert index is not None
    assert (index.direction, index.unit) == (direction, unit)


@pytest.mark.parametrize(
    ("name", "percent"),
    [
        ("p50_response_time", Fraction(50)),
        ("p99.9_response_time", Fraction(999, 10)),
        ("p5_response_time", Fraction(5)),
    ],
)
def test_a_percentile_says_its_per_cent(name: str, percent: Fraction) -> None:
    assert percentile_of(name) == percent


@pytest.mark.parametrize(
    "name",
    [
        "p0_response_time",
        "p05_response_time",
        "p95.0_response_time",
        "p100_response_time",
        "p95",
        "p95_response_time\n",
    ],
)
def test_a_percentile_has_one_spelling(name: str) -> None:
    assert find_index(name) is None
