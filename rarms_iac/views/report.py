"""The report in the terminal, and for programs."""

from collections.abc import Iterator
from math import isfinite

from rarms_iac.app.report_model import IndexCurve, Measurement, Report
from rarms_iac.statistics.verdicts import ERRORS_EXPLAINED
from rarms_iac.views.as_json import as_json
from rarms_iac.views.diagnostics.layout import wrap
from rarms_iac.views.output.combining import AskedOutput
from rarms_iac.views.output.measuring import (
    ReportCapacityOutput,
    ReportDifferenceOutput,
    ReportIndexOutput,
    ReportMeasurementOutput,
    ReportOutput,
    ReportPointOutput,
    ReportRowOutput,
    ReportStandingOutput,
    ReportTuningOutput,
)
from rarms_iac.views.plot import plot_text
from rarms_iac.views.reports.summary import (
    fit_text,
    fits_of,
    proofs_of,
    standing_text,
    summary_of,
    trail_of,
    tuned_of,
    tuning_text,
)
from rarms_iac.views.table import table


def report_text(report: Report, *, width: int = 80, ascii_only: bool = False, colour: bool = False) -> str:
    """The summary, each host's total, and a plot of every curve."""
    return "\n".join(_parts(report, width, ascii_only=ascii_only, colour=colour))


def _parts(report: Report, width: int, *, ascii_only: bool, colour: bool) -> Iterator[str]:
    rows = [(level.component, level.index, level.level, level.reserve, level.bandwidth) for level in summary_of(report)]
    yield table([("component", "index", "threshold", "CR", "bandwidth"), *rows], width)
    for fit in fits_of(report):
        yield "\n".join(wrap(f"{', '.join(fit.of.hosts)}: {fit_text(fit)}", width, "")) + "\n"
    for host in report.standings:
        yield "\n".join(wrap(f"{host.host}: {standing_text(host)}", width, "")) + "\n"
    if report.proofs:
        proven = [(proof.component, proof.index, proof.level, proof.shows, proof.result) for proof in proofs_of(report)]
        yield table([("all together", "index", "threshold", "observed", "result"), *proven], width)
    for tuning in report.tunings:
        yield "\n".join(wrap(f"combining on {tuning.platform}: {tuning_text(tuning)}", width, "")) + "\n"
        yield table([("partition", "components", "CR", "bandwidth", "apart"), *tuned_of(tuning)], width)
        yield table([("asked for", "CR", "predicted", "answer"), *trail_of(tuning)], width)
    yield "\n".join(wrap(ERRORS_EXPLAINED, width, "")) + "\n"
    for measurement in report.measurements:
        for index in measurement.indexes:
            yield (
                f"{measurement.name} against {measurement.interference} on {measurement.platform}{_remark(measurement)}"
            )
            yield plot_text(index, width=width, ascii_only=ascii_only, colour=colour)


def _remark(measurement: Measurement) -> str:
    if measurement.stale:
        return f" (stale: {'; '.join(measurement.stale)})"
    return "" if measurement.rests else " (to compare: no reservation rests on it)"


def report_json(report: Report) -> str:
    """The same for programs; a side of a band without a bound is null."""
    return as_json(
        ReportOutput(
            application=report.application,
            measurements=tuple(_measurement(measurement) for measurement in report.measurements),
            capacities=tuple(
                ReportCapacityOutput(
                    platform=fit.of.platform,
                    hosts=fit.of.hosts,
                    capacity=float(fit.of.capacity),
                    reserved=float(fit.total),
                    fits=fit.fits,
                )
                for fit in fits_of(report)
            ),
            tunings=tuple(
                ReportTuningOutput(
                    platform=tuning.platform,
                    when=tuning.run.when,
                    strategy=tuning.run.strategy,
                    ending=tuning.run.ending,
                    proved=tuning.run.proved,
                    claim=tuning.run.claim,
                    before=tuning.run.before,
                    after=tuning.run.after,
                    trail=tuple(
                        AskedOutput(
                            components=asked.components,
                            reserve=asked.reserve,
                            met=not asked.worse,
                            worse=asked.worse,
                            predicted=asked.predicted,
                        )
                        for asked in tuning.run.trail
                    ),
                )
                for tuning in report.tunings
            ),
            standings=tuple(
                ReportStandingOutput(
                    host=standing.host,
                    is_planned=standing.is_planned,
                    differs=tuple(ReportDifferenceOutput(address=what, says=says) for what, says in standing.differs),
                )
                for standing in report.standings
            ),
        )
    )


def _measurement(measurement: Measurement) -> ReportMeasurementOutput:
    return ReportMeasurementOutput(
        components=measurement.components,
        platform=measurement.platform,
        interference=measurement.interference,
        log=measurement.path,
        processors=measurement.processors,
        rests=measurement.rests,
        stale=measurement.stale,
        reserve=measurement.reserve,
        interpolated=measurement.least is not None and measurement.least.interpolated,
        indexes=tuple(_index(index) for index in measurement.indexes),
    )


def _index(shown: IndexCurve) -> ReportIndexOutput:
    return ReportIndexOutput(
        component=shown.component,
        index=shown.index.name,
        direction=shown.index.direction,
        threshold=None if shown.threshold is None else float(shown.threshold.value),
        reserve=None if shown.least is None else shown.least.reserve,
        points=tuple(
            ReportPointOutput(
                reserve=point.reserve,
                value=point.value,
                low=_finite(point.low),
                high=_finite(point.high),
                samples=point.samples,
                failed=point.failed,
                verdict=point.verdict,
                error=point.error,
            )
            for point in shown.points
        ),
        curve=tuple(
            ReportRowOutput(reserve=row.reserve, value=_finite(row.value), safe=_finite(row.safe)) for row in shown.rows
        ),
    )


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None
