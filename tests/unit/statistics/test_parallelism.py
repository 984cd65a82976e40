"""On how few processors a component would do as well."""

import pytest

from rarms_iac.model.measurement import Setting
from rarms_iac.model.series import Sample, Series
from rarms_iac.statistics.samples import usable_processors


def a_setting(reserve: int, used: float) -> Setting:
    """Ten jobs of 20 ms that consume so many processors."""
    jobs = tuple(Sample(began_ms=20.0 * number, response_ms=20.0, successful=True) for number in range(10))
    series = Series(component="coi", samples=jobs, elapsed_ms=200.0, cpu_ms=200.0 * used)
    return Setting(reserve=reserve, series=(series,), seed=1)


@pytest.mark.parametrize(
    ("used", "usable"),
    [
        ({45: 0.45, 20: 0.2}, 1),
        ({60: 1.2, 100: 1.98}, 2),
        ({45: 1.8, 90: 3.5}, None),  # it uses all four
        ({20: 0.1, 45: 0.2}, None),  # it waits for something else
        ({45: 0.45, 70: 0.95}, None),  # sometimes more than one, and never two
    ],
)
def test_what_holds_a_component_back_is_seen_where_its_reserve_does_not(
    used: dict[int, float], usable: int | None
) -> None:
    assert usable_processors([a_setting(*pair) for pair in used.items()], "coi", 4) == usable


def test_without_cpu_time_or_with_one_processor_nothing_is_said() -> None:
    assert usable_processors([], "coi", 4) is None
    assert usable_processors([a_setting(100, 1.0)], "coi", 1) is None
