"""The report for programs."""

from collections.abc import Mapping
from math import isfinite

from rarms_iac.app.report_model import IndexCurve, Measurement, Report
from rarms_iac.model.quantities import guaranteed
from rarms_iac.views.json_output import json_of
from rarms_iac.views.output.combining import TrailSettingOutput
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
    hosts = {capacity.platform: capacity.hosts for capacity in report.capacities}
    return json_of(
        ReportOutput(
            application=report.application,
            measurements=tuple(_measurement(measurement, hosts) for measurement in report.measurements),
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
                    trail=tuple(
                        output_of(TrailSettingOutput, setting, met=not setting.worse) for setting in tuning.run.trail
                    ),
                )
                for tuning in report.tunings
            ),
            statuses=tuple(
                ReportStatusOutput(
                    host=status.host,
                    is_planned=status.is_planned,
                    differs=tuple(
                        ReportDifferenceOutput(address=address, message=message) for address, message in status.differs
                    ),
                )
                for status in report.statuses
            ),
        )
    )


def _measurement(measurement: Measurement, hosts: Mapping[str, tuple[str, ...]]) -> ReportMeasurementOutput:
    reserve = measurement.reserve
    return output_of(
        ReportMeasurementOutput,
        measurement,
        hosts=hosts.get(measurement.platform, ()),
        reserved_processors=None if reserve is None else float(guaranteed(reserve, measurement.processors)),
        log=measurement.path,
        interpolated=measurement.least is not None and measurement.least.interpolated,
        indexes=tuple(_index(index) for index in measurement.indexes),
    )


def _index(index_curve: IndexCurve) -> ReportIndexOutput:
    return ReportIndexOutput(
        component=index_curve.component,
        index=index_curve.index.name,
        unit=index_curve.index.symbol,
        direction=index_curve.index.direction,
        threshold=None if index_curve.threshold is None else float(index_curve.threshold.value),
        reserve=None if index_curve.least is None else index_curve.least.reserve,
        points=tuple(
            output_of(ReportPointOutput, point, low=_finite(point.low), high=_finite(point.high))
            for point in index_curve.points
        ),
        curve=tuple(
            ReportRowOutput(reserve=row.reserve, value=_finite(row.value), safe=_finite(row.safe))
            for row in index_curve.rows
        ),
    )


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None
