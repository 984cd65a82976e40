"""The settings of a sweep: each with its measured value, bounds and verdict."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rarms_iac.app.report_measurements import WITHOUT_APT, point_of
from rarms_iac.app.report_model import MeasuredPoint
from rarms_iac.measuring.measure_request import ExperimentResult
from rarms_iac.model.indexes import PerformanceIndex, index_named, show_bound, show_range, show_value
from rarms_iac.model.quantities import guaranteed, show_percent, show_processors
from rarms_iac.model.system import Component
from rarms_iac.views.console import Table, paragraph
from rarms_iac.views.prove import describe_verdict

if TYPE_CHECKING:
    from rich.console import RenderableType

HEADER = ("reservation", "CR", "measured", "bounds", "verdict", "remark")


def sweep_text(result: ExperimentResult) -> "Iterator[RenderableType]":
    """Show a table for each performance index of the components. A setting is a row; the smallest reservation is first.

    Args:
        result: of components that were measured together with one load.
    """
    for member in result.experiment.members:
        for name in member.apt or (WITHOUT_APT,):
            yield paragraph(_heading(result, member, index_named(name)))
            rows = list(_rows(result, member, index_named(name)))
            shown = len(HEADER) if any(row[-1] for row in rows) else len(HEADER) - 1
            yield Table([row[:shown] for row in rows], header=HEADER[:shown], wrap=range(3, shown), right=(0, 1))
            yield ""


def _heading(result: ExperimentResult, member: Component, index: PerformanceIndex) -> str:
    """Describe the measurement: `vision with busy-loop on onboard: mean_response_time <= 50 ms.`."""
    threshold = member.apt.get(index.name)
    bound = f" {show_bound(index, threshold)}" if threshold is not None else ", no threshold"
    number = result.experiment.setup.processors
    processors = f"its {number} VP{'s' if number > 1 else ''}"
    place = f"{member.name} with {result.interference} on {result.platform}"
    return f"{place}: {index.name}{bound}. CR is per cent of {processors}."


def _rows(result: ExperimentResult, member: Component, index: PerformanceIndex) -> Iterator[tuple[str, ...]]:
    threshold, run = member.apt.get(index.name), result.experiment.runs[member.name]
    apt = {} if threshold is None else {index.name: threshold}
    for setting in sorted(result.settings, key=lambda each: (each.reserve, each.seed)):
        amount = show_processors(guaranteed(setting.reserve, result.experiment.setup.processors))
        for series in setting.series:
            if series.component == member.name:
                point = point_of(setting, series, index.name, apt, run)
                yield amount, show_percent(setting.reserve), *_describe(index, point)


def _describe(index: PerformanceIndex, point: MeasuredPoint) -> tuple[str, str, str, str]:
    verdict = "" if point.verdict is None else describe_verdict(index, point.verdict)
    failed = f"{point.failed} of {point.samples} samples failed" if point.failed else ""
    remark = "; ".join(filter(None, (point.remark, failed)))
    if point.value is None:
        return "-", "", verdict, remark
    return show_value(index, point.value), show_range(index, point.low, point.high), verdict, remark
