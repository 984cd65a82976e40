"""What was measured: the summary a component, and the same for programs."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Literal, assert_never

from rarms_iac.measuring.findings import show_threshold, show_value
from rarms_iac.measuring.performance import MeasuredIndex, measured_indexes, shortfall_at
from rarms_iac.measuring.setup import Experiment
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.measurement import Setting
from rarms_iac.model.outcomes import Conclusion, NotAchievable, NotResolved, SettingFailed, Stopped, Sufficient, Swept
from rarms_iac.model.phrases import in_a_row
from rarms_iac.model.system import AtLeast, AtMost
from rarms_iac.statistics.curves import LeastReserve
from rarms_iac.statistics.verdicts import ERRORS_EXPLAINED, show_error
from rarms_iac.views.as_json import as_json
from rarms_iac.views.diagnostics.layout import wrap
from rarms_iac.views.output.measuring import ExperimentOutput, IndexOutput, MeasureOutput, SettingOutput
from rarms_iac.views.table import table

Ending = Literal["found", "not_achievable", "not_resolved", "no_verdict", "swept", "stopped"]


Row = tuple[str, str, str, str, str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """An experiment with its end."""

    experiment: Experiment
    conclusion: Conclusion
    settings: tuple[Setting, ...]  # all that its end rests on
    new: int  # how many of them were run now
    planned: LeastReserve | None  # what a plan reserves by the curve
    log: str  # path


def summary_text(results: Sequence[Measured], width: int, waiting: Sequence[Experiment] = ()) -> str:
    """A table, a row an index of a component; the reservation and its verdict stand in the first row of each.

    Where verdicts have errors, what these mean stands below.
    """
    rows = [("component", "threshold", "CR", "verdict", "wrong in", "settings")]
    for result in results:
        rows += list(_rows(result))
    for experiment in waiting:
        rows += list(_members(experiment, "-", "not begun", "", ""))
    judged = any(isinstance(result.conclusion, Sufficient | NotAchievable) for result in results)
    return table(rows, width) + ("\n" + "\n".join(wrap(ERRORS_EXPLAINED, width, "")) + "\n" if judged else "")


def settings_text(measured: Measured, width: int) -> str:
    """A table, a row a setting in the order of their reservations: what a level is picked from."""
    names = [(member.name, index) for member in measured.experiment.members for index in member.apt]
    heads = [f"{name} {index}" if len(measured.experiment.members) > 1 else index for name, index in names]
    rows = [("CR", *heads)]
    for setting in sorted(measured.settings, key=lambda each: (each.reserve, each.seed)):
        found = {(each.component, each.index): each for each in measured_indexes(setting, measured.experiment)}
        rows.append((f"{setting.reserve} %", *(show_band(found[name]) for name in names)))
    return table(rows, width)


def show_band(shown: MeasuredIndex) -> str:
    """`97.7 ms (97.1 to 98.2 ms)`; of an extreme, what was seen; without an estimate, why."""
    if shown.estimate is None:
        return shown.reason
    value, lower, upper = (
        show_value(shown.index, each) for each in (shown.estimate.value, shown.estimate.lower, shown.estimate.upper)
    )
    return value if shown.estimate.beyond is not None else f"{value} ({lower.rpartition(' ')[0]} to {upper})"


def _rows(measured: Measured) -> Iterator[Row]:
    new = f", {measured.new} new" if measured.new else ""
    reserve, verdict = _verdict(measured)
    error = _error(measured)
    yield from _members(measured.experiment, reserve, verdict, error, f"{len(measured.settings)}{new}")


def _error(measured: Measured) -> str:
    """How often the verdict is wrong at most; NOTE: of an extreme nobody can say, however often it was met so far."""
    if not isinstance(measured.conclusion, Sufficient | NotAchievable):
        return ""
    return "so far" if _only_extremes(measured, measured.conclusion.reserve) else show_error(measured.conclusion.error)


def _only_extremes(measured: Measured, reserve: int) -> bool:
    seen = [
        each
        for setting in measured.settings
        if setting.reserve == reserve
        for each in measured_indexes(setting, measured.experiment)
    ]
    return bool(seen) and all(each.estimate is not None and each.estimate.beyond is not None for each in seen)


def _members(experiment: Experiment, reserve: str, verdict: str, error: str, used: str) -> Iterator[Row]:
    for member in experiment.members:
        for index, threshold in member.apt.items():
            yield member.name, f"{index} {show_threshold(index, threshold)}", reserve, verdict, error, used
            reserve = verdict = error = used = ""
        if not member.apt:
            yield member.name, "none", reserve, verdict, error, used


def _verdict(measured: Measured) -> tuple[str, str]:
    """The CR and what is known of it; NOTE: a plan rests on the curve, so where the two differ both are told."""
    match measured.conclusion:
        case Sufficient(reserve=reserve, failed=failed, inconclusive=inconclusive):
            return (
                f"{reserve} %",
                f"enough{_below(measured, failed)}{_inconclusive(inconclusive)}{_planned(measured, reserve)}",
            )
        case NotAchievable(reserve=reserve):
            return "-", f"not achievable at {reserve} %"
        case NotResolved():
            return "-", f"not resolved{_planned(measured, None)}"
        case SettingFailed(reserve=reserve):
            return "-", f"too many failed samples at {reserve} %"
        case Swept():
            return "-", f"measured{_planned(measured, None)}"
        case Stopped():
            return "-", "stopped"
        case _:
            assert_never(measured.conclusion)


def _below(measured: Measured, failed: int | None) -> str:
    """The highest lower setting that was not shown to be enough; NOTE: that is not yet shown to be too little."""
    if not failed:
        return ""
    match shortfall_at(failed, measured.settings, measured.experiment):
        case "missed":
            return f", {failed} % is not"
        case "within the noise":
            return f", {failed} % within the noise"
        case "no steady state":
            return f", {failed} % without a steady state"


def _inconclusive(reserves: Sequence[int]) -> str:
    """Those between, of which nothing is known: they are neither enough nor too little."""
    return f", {in_a_row(reserves)} % without a steady state" if reserves else ""


def _planned(measured: Measured, reserve: int | None) -> str:
    planned = measured.planned
    if planned is None or planned.reserve == reserve:
        return ""
    between = ", interpolated" if planned.interpolated else ""
    return f"; a plan reserves {planned.reserve} %{between}"


def measure_json(
    results: Sequence[Measured], findings: tuple[Diagnostic, ...], waiting: Sequence[Experiment] = ()
) -> str:
    """The same for programs, every setting with it."""
    not_begun = tuple(experiment.setup.members for experiment in waiting)
    return as_json(MeasureOutput(experiments=tuple(map(_output, results)), not_begun=not_begun, findings=findings))


def _output(measured: Measured) -> ExperimentOutput:
    conclusion, experiment = measured.conclusion, measured.experiment
    return ExperimentOutput(
        components=experiment.setup.members,
        host=experiment.host.name,
        platform=experiment.host.platform,
        interference=experiment.setup.interference,
        log=measured.log,
        ending=_ending(conclusion),
        reserve=conclusion.reserve if isinstance(conclusion, Sufficient) else None,
        failed=conclusion.failed if isinstance(conclusion, Sufficient) else None,
        undecided=isinstance(conclusion, Sufficient)
        and conclusion.failed is not None
        and shortfall_at(conclusion.failed, measured.settings, experiment) != "missed",
        untold=conclusion.inconclusive if isinstance(conclusion, Sufficient) else (),
        error=conclusion.error if isinstance(conclusion, Sufficient | NotAchievable) else None,
        planned=measured.planned.reserve if measured.planned else None,
        interpolated=bool(measured.planned and measured.planned.interpolated),
        settings=tuple(_setting(each, experiment) for each in measured.settings),
        new_settings=measured.new,
    )


def _ending(conclusion: Conclusion) -> Ending:
    match conclusion:
        case Sufficient():
            return "found"
        case NotAchievable():
            return "not_achievable"
        case NotResolved():
            return "not_resolved"
        case SettingFailed():
            return "no_verdict"
        case Swept():
            return "swept"
        case Stopped():
            return "stopped"
        case _:
            assert_never(conclusion)


def _setting(setting: Setting, experiment: Experiment) -> SettingOutput:
    return SettingOutput(
        reserve=setting.reserve,
        beside=setting.beside,
        seed=setting.seed,
        indexes=index_outputs(measured_indexes(setting, experiment)),
    )


def index_outputs(found: Sequence[MeasuredIndex]) -> tuple[IndexOutput, ...]:
    """Indexes for programs; a bound that says nothing is null."""
    return tuple(_index(one) for one in found)


def _index(shown: MeasuredIndex) -> IndexOutput:
    seen = shown.estimate
    return IndexOutput(
        component=shown.component,
        index=shown.index,
        at_most=float(shown.threshold.value) if isinstance(shown.threshold, AtMost) else None,
        at_least=float(shown.threshold.value) if isinstance(shown.threshold, AtLeast) else None,
        value=seen.value if seen else None,
        lower=seen.lower if seen and isfinite(seen.lower) else None,
        upper=seen.upper if seen and isfinite(seen.upper) else None,
        error=seen.error if seen else None,
        samples=seen.samples if seen else 0,
    )
