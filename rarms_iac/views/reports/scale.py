"""The upright axis of a plot: its range, its ticks, and the grid on which a threshold moves.

The grid is decimal, 1, 2 or 5 times a power of ten, so that every threshold on it is short to write and means
exactly the same in Python, in a browser and in a manifest.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from math import ceil, floor, isfinite, log10

from rarms_iac.app.report_model import IndexCurve
from rarms_iac.model.quantities import Unit

WIDE = 5.0
"""From this ratio of largest to smallest on the axis is logarithmic: most thresholds lie at its low end."""

ROOM = 0.06
"""Of the axis, left free above and below."""

POSITIONS = 200
"""Steps of a threshold's grid: so many below the smallest value, or twice so many over a linear axis."""

TICKS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """An axis from `low` to `high`; thresholds are whole multiples of `mantissa` times ten to the `exponent`."""

    low: float
    high: float
    logarithmic: bool
    mantissa: int
    exponent: int

    def height(self, value: float) -> float:
        """Return a value's position, 0 at the bottom and 1 at the top; outside of the axis at its edge."""
        low, high = (log10(self.low), log10(self.high)) if self.logarithmic else (self.low, self.high)
        bounded = min(max(value, self.low), self.high)
        return ((log10(bounded) if self.logarithmic else bounded) - low) / (high - low)

    @property
    def step(self) -> Fraction:
        """The grid's step, exactly."""
        return self.mantissa * Fraction(10) ** self.exponent

    @property
    def first(self) -> int:
        """The number of the lowest step on the axis."""
        return ceil(Fraction(self.low) / self.step)

    @property
    def last(self) -> int:
        """The number of the highest step on the axis."""
        return floor(Fraction(self.high) / self.step)

    def ticks(self) -> tuple[Fraction, ...]:
        """Round values to label, ascending."""
        return tuple(self._logarithmic_ticks() if self.logarithmic else self._linear_ticks())

    def _linear_ticks(self) -> Iterator[Fraction]:
        mantissa, exponent = round_down((self.high - self.low) / TICKS * 1.3)
        step = mantissa * Fraction(10) ** exponent
        for number in range(ceil(Fraction(self.low) / step), floor(Fraction(self.high) / step) + 1):
            yield number * step

    def _logarithmic_ticks(self) -> Iterator[Fraction]:
        for exponent in range(floor(log10(self.low)), ceil(log10(self.high)) + 1):
            for mantissa in (1, 2, 5) if self.high / self.low < 1000 else (1,):
                value = mantissa * Fraction(10) ** exponent
                if self.low <= value <= self.high:
                    yield value


def round_down(value: float) -> tuple[int, int]:
    """Return the largest 1, 2 or 5 times a power of ten up to a positive value, as mantissa and exponent."""
    exponent = floor(log10(value))
    mantissa = max(digit for digit in (1, 2, 5) if digit == 1 or digit * 10.0**exponent <= value * (1 + 1e-9))
    return mantissa, exponent


def scale_of(curve: IndexCurve) -> Scale:
    """Return the axis on which all of a curve is seen, its threshold too; of a band, what lies near the values."""
    values = [point.value for point in curve.curve.points] + [
        point.value for point in curve.points if point.value is not None
    ]
    if curve.threshold is not None:
        values.append(float(curve.threshold.value))
    values = [value for value in values if isfinite(value)] or [0.0, 1.0]
    smallest, largest = min(values), max(values)
    if curve.index.unit is Unit.SHARE:
        return _share(smallest, largest)
    if smallest > 0 and largest / smallest >= WIDE:
        return _logarithmic(smallest, largest)
    return _linear(curve, smallest, largest)


def _share(smallest: float, largest: float) -> Scale:
    """Return an axis in per cent: whole, or its upper or lower end if all values lie there."""
    low = 80.0 if smallest >= 85 else 50.0 if smallest >= 55 else 0.0
    high = 100.0 if low or largest > 45 else 50.0 if largest > 18 else 20.0
    mantissa, exponent = round_down((high - low) / (2 * POSITIONS))
    return Scale(low=low, high=high, logarithmic=False, mantissa=mantissa, exponent=exponent)


def _logarithmic(smallest: float, largest: float) -> Scale:
    room = (largest / smallest) ** ROOM
    mantissa, exponent = round_down(smallest / POSITIONS)
    return Scale(low=smallest / room, high=largest * room, logarithmic=True, mantissa=mantissa, exponent=exponent)


def _linear(curve: IndexCurve, smallest: float, largest: float) -> Scale:
    spread = (largest - smallest) or abs(largest) or 1.0
    ends = [end for point in curve.curve.points for end in (point.lower, point.upper) if isfinite(end)]
    low = max(min([smallest, *ends]), smallest - spread / 2, 0.0)
    high = min(max([largest, *ends]), largest + spread / 2)
    span = (high - low) or spread
    low, high = max(low - span * ROOM, 0.0), high + span * ROOM
    mantissa, exponent = round_down((high - low) / (2 * POSITIONS))
    return Scale(low=low, high=high, logarithmic=False, mantissa=mantissa, exponent=exponent)
