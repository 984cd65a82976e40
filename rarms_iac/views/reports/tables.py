"""The tables of the report: levels of performance, totals, settings, samples, proofs, and what tuning did.

The planner looks its reservations up in the logs, not here. Times of samples have the tenth of a microsecond that data
logs keep.
"""

from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction

from rarms_iac.app.report_model import (
    ComponentProof,
    IndexCurve,
    MeasuredPoint,
    Measurement,
    PlatformCapacity,
    PlatformTuning,
    Report,
)
from rarms_iac.model.achievement import Achievement, ReservationVerdict
from rarms_iac.model.indexes import show_bound, show_range, show_threshold, show_value
from rarms_iac.model.quantities import share_of_processors, show_reserve
from rarms_iac.planner.combining.candidates import Node
from rarms_iac.views.prove import describe_proof_setting, describe_verdict
from rarms_iac.views.reports.table import Cell, Column, ReportTable, Value, finite
from rarms_iac.views.verdicts import describe_achievement

MOST_CANDIDATES = 24

TIME_PLACES = 4
"""Of a millisecond, as data logs keep a sample's times."""

RESERVE_LP = "reserve (LP)"
RESERVE = "reserve (% of the partition's VPs)"

Row = Sequence[Cell | Value]


def _fields(*headings: str) -> tuple[Column, ...]:
    """Columns that only files have."""
    return tuple(Column(field=heading) for heading in headings)


OF_A_LOG = _fields("component", "measured with", "platform", "interference")


def _of_a_log(component: str, measurement: Measurement) -> Row:
    return component, measurement.name, measurement.platform, measurement.interference


LEVELS = (
    Column(field="component", title="Component", short="component"),
    Column(field="platform", title="Platform", short="platform"),
    Column(field="index", title="Index"),
    Column(field="direction"),
    Column(field="threshold", title="Threshold (APT)"),
    Column(short="threshold", wraps=True),
    Column(field="unit"),
    Column(field="expected at the reserve", title="Expected"),
    Column(field=RESERVE_LP, title="Reserve", short="LP", style="strong", unit="LP", right=True),
    Column(field=RESERVE, title="CR", short="CR", wraps=True),
    Column(field="verdict", title="Verdict"),
)


def levels_table(report: Report) -> ReportTable:
    """Return a row a threshold that a reservation rests on, most critical first; then what is fixed or not measured."""
    return ReportTable(columns=LEVELS, rows=tuple(row for _, row in _levels(report)))


def levels_of_component(report: Report, component: str) -> ReportTable:
    """Return the rows of that table that are about a component, alone or with the others of its partition."""
    return ReportTable(columns=LEVELS, rows=tuple(row for names, row in _levels(report) if component in names))


def _levels(report: Report) -> Iterator[tuple[Sequence[str], Row]]:
    """Yield the components that a row is about, and the row."""
    for measurement in report.measurements:
        if measurement.decides:
            for curve in measurement.indexes:
                if curve.threshold is not None:
                    yield (curve.component,), _level(measurement, curve)
    for capacity in report.capacities:
        for part in capacity.fixed:
            yield (
                part.components,
                _without_curve(part.name, capacity.platform, part.reserved_lp, "fixed by the manifest"),
            )
    shown = {measurement.components for measurement in report.measurements if measurement.decides}
    for names in dict.fromkeys(verdict.members for verdict in report.verdicts if verdict.members not in shown):
        yield names, _without_curve(" + ".join(names), None, None, Achievement.UNMEASURED)


def _level(measurement: Measurement, curve: IndexCurve) -> Row:
    assert curve.threshold is not None
    reserve = measurement.reserve
    point = None if reserve is None else curve.curve.value_at(reserve)
    return (
        curve.component,
        measurement.platform,
        curve.index.name,
        curve.index.direction,
        Cell(text=show_threshold(curve.index, curve.threshold), value=curve.threshold.value),
        f"{curve.index.name} {show_bound(curve.index, curve.threshold)}",
        curve.index.symbol,
        None
        if point is None
        else Cell(
            text=f"{show_value(curve.index, point.value)} with {measurement.interference}", value=finite(point.value)
        ),
        measurement.reserved_lp,
        Cell(
            text=_why_no_reserve(measurement.verdict, curve)
            if reserve is None
            else share_of_processors(reserve, measurement.processors),
            value=reserve,
        ),
        verdict_of(measurement.verdict, curve),
    )


def _without_curve(name: str, platform: str | None, reserved: Fraction | None, verdict: str) -> Row:
    return name, platform, None, None, None, verdict, None, None, reserved, None, verdict


def verdict_of(verdict: ReservationVerdict, curve: IndexCurve) -> str:
    """Return the verdict on a threshold in words."""
    own = (each.achievement for each in verdict.thresholds if (each.component, each.index) == _key(curve))
    words = describe_achievement(next(own, Achievement.UNMEASURED), verdict.not_measured)
    return f"{words} so far" if curve.index.is_extreme and words == Achievement.MET else words


