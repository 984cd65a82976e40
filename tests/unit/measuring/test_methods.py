"""Methods of an experiment: the settings that each of them stands for."""

from rarms_iac.measuring.strategies import Sweep, reserves_of


def test_a_coarse_curve_is_clipped_to_what_the_host_can_give() -> None:
    assert reserves_of(Sweep(), 100) == (10, 20, 30, 40, 50, 60, 70, 80, 90, 100)
    assert reserves_of(Sweep(), 47) == (10, 20, 30, 40, 47)
    assert reserves_of(Sweep(), 0) == (10,), "a setting that the host refuses, with its reason"
