"""Values of performance indexes, their ranges and thresholds as text."""

from collections.abc import Sequence
from fractions import Fraction
from math import isfinite

from rarms_iac.model.indexes import PerformanceIndex, index_named
from rarms_iac.model.outcomes import Doubt, UncertainEstimate
from rarms_iac.model.quantities import UNITS
from rarms_iac.model.system import Threshold
from rarms_iac.texts.quantities import plain, show_number


def show_value(index: PerformanceIndex, value: Fraction | float, threshold: Threshold | None = None) -> str:
    """Return a value of the index with its unit.

    Args:
        value: in the index's own unit. A fraction is exact (`100 ms`, `95 %`); a float was measured (`97.3 ms`,
            `0.0123 /s`), and may be infinite (`no bound`).
        threshold: it is shown in the unit that the user wrote there, and if it misses it, never reads as it.
    """
    units = UNITS[index.unit]
    unit = threshold.unit if threshold and threshold.unit in units else index.symbol  # a log may name any unit
    size = units[unit]
    if not isinstance(value, float):
        return f"{plain(value / size)} {unit}"
    if not isfinite(value):
        return show_number(value)
    return f"{show_number(value / float(size), *([float(threshold.value / size)] if threshold else []))} {unit}"


def short_name(index: PerformanceIndex) -> str:
    """Return the name for a narrow column: `p95` of `p95_response_time`, `throughput` of `throughput`."""
    return index.name.removesuffix("_response_time")


def show_range(index: PerformanceIndex, lower: float, upper: float, threshold: Threshold | None = None) -> str:
    """Write measured bounds as `93.5 to 94.8 ms`, or `at least 93.5 ms, no upper bound yet`.

    Args:
        threshold: as of `show_value`.
    """
    match isfinite(lower), isfinite(upper):
        case True, False:
            return f"at least {show_value(index, lower, threshold)}, no upper bound yet"
        case False, True:
            return f"at most {show_value(index, upper, threshold)}, no lower bound yet"
        case False, False:
            return "no bounds yet"
        case _:
            least, most = show_value(index, lower, threshold), show_value(index, upper, threshold)
            return f"{least.split()[0]} to {most}"


def describe_uncertain(estimates: Sequence[UncertainEstimate]) -> str:
    """Write as `Least certain: vision (maximum of few jobs), speech (p99 from a fitted tail).`.

    Args:
        estimates: at least one.
    """
    named = (
        f"{each.component} ({short_name(index_named(each.index))} "
        f"{'from a fitted tail' if each.doubt is Doubt.TAIL else 'of few jobs'})"
        for each in estimates
    )
    return f"Least certain: {', '.join(dict.fromkeys(named))}."


def show_threshold(index: PerformanceIndex, threshold: Threshold) -> str:
    """Write a threshold as `at most 100 ms`."""
    return f"{index.direction.replace('_', ' ')} {show_value(index, threshold.value, threshold)}"
