"""The tables of the report: levels of performance, totals, settings, samples, proofs, and what tuning did.

The planner looks its reservations up in the logs, not here. Times of samples have the tenth of a microsecond that data
logs keep.
"""

from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction

from rarms_iac.app.report_model import (
    ComponentProof,
    FixedReservation,
    IndexCurve,
    MeasuredPoint,
    Measurement,
    PlatformCapacity,
    PlatformTuning,
    Report,
)
from rarms_iac.model.indexes import index_named
from rarms_iac.model.outcomes import Achievement, ReservationVerdict
from rarms_iac.planner.combining.candidates import Node
from rarms_iac.texts.indexes import show_range, show_value
from rarms_iac.texts.quantities import share_of_processors, show_reserve
from rarms_iac.views.graph import candidates_table
from rarms_iac.views.table import Cell, Column, Row, Table, finite
from rarms_iac.views.tune import partitions_table
from rarms_iac.views.verdicts import describe_achievement, describe_verdict, proof_time, short_bound

MOST_CANDIDATES = 24

TIME_PLACES = 4
"""Of a millisecond, as data logs keep a sample's times."""

RESERVE_LP = "reserve (LP)"
RESERVE = "reserve (% of the partition's VPs)"


def _fields(*headings: str) -> tuple[Column, ...]:
    """Make columns that only files have."""
    return tuple(Column(in_files=heading) for heading in headings)


OF_A_LOG = _fields("component", "measured with", "platform", "interference")


def _of_a_log(component: str, measurement: Measurement) -> Row:
    return component, measurement.name, measurement.platform, measurement.interference


LEVELS = (
    Column("component", in_files="component"),
    Column("platform", in_files="platform"),
    Column("threshold", wraps=True),
    *_fields("index", "direction", "threshold", "unit"),
    Column("expected", in_files="expected at the reserve", right=True),
    Column("load", page_only=True),
    Column("reservation", in_files=RESERVE_LP, style="strong", unit="LP", right=True),
    Column("CR", in_files=RESERVE, page_only=True),
    Column("verdict", in_files="verdict", wraps=True),
)


def levels_table(report: Report) -> Table:
    """Return a row for each threshold that decides a reservation, most critical first; then fixed and unmeasured."""
    return Table(LEVELS, tuple(row for _, row in _levels(report)))


def levels_of_component(report: Report, component: str) -> Table:
    """Return the rows of that table that are about a component, alone or with the others of its partition."""
    return Table(LEVELS, tuple(row for names, row in _levels(report) if component in names))


def _levels(report: Report) -> Iterator[tuple[Sequence[str], Row]]:
    """Yield the components that a row is about, and the row."""
    for measurement in report.measurements:
        if measurement.decides:
            for curve in measurement.indexes:
                if curve.threshold is not None:
                    yield (curve.component,), _level(measurement, curve)
    for capacity in report.capacities:
        for part in capacity.fixed:
            yield from _fixed(part, capacity.platform)
    shown = {measurement.components for measurement in report.measurements if measurement.decides}
    for names in dict.fromkeys(verdict.members for verdict in report.verdicts if verdict.members not in shown):
        yield names, _without_curve(" + ".join(names), None, None, Achievement.UNMEASURED)


def _level(measurement: Measurement, curve: IndexCurve) -> Row:
    assert curve.threshold is not None
    reserve, threshold = measurement.reserve, curve.threshold
    point = None if reserve is None else curve.curve.value_at(reserve)
    expected = None if point is None else show_value(curve.index, point.value, threshold)
    share = None if reserve is None else share_of_processors(reserve, measurement.processors)
    return (
        curve.component,
        measurement.platform,
        short_bound(curve.index, threshold),
        curve.index.name,
        curve.index.direction,
        threshold.value,
        curve.index.symbol,
        None if point is None else Cell(text=expected or "", value=finite(point.value)),
        measurement.interference,
        _reserved(measurement.reserved_lp),
        Cell(text=share or "", value=reserve),
        verdict_of(measurement.verdict, curve),
    )


def _fixed(part: FixedReservation, platform: str) -> Iterator[tuple[Sequence[str], Row]]:
    """Yield a row a threshold of a reserve that the manifest fixes; one row if its components have none."""
    whose, unknown = "fixed by the manifest", Cell(text="-")
    if not part.thresholds:
        nothing = (None,) * 4
        yield part.components, (part.name, platform, "none", *nothing, unknown, None, part.reserved_lp, None, whose)
    for component, name, threshold in part.thresholds:
        index = index_named(name)
        bound = short_bound(index, threshold), index.name, index.direction, threshold.value, index.symbol
        yield (component,), (component, platform, *bound, unknown, None, part.reserved_lp, None, whose)


def _without_curve(name: str, platform: str | None, reserved: Fraction | None, verdict: str) -> Row:
    return name, platform, *(None,) * 7, _reserved(reserved), None, verdict


def _reserved(amount: Fraction | None) -> Cell | Fraction:
    return Cell(text="not known") if amount is None else amount


def verdict_of(verdict: ReservationVerdict, curve: IndexCurve) -> str:
    """Return the verdict on a threshold in words."""
    own = (each.achievement for each in verdict.thresholds if (each.component, each.index) == _key(curve))
    words = describe_achievement(next(own, Achievement.UNMEASURED), verdict.not_measured)
    return f"{words} so far" if curve.index.is_extreme and words == Achievement.MET else words


