"""Thresholds of performance indexes as a person writes them, and back."""

from fractions import Fraction

from rarms_iac.model.indexes import PerformanceIndex
from rarms_iac.model.quantities import Unit, parse_quantity, plain, show_milliseconds, show_percent
from rarms_iac.model.system import AtLeast, AtMost, Threshold


def threshold_of(index: PerformanceIndex, text: str) -> Threshold:
    """`100 ms` as what the index must not exceed, or must reach.

    Raises:
        NotAQuantity: it is no number with a unit of the index.
    """
    _, value = parse_quantity(text, index.unit)
    return AtMost(value=value) if index.smaller_is_better else AtLeast(value=value)


def show_value(index: PerformanceIndex, value: Fraction) -> str:
    """A value of the index with its unit: `97.3 ms`, `95 %`, `24 /s`."""
    match index.unit:
        case Unit.TIME:
            return show_milliseconds(value)
        case Unit.SHARE:
            return show_percent(value)
        case _:
            return f"{plain(value)} /s"


def show_threshold(index: PerformanceIndex, threshold: Threshold) -> str:
    """`at most 100 ms`."""
    return f"{index.direction.replace('_', ' ')} {show_value(index, threshold.value)}"
