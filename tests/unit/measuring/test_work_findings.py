"""A component that uses no processor at any reservation works elsewhere, or only waits."""

import pytest

from rarms_iac.manifest.text.positions import FirstLine
from rarms_iac.measuring.findings import work_of_settings
from rarms_iac.model.series import Sample, Series
from rarms_iac.model.setting import Setting, SettingEvidence
from tests.unit.measuring.test_measuring_findings import EXPERIMENT


def setting(reserve: int, response_ms: float, cpu_ms: float) -> Setting:
    """Ten jobs with this response time each, and the processor time of all of them."""
    samples = [Sample(began_ms=at * 100.0, response_ms=response_ms, successful=True) for at in range(10)]
    series = Series(component="vision", samples=samples, elapsed_ms=1000.0, cpu_ms=cpu_ms)
    return Setting(reserve=reserve, series=(series,), evidence=SettingEvidence(elapsed_ms=1000.0))


@pytest.mark.parametrize(
    ("settings", "found"),
    [
        ((setting(20, 100.0, 0.0), setting(80, 100.0, 0.0)), True),
        ((setting(20, 100.0, 0.9), setting(80, 105.0, 0.9)), True),
        ((setting(20, 100.0, 1.1), setting(80, 100.0, 1.1)), False),  # more than 1 ms a second
        ((setting(20, 100.0, 0.0), setting(80, 50.0, 0.0)), False),  # a reservation helps
        ((setting(20, 100.0, 0.0),), False),
    ],
)
def test_waiting_without_processor_time_is_a_warning(settings: tuple[Setting, ...], found: bool) -> None:
    told = list(work_of_settings(EXPERIMENT, settings, FirstLine("")))

    assert [diagnostic.code for diagnostic in told] == ["RARMS393"] * found
    assert all("the same at 20 % and at 80 % of its VPs" in diagnostic.detail for diagnostic in told)