def _key(curve: IndexCurve) -> tuple[str, str]:
    return curve.component, curve.index.name


def _verdict_word(curve: IndexCurve, point: MeasuredPoint) -> str:
    """Return the verdict; a maximum or minimum is only met so far. The page says the confidence once."""
    return "met so far" if curve.index.is_extreme and point.verdict == "met" else point.verdict or ""


TOTALS = _fields(
    "platform", "hosts", "capacity (LP)", "total is", "reserved (LP)", "not known yet", "headroom (LP)", "fits"
)


def totals_table(report: Report) -> Table:
    """Return a row a platform."""
    return Table(TOTALS, tuple(map(_total, report.capacities)))


def _total(fit: PlatformCapacity) -> Row:
    """Return a row without headroom while a reservation is unknown: then the total is at least the shown one."""
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
    Column("reservation", in_files=RESERVE),
    *_fields("processors (VPs)", "index", "unit"),
    Column("measured", in_files="value"),
    *_fields("interval from", "interval to"),
    Column("interval"),
    Column("samples", in_files="samples"),
    *_fields("effective samples", "failed samples", "direction", "threshold"),
    Column("verdict", in_files="verdict"),
    *_fields("error of the verdict (%)"),
    Column("remarks", in_files="remark"),
    *_fields("data log"),
)


def settings_table(report: Report) -> Table:
    """Return a row a setting and performance index."""
    curves = ((measurement, curve) for measurement in report.measurements for curve in measurement.indexes)
    return Table(SETTINGS, tuple(row for each in curves for row in settings_of(*each).rows))


def settings_of(measurement: Measurement, curve: IndexCurve) -> Table:
    """Return the rows of one performance index."""
    return Table(SETTINGS, tuple(_setting(measurement, curve, point) for point in curve.points))


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


def samples_table(report: Report) -> Table:
    """Return a row a sample, in the order in which they were measured."""
    return Table(SAMPLES, tuple(_samples(report)))


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
    Column("component"),
    Column("threshold", wraps=True),
    Column("host"),
    Column("load", wraps=True),
    Column("measured", right=True),
    Column("interval", page_only=True),
    Column("verdict", wraps=True, style="strong wrapping"),
    Column("proven", page_only=True, style="wrapping"),
)


def proofs_table(report: Report) -> Table:
    """Return a row for what each component showed when all ran together, in the report's order."""
    return Table(PROOFS, tuple(map(_proof, report.proofs)))


def _proof(proof: ComponentProof) -> Row:
    index, proven = proof.index, proof.proven
    verdict = describe_verdict(index, proven.verdict)
    value, lower, upper = proven.value, proven.lower, proven.upper
    return (
        proof.entry.component,
        short_bound(index, proven.threshold),
        proof.entry.host,
        proof.entry.interference or "no load",
        "not known" if value is None else show_value(index, value, proven.threshold),
        "" if value is None or lower is None or upper is None else show_range(index, lower, upper),
        Cell(text=verdict + (" (outdated)" if proof.outdated else ""), missed=not proven.met),
        f"{proof_time(proof)}, {proof.entry.reserve} % of its VPs"
        + (f"; outdated: {'; '.join(proof.outdated)}" if proof.outdated else ""),
    )


TRAIL = (
    *_fields("platform", "tuned", "number"),
    Column("components together", in_files="components"),
    Column("reservation", in_files=RESERVE),
    *_fields("enough", "not shown to be met by"),
    Column("predicted", in_files="predicted (% of the partition's VPs)"),
    Column("answer"),
    *_fields("claim"),
)


def trail_table(tunings: Iterable[PlatformTuning]) -> Table:
    """Return a row a setting that tuning asked for, in order; the last says what is claimed of the layout."""
    return Table(TRAIL, tuple(row for tuning in tunings for row in _trail(tuning)))


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
            f"not shown to be met by {', '.join(setting.worse)}" if setting.worse else "all thresholds met",
            run.claim if number == len(run.trail) and run.strategy == "default" else "",
        )


def _outdated(tuning: PlatformTuning, components: Sequence[str]) -> str:
    return " (outdated)" if tuple(sorted(components)) in tuning.outdated else ""


def tuned_table(tuning: PlatformTuning) -> Table:
    """Return a row a partition as it was left, with what the parts of a new one reserved."""
    return partitions_table(tuning.run.partitions, dict.fromkeys(tuning.outdated, " (outdated)"))


def ranked_candidates(report: Report) -> Table:
    """Return a row for each compound that could reserve less than its parts, at most `MOST_CANDIDATES`.

    Measured compounds come first, then those that may save most.
    """
    ranked = sorted(
        _compounds(report), key=lambda node: (not node.measured, node.low - node.high, len(node.members), node.name)
    )
    return candidates_table(ranked[:MOST_CANDIDATES])


def candidates_left_out(report: Report) -> int:
    """Count the compounds that `ranked_candidates` leaves out."""
    return max(0, len(_compounds(report)) - MOST_CANDIDATES)


def _compounds(report: Report) -> list[Node]:
    return [node for node in report.candidates if node.parts and node.is_gain]
