"""The report model laid out for the page: where every line and point lies, and the values its script looks up.

Lengths are per cent of a plot, from its top left corner. The reserve's axis runs from 0 to 100, so a reserve of 62 %
lies at 62 %. Nothing here decides anything.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import isfinite

from rarms_iac.app.report_model import CurveRow, IndexCurve, MeasuredPoint, Measurement, PlatformCapacity, Report
from rarms_iac.model.system import AtLeast, AtMost, Threshold
from rarms_iac.texts.indexes import show_value
from rarms_iac.texts.quantities import plain, show_number
from rarms_iac.views.reports.scale import Scale, scale_of
from rarms_iac.views.reports.tables import settings_of
from rarms_iac.views.status import other_claims_text
from rarms_iac.views.table import Table, show_cell
from rarms_iac.views.verdicts import describe_achievement

RESERVES = (0, 20, 40, 60, 80, 100)
"""Labels of the lower axis."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tick:
    """A label next to an axis."""

    at: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Dot:
    """A measured point with its interval and its text."""

    x: str
    y: str
    top: str
    bottom: str
    text: str
    point: int  # which of the curve's points it is, from 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Plot:
    """One curve as a picture with its movable line."""

    id: str
    title: str
    description: str  # what the plot shows, for those who do not see it
    direction: str  # at_most or at_least
    unit: str
    start: str  # the threshold's number where the line begins
    has_apt: bool
    line: str  # where the line begins
    reserve: int | None  # what that threshold reserves
    ticks: tuple[Tick, ...]
    band: str  # path
    curve: str  # path
    dots: tuple[Dot, ...]
    index_curve: IndexCurve
    scale: Scale
    settings: Table  # what was measured, as the page has it


@dataclass(frozen=True, slots=True, kw_only=True)
class Card:
    """A measurement on the page."""

    id: str
    measurement: Measurement
    plots: tuple[Plot, ...]
    is_compared: bool  # the card before it is of the same components, under the load that decides

    @property
    def name(self) -> str:
        return " + ".join(self.measurement.components)

    @property
    def status(self) -> str:
        """What goes behind where it was measured: why no reservation uses it."""
        if self.measurement.stale:
            return "; stale, not used"
        if self.measurement.fixed:
            return "; the manifest fixes the reserve"
        return "" if self.measurement.decides else "; for comparison only"


def cards_of(report: Report) -> tuple[Card, ...]:
    """Make one card per measurement, in the report's order."""
    before = (None, *report.measurements)
    return tuple(
        Card(
            id=f"m{number}",
            measurement=measurement,
            is_compared=_is_compared(measurement, before[number - 1]),
            plots=tuple(
                plot_of(index, measurement, f"m{number}-{place}") for place, index in enumerate(measurement.indexes, 1)
            ),
        )
        for number, measurement in enumerate(report.measurements, 1)
    )


def _is_compared(measurement: Measurement, before: Measurement | None) -> bool:
    if before is None or measurement.decides or measurement.stale:
        return False
    return (before.platform, before.components) == (measurement.platform, measurement.components)


def plot_of(curve: IndexCurve, measurement: Measurement, name: str) -> Plot:
    """Return the positions of everything in a curve's plot."""
    scale = scale_of(curve)
    threshold = beginning(curve, scale)
    rows, settings = curve.rows, settings_of(measurement, curve).on_page()
    together = len(measurement.components) > 1
    title = curve.index.name.replace("_", " ")
    return Plot(
        id=name,
        title=f"{curve.component}: {title}" if together else title[:1].upper() + title[1:],
        description=_description(curve),
        direction=curve.index.direction,
        unit=curve.index.symbol,
        start=plain(threshold.value),
        has_apt=curve.threshold is not None,
        line=_y(scale, float(threshold.value)),
        reserve=curve.least_for(threshold),
        ticks=tuple(Tick(at=_y(scale, float(tick)), text=show_number(float(tick))) for tick in scale.ticks()),
        band=_band(rows, scale),
        curve=_path([(row.reserve, scale.height(row.value)) for row in rows]),
        dots=tuple(_dots(curve, settings, scale)),
        index_curve=curve,
        scale=scale,
        settings=settings,
    )


def beginning(curve: IndexCurve, scale: Scale) -> Threshold:
    """Return the APT; without one the grid's threshold nearest to the middle of the axis."""
    if curve.threshold is not None:
        return curve.threshold
    middle = (scale.low * scale.high) ** 0.5 if scale.logarithmic else (scale.low + scale.high) / 2
    number = round(Fraction(middle) / scale.step)
    value = min(max(number, scale.first), scale.last) * scale.step
    return AtMost(value=value) if curve.index.smaller_is_better else AtLeast(value=value)


def _description(curve: IndexCurve) -> str:
    name = f"{curve.index.name.replace('_', ' ')} of {curve.component}"
    if not curve.curve.points:
        return f"The {name} is not known."
    first, last = curve.curve.points[0], curve.curve.points[-1]
    return (
        f"The {name} goes from {show_value(curve.index, first.value)} at a reserve of {first.reserve:.0f} % of its VPs "
        f"to {show_value(curve.index, last.value)} at {last.reserve:.0f} % of them."
    )


def _y(scale: Scale, value: float) -> str:
    return _number(100 - 100 * scale.height(value))


def _number(value: float) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".")


def _path(points: Sequence[tuple[float, float]]) -> str:
    """Draw straight lines through points of height 0 (bottom) to 1 (top); empty without points."""
    lines = "L".join(f"{_number(x)} {_number(100 - 100 * height)}" for x, height in points)
    return f"M{lines}" if lines else ""


