"""What a setting shows: every index that a threshold names, with its bounds. Pure."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from rarms_iac.model.experiment import Experiment
from rarms_iac.model.indexes import index_named
from rarms_iac.model.outcomes import Estimate, Missed, NoEstimate, Overload, Unsteady, Verdict
from rarms_iac.model.output import output
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.series import Series
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import AtLeast, AtMost, Component, Threshold, run_of
from rarms_iac.statistics.overload import estimate_of_setting
from rarms_iac.statistics.steady_state import steady_part
from rarms_iac.statistics.verdicts import judge_look


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredIndex:
    """One index of a component against its threshold."""

    component: str
    index: str
    threshold: Threshold
    estimate: Estimate | None
    reason: str = ""  # why there is no estimate
    overload: Overload | None = None  # where the component falls behind, so that the index grows without an end

    @output
    def unit(self) -> str:
        """Of threshold and estimate."""
        return index_named(self.index).symbol

    @property
    def misses(self) -> bool:
        """Whether what was seen is on the wrong side; without an estimate nothing shows that it is not."""
        if self.estimate is None:
            return True
        match self.threshold:
            case AtMost(value=limit):
                return self.estimate.value > float(limit)
            case AtLeast(value=limit):
                return self.estimate.value < float(limit)


def measured_indexes(setting: Setting, experiment: Experiment) -> tuple[MeasuredIndex, ...]:
    """Estimate every index of every member's APT at this setting.

    Returns:
        By member, then in the order of its APT.
    """
    return indexes_of_series(experiment.members, {series.component: series for series in setting.series})


def indexes_of_series(components: tuple[Component, ...], seen: Mapping[str, Series]) -> tuple[MeasuredIndex, ...]:
    """Estimate every index of every component's APT from these series; components without one are left out.

    Args:
        components: with their APTs.
        seen: series by component.

    Returns:
        By component as given, then in the order of its APT.
    """
    return tuple(
        _measured_index(component, index, threshold, seen[component.name])
        for component in components
        if component.name in seen
        for index, threshold in component.apt.items()
    )


def shortfall_at(reserve: ReservePercent, settings: Iterable[Setting], experiment: Experiment) -> Verdict | None:
    """Say why settings at this CR, where not every threshold was met for sure, did not meet them.

    Strict, and with the error of a verdict, as a report judges a setting.

    Returns:
        `Missed` where a threshold was shown to be missed, else `Unsteady` where that kept samples from telling, else
        another verdict; None: there are no such settings.
    """
    verdicts = [
        judge_look(series, member.apt, experiment.runs[member.name], members=len(experiment.members))
        for setting in settings
        if setting.reserve == reserve
        for member in experiment.members
        for series in setting.series
        if series.component == member.name and member.apt
    ]
    most_telling = [verdict for kind in (Missed, Unsteady) for verdict in verdicts if isinstance(verdict, kind)]
    return next(iter([*most_telling, *verdicts]), None)


def why_unsteady(series: Series) -> str:
    """Say why the series has no steady state; empty where it has one.

    Returns:
        The reason in words.
    """
    part = steady_part(series)
    return part.reason if isinstance(part, Unsteady) else ""


def _measured_index(component: Component, index: str, threshold: Threshold, series: Series) -> MeasuredIndex:
    estimate = estimate_of_setting(index, series, run_of(component))
    measured = MeasuredIndex(component=component.name, index=index, threshold=threshold, estimate=None)
    if isinstance(estimate, NoEstimate):
        return replace(measured, reason=estimate.reason, overload=estimate.overload)
    return replace(measured, estimate=estimate)