def _why_no_reserve(verdict: ReservationVerdict, curve: IndexCurve) -> str:
    """Return the verdict on the threshold.

    Where it is met and another one is not, it says that nothing follows from it alone.
    """
    words = verdict_of(verdict, curve)
    return "not known" if words.startswith(Achievement.MET) else words


def _key(curve: IndexCurve) -> tuple[str, str]:
    return curve.component, curve.index.name


def _verdict_word(curve: IndexCurve, point: MeasuredPoint) -> str:
    """How sure it is, the page says once; a maximum or minimum is only met so far."""
    return "met so far" if curve.index.is_extreme and point.verdict == "met" else point.verdict or ""


TOTALS = _fields(
    "platform", "hosts", "capacity (LP)", "total is", "reserved (LP)", "not known yet", "headroom (LP)", "fits"
)


def totals_table(report: Report) -> ReportTable:
    """Return a row a platform."""
    return ReportTable(columns=TOTALS, rows=tuple(map(_total, report.capacities)))


def _total(fit: PlatformCapacity) -> Row:
    """Return the headroom is empty while a reservation is not known: the total is at least the one that is shown."""
    return (
        fit.platform,
        ", ".join(fit.hosts),
        fit.capacity_lp,
        "at least" if fit.unknown else "exactly",
        fit.reserved_lp,
        " ".join(verdict.component for verdict in fit.unknown),
        fit.headroom_lp,
        "not known" if fit.fits is None else "yes" if fit.fits else "no",
    )


SETTINGS = (
    *OF_A_LOG,
    Column(field=RESERVE, title="Reserve"),
    *_fields("processors (VPs)", "index", "unit"),
    Column(field="value", title="Measured"),
    *_fields("interval from", "interval to"),
    Column(title="Interval"),
    Column(field="samples", title="Samples"),
    *_fields("effective samples", "failed samples", "direction", "threshold"),
    Column(field="verdict", title="Verdict"),
    *_fields("error of the verdict (%)"),
    Column(field="remark", title="Remarks"),
    *_fields("data log"),
)


def settings_table(report: Report) -> ReportTable:
    """Return a row a setting and performance index."""
    curves = ((measurement, curve) for measurement in report.measurements for curve in measurement.indexes)
    return ReportTable(columns=SETTINGS, rows=tuple(row for each in curves for row in settings_of(*each).rows))


def settings_of(measurement: Measurement, curve: IndexCurve) -> ReportTable:
    """Return the rows of one performance index."""
    return ReportTable(columns=SETTINGS, rows=tuple(_setting(measurement, curve, point) for point in curve.points))


def _setting(measurement: Measurement, curve: IndexCurve, point: MeasuredPoint) -> Row:
    known, index = point.value is not None, curve.index
    failed = f", {point.failed} failed" if point.failed else ""
    return (
        *_of_a_log(curve.component, measurement),
        Cell(text=show_reserve(point.reserve, measurement.processors), value=point.reserve),
        measurement.processors,
        index.name,
        index.symbol,
        Cell(text="no answer" if point.value is None else show_value(index, point.value), value=finite(point.value)),
        finite(point.low) if known else None,
        finite(point.high) if known else None,
        show_range(index, point.low, point.high) if known else "",
        Cell(text=f"{point.samples} samples{failed}", value=point.samples),
        finite(point.effective),
        point.failed,
        index.direction,
        None if curve.threshold is None else curve.threshold.value,
        Cell(text=_verdict_word(curve, point), value=point.verdict or ""),
        None if point.error is None else finite(100 * point.error),
        point.remark,
        measurement.log,
    )


SAMPLES = (
    *OF_A_LOG,
    *_fields(RESERVE, "setting", "job", "began (ms)", "response time (ms)", "successful", "count", "failure"),
)


def samples_table(report: Report) -> ReportTable:
    """Return a row a sample, in the order in which they were measured."""
    return ReportTable(columns=SAMPLES, rows=tuple(_samples(report)))


def _samples(report: Report) -> Iterator[Row]:
    for measurement in report.measurements:
        for number, setting in enumerate(measurement.settings, 1):
            for series in setting.series:
                for job, sample in enumerate(series.samples, 1):
                    yield (
                        *_of_a_log(series.component, measurement),
                        setting.reserve,
                        number,
                        job,
                        round(sample.began_ms, TIME_PLACES),
                        None if sample.response_ms is None else round(sample.response_ms, TIME_PLACES),
                        int(sample.successful),
                        sample.count,
                        sample.failure,
                    )


