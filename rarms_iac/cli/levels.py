"""A level that somebody chose, beside what was measured: what to do where none meets it, and whether it is a slip."""

from collections.abc import Sequence
from fractions import Fraction
from math import ceil, floor, isfinite

from rarms_iac.model.capacity import capacity_of
from rarms_iac.model.indexes import PerformanceIndex, show_value
from rarms_iac.model.quantities import UNITS, Unit, plain
from rarms_iac.model.system import Host, Threshold
from rarms_iac.planner.reservations import MeasuredTogether
from rarms_iac.statistics.curves import Curve

FAR = 10
"""So many times worse than the worst that was measured is no level that somebody wants."""


def advice_beyond(index: PerformanceIndex, curve: Curve, log: MeasuredTogether, host: Host) -> str:
    """What can be chosen as it is, and what to measure first for more, where no measured reservation is enough."""
    highest = log.measured[-1]
    most = min(100, int(100 * capacity_of(host, None).processors / log.processors))
    safe = curve.safe_value_at(highest)
    holds = "" if safe is None or not isfinite(safe) else f": {_as_a_level(index, safe)} holds at {highest} %"
    if highest >= most:
        return f"Choose an easier level{holds}, and {most} % is the most that there is."
    return (
        f"Choose an easier level{holds}. Or measure higher settings, and select again: "
        f"`{log.again} --from {highest + 1}% --to {most}%`."
    )


def far_from(index: PerformanceIndex, threshold: Threshold, text: str, curves: Sequence[Curve]) -> str:
    """Why the level cannot be meant, with what may be; empty where it can, or where nothing was measured.

    A share cannot lie far from another.
    """
    values = [point.value for curve in curves for point in curve.points if isfinite(point.value) and point.value > 0]
    if not values or index.unit is Unit.SHARE:
        return ""
    easiest, level = (max if index.smaller_is_better else min)(values), float(threshold.value)
    times = level / easiest if index.smaller_is_better else easiest / level if level else float("inf")
    if times <= FAR:
        return ""
    lowest, highest = (show_value(index, Fraction(round(10 * one), 10)) for one in (min(values), max(values)))
    return (
        f"{text} lies far outside of what was measured, where {index.name} goes from {lowest} to {highest}."
        f"{_meant(index, text, values)} If it is meant, write it into the manifest."
    )


def _meant(index: PerformanceIndex, text: str, values: Sequence[float]) -> str:
    """The same number with another unit, where that lies among what was measured."""
    number = Fraction(text.rstrip("abcdefghijklmnopqrstuvwxyz/ "))
    for unit, size in UNITS[index.unit].items():
        if min(values) / 2 <= float(number * size) <= max(values) * 2:
            return f" Did you mean {plain(number)} {unit}?"
    return ""


def _as_a_level(index: PerformanceIndex, value: float) -> str:
    """Rounded to the side on which it still holds."""
    tenths = ceil(value * 10) if index.smaller_is_better else floor(value * 10)
    return show_value(index, Fraction(tenths, 10))
