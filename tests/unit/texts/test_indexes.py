"""Values of indexes as text, in the unit that the user wrote."""

from fractions import Fraction
from math import inf

from rarms_iac.model.indexes import index_named
from rarms_iac.model.outcomes import Doubt, UncertainEstimate
from rarms_iac.model.system import AtMost
from rarms_iac.texts.indexes import describe_uncertain, show_range

MEAN = index_named("mean_response_time")


def test_range_has_the_unit_of_the_threshold() -> None:
    two_seconds = AtMost(value=Fraction(2000), unit="s")

    assert show_range(MEAN, 1500.0, 1900.0, two_seconds) == "1.5 to 1.9 s"
    assert show_range(MEAN, 1500.0, inf, two_seconds) == "at least 1.5 s, no upper bound yet"
    assert show_range(MEAN, 93.5, 94.8) == "93.5 to 94.8 ms"


def test_uncertain_estimate_is_named_once() -> None:
    """Also of a component that was measured on two hosts."""
    tail = UncertainEstimate(component="arm", index="p99_response_time", doubt=Doubt.TAIL)
    extreme = UncertainEstimate(component="lift", index="maximum_response_time", doubt=Doubt.EXTREME)

    assert describe_uncertain([tail, extreme, tail]) == (
        "Least certain: arm (p99 from a fitted tail), lift (maximum of few jobs)."
    )