PROOFS = (
    Column(title="Component", short="component"),
    Column(title="Index"),
    Column(title="Threshold (APT)"),
    Column(short="threshold", wraps=True),
    Column(short="on"),
    Column(short="beside"),
    Column(title="Observed"),
    Column(short="measured"),
    Column(title="Result", style="strong wrapping"),
    Column(short="verdict", wraps=True),
)


def proofs_table(report: Report) -> ReportTable:
    """Return a row for what each component showed when all ran together, in the report's order."""
    return ReportTable(columns=PROOFS, rows=tuple(map(_proof, report.proofs)))


def _proof(proof: ComponentProof) -> Row:
    index, verdict = proof.index, describe_verdict(proof.index, proof.verdict)
    result = (
        verdict
        + f": {describe_proof_setting(proof)}"
        + (f"; outdated: {'; '.join(proof.outdated)}" if proof.outdated else "")
    )
    return (
        proof.component,
        index.name,
        show_threshold(index, proof.threshold),
        f"{index.name} {show_bound(index, proof.threshold)}",
        proof.host,
        proof.interference or "no load",
        _band(proof),
        "cannot be told" if proof.value is None else show_value(index, proof.value),
        Cell(text=result, missed=not proof.met),
        verdict + (" (outdated)" if proof.outdated else ""),
    )


def _band(proof: ComponentProof) -> str:
    """`94.1 ms, 93.5 to 94.8 ms`, as far as the samples tell."""
    if proof.value is None:
        return "cannot be told"
    value = show_value(proof.index, proof.value)
    if proof.lower is None or proof.upper is None:
        return value
    return f"{value}, {show_range(proof.index, proof.lower, proof.upper)}"


TRAIL = (
    *_fields("platform", "tuned", "number"),
    Column(field="components", title="Components together"),
    Column(field=RESERVE, title="Reserve"),
    *_fields("enough", "not met for sure by"),
    Column(field="predicted (% of the partition's VPs)", title="Predicted"),
    Column(title="Answer"),
    *_fields("claim"),
)


def trail_table(tunings: Iterable[PlatformTuning]) -> ReportTable:
    """Return a row a setting that tuning asked for, in order; the last says what is claimed of the layout."""
    return ReportTable(columns=TRAIL, rows=tuple(row for tuning in tunings for row in _trail(tuning)))


def _trail(tuning: PlatformTuning) -> Iterator[Row]:
    run = tuning.run
    for number, setting in enumerate(run.trail, 1):
        predicted = setting.predicted
        together = " + ".join(setting.components) + _outdated(tuning, setting.components)
        yield (
            tuning.platform,
            run.when,
            number,
            Cell(text=together, value="+".join(setting.components)),
            Cell(text=f"{setting.reserve} % of its VPs", value=setting.reserve),
            "no" if setting.worse else "yes",
            " ".join(setting.worse),
            None if predicted is None else Cell(text=f"{predicted} % of its VPs", value=predicted),
            f"not met for sure by {', '.join(setting.worse)}" if setting.worse else "all thresholds met",
            run.claim if number == len(run.trail) and run.strategy == "default" else "",
        )


def _outdated(tuning: PlatformTuning, components: Sequence[str]) -> str:
    return " (outdated)" if tuple(sorted(components)) in tuning.outdated else ""


TUNED = (
    Column(title="Partition", short="partition"),
    Column(title="Components", short="components", wraps=True),
    Column(title="Reserve", short="LP", style="strong", unit="LP", right=True),
    Column(title="CR", short="CR"),
    Column(title="Its parts apart", short="LP apart", unit="LP", right=True),
)


def tuned_table(tuning: PlatformTuning) -> ReportTable:
    """Return a row a partition as it was left, with what the parts of a new one reserved."""
    rows = (
        (
            part.name,
            ", ".join(part.components) + _outdated(tuning, part.components),
            part.reserved_lp,
            f"{part.reserve} % of its VPs",
            part.parts_lp,
        )
        for part in tuning.run.partitions
    )
    return ReportTable(columns=TUNED, rows=tuple(rows))


CANDIDATES = (Column(title="Components together"), Column(title="Reserve"))


def candidates_table(report: Report) -> ReportTable:
    """Return a row for each compound that could reserve less than its parts, at most `MOST_CANDIDATES`.

    Measured compounds come first, then those that may save most.
    """
    ranked = sorted(
        _compounds(report), key=lambda node: (not node.measured, node.low - node.high, len(node.members), node.name)
    )
    rows = ((" + ".join(node.members), node.label[-1]) for node in ranked[:MOST_CANDIDATES])
    return ReportTable(columns=CANDIDATES, rows=tuple(rows))


def candidates_left_out(report: Report) -> int:
    """Count the compounds that `candidates_table` leaves out."""
    return max(0, len(_compounds(report)) - MOST_CANDIDATES)


def _compounds(report: Report) -> list[Node]:
    return [node for node in report.candidates if node.parts and node.is_gain]