def _band(rows: Sequence[CurveRow], scale: Scale) -> str:
    if not rows:
        return ""
    above = _path([(row.reserve, scale.height(row.high)) for row in rows])
    below = [(row.reserve, scale.height(row.low)) for row in rows]
    return f"{above}L{_path(below[::-1])[1:]}Z"


def _dots(curve: IndexCurve, settings: Table, scale: Scale) -> Iterator[Dot]:
    for number, (point, row) in enumerate(zip(curve.points, settings.rows, strict=True)):
        if point.value is not None:
            yield Dot(
                x=f"{point.reserve}",
                y=_y(scale, point.value),
                top=_y(scale, point.high),
                bottom=_y(scale, point.low),
                text=", ".join(filter(None, map(show_cell, row[:4]))),
                point=number,
            )


def data_of(report: Report, cards: tuple[Card, ...]) -> dict[str, object]:
    """Return the numbers that the page's script looks up, equal to the last bit to those of the planner's curve."""
    counted = _counted(report)
    on_cards = {(measurement.platform, measurement.components) for measurement in counted}
    return {
        "capacities": [
            {
                "name": ", ".join(capacity.hosts),
                "platform": capacity.platform,
                "capacity": float(100 * capacity.capacity_lp),
                "other": float(100 * _uncounted_lp(capacity, counted)),
                "processors": capacity.processors,
                "otherClaims": other_claims_text(capacity),
                "fixed": [[list(part.components), float(100 * part.reserved_lp)] for part in capacity.fixed],
                "unknown": [
                    [verdict.component, describe_achievement(verdict.achievement, verdict.not_measured)]
                    for verdict in capacity.unknown
                    if (verdict.platform, verdict.members) not in on_cards
                ],
            }
            for capacity in report.capacities
        ],
        "cards": [
            {
                "id": card.id,
                "name": card.measurement.name,
                "log": card.measurement.log,
                "platform": card.measurement.platform,
                "processors": card.measurement.processors,
                "decides": card.measurement in counted,
                "fixed": list(card.measurement.fixed),
                "floor": card.measurement.floor,
                **_verdict_data(card.measurement),
                "plots": [_plot_data(plot) for plot in card.plots],
            }
            for card in cards
        ],
    }


def _counted(report: Report) -> tuple[Measurement, ...]:
    """Return the measurements that the total of a platform is made of, or is not known without.

    Their partitions are placed there, or their reservations are not known.
    """
    counted = {(capacity.platform, name) for capacity in report.capacities for name in capacity.partitions}
    unknown = {(each.platform, each.members) for capacity in report.capacities for each in capacity.unknown}
    return tuple(
        measurement
        for measurement in report.measurements
        if measurement.decides
        and (
            (measurement.platform, measurement.partition) in counted
            or (measurement.platform, measurement.components) in unknown
        )
    )


def _uncounted_lp(capacity: PlatformCapacity, counted: Iterable[Measurement]) -> Fraction:
    """Return the reservations there apart from fixed reserves and the cards: idle threads, omitted logs."""
    here = (measurement for measurement in counted if measurement.platform == capacity.platform)
    cards = sum((measurement.reserved_lp or Fraction(0) for measurement in here), Fraction(0))
    return capacity.reserved_lp - cards - sum((part.reserved_lp for part in capacity.fixed), Fraction(0))


def _plot_data(plot: Plot) -> dict[str, object]:
    curve, scale = plot.index_curve, plot.scale
    return {
        "id": plot.id,
        "component": curve.component,
        "index": curve.index.name,
        "direction": plot.direction,
        "unit": plot.unit,
        "apt": plot.has_apt,
        "start": plot.start,
        "low": scale.low,
        "high": scale.high,
        "logarithmic": scale.logarithmic,
        "mantissa": scale.mantissa,
        "exponent": scale.exponent,
        "first": scale.first,
        "last": scale.last,
        "measured": [round(point.reserve) for point in curve.curve.points],
        **_best(curve),
        "rows": [[row.reserve, _finite(row.safe)] for row in curve.rows],
        "samples": [_distribution(point) for point in curve.points],
    }


def _verdict_data(measurement: Measurement) -> dict[str, object]:
    """Return the verdict where it is of this measurement; else that only the card's own load is known."""
    verdict, load = measurement.verdict, {"load": measurement.interference}
    if not measurement.decides:
        return {**load, "aside": True} if measurement.is_aside else {}
    loads = {**load, "notMeasured": list(verdict.not_measured)} if verdict.not_measured else {}
    return {"achievement": verdict.achievement.value, **loads}


def _best(curve: IndexCurve) -> dict[str, float | str]:
    """Return the good end of the band at the highest measured reserve: a threshold that it misses is not achieved."""
    top = max((point.reserve for point in curve.points), default=0)
    if top in curve.curve.overloaded:
        return {"best": "none"}  # every threshold is missed
    point = curve.curve.value_at(top)
    best = None if point is None else _finite(point.lower if curve.index.smaller_is_better else point.upper)
    return {} if best is None else {"best": best}


BARS = 24
"""Of a distribution."""


def _distribution(point: MeasuredPoint) -> dict[str, object]:
    """Count the response times of a setting in equal parts of their range; in ms."""
    times = point.response_ms
    low, high = min(times, default=0.0), max(times, default=0.0)
    counts = [0] * BARS
    for time in times:
        counts[min(int(BARS * (time - low) / (high - low)), BARS - 1) if high > low else 0] += 1
    return {"reserve": point.reserve, "low": round(low, 3), "high": round(high, 3), "counts": counts}


def _finite(value: float) -> float | None:
    """Replace infinity, which JSON does not know, by null: a side that meets nothing."""
    return value if isfinite(value) else None
