"""The report for programs."""

from math import isfinite

from rarms_iac.app.report_model import IndexCurve, Measurement, Report
from rarms_iac.views.as_json import as_json
from rarms_iac.views.output.combining import AskedOutput
from rarms_iac.views.output.common import output_of
from rarms_iac.views.output.measuring import (
    ReportCapacityOutput,
    ReportDifferenceOutput,
    ReportIndexOutput,
    ReportMeasurementOutput,
    ReportOutput,
    ReportPointOutput,
    ReportRowOutput,
    ReportStatusOutput,
    ReportTuningOutput,
)
from rarms_iac.views.reports.summary import platform_fits


def report_json(report: Report) -> str:
    """The same for programs; a side of a band without a bound is null."""
    return as_json(
        ReportOutput(
            application=report.application,
            measurements=tuple(_measurement(measurement) for measurement in report.measurements),
            capacities=tuple(
                ReportCapacityOutput(
                    platform=fit.capacity.platform,
                    hosts=fit.capacity.hosts,
                    capacity=float(fit.capacity.capacity),
                    reserved=float(fit.total),
                    fits=fit.fits,
                )
                for fit in platform_fits(report)
            ),
            tunings=tuple(
                output_of(
                    ReportTuningOutput,
                    tuning.run,
                    platform=tuning.platform,
                    trail=tuple(output_of(AskedOutput, asked, met=not asked.worse) for asked in tuning.run.trail),
                )
                for tuning in report.tunings
            ),
            statuses=tuple(
                ReportStatusOutput(
                    host=status.host,
                    is_planned=status.is_planned,
                    differs=tuple(
                        ReportDifferenceOutput(address=what, says=message) for what, message in status.differs
                    ),
                )
                for status in report.statuses
            ),
        )
    )


def _measurement(measurement: Measurement) -> ReportMeasurementOutput:
    return output_of(
        ReportMeasurementOutput,
        measurement,
        log=measurement.path,
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
            output_of(ReportPointOutput, point, low=_finite(point.low), high=_finite(point.high))
            for point in shown.points
        ),
        curve=tuple(
            ReportRowOutput(reserve=row.reserve, value=_finite(row.value), safe=_finite(row.safe)) for row in shown.rows
        ),
    )


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None
