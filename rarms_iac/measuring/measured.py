"""What a setting shows: every index that a threshold names, with its bounds. Pure."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from rarms_iac.measuring.setup import Experiment
from rarms_iac.model.measurement import Series, Setting, run_of
from rarms_iac.model.system import AtLeast, AtMost, Component, Run, Threshold
from rarms_iac.statistics import samples as values
from rarms_iac.statistics.estimates import Estimate, NoEstimate, estimate
from rarms_iac.statistics.steady_state import Steady, Unsteady, steady_part
from rarms_iac.statistics.verdicts import VERDICT_ERROR, Missed, judge, part_for

Below = Literal["missed", "within the noise", "no steady state"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """One index of a component beside its threshold."""

    component: str
    index: str
    threshold: Threshold
    estimate: Estimate | None
    why: str = ""  # there is none

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


def shown(setting: Setting, experiment: Experiment) -> tuple[Shown, ...]:
    """Every index of every member's APT at this setting."""
    by_name = {series.component: series for series in setting.series}
    return shown_of(experiment.members, by_name)


def shown_of(components: tuple[Component, ...], seen: Mapping[str, Series]) -> tuple[Shown, ...]:
    """The same of series that were seen elsewhere; components without one are left out."""
    return tuple(
        _shown(component, index, threshold, seen[component.name])
        for component in components
        if component.name in seen
        for index, threshold in component.apt.items()
    )


def shown_at(reserve: int, settings: Iterable[Setting], experiment: Experiment) -> Below:
    """What settings at this CR, where not every threshold was met for sure, show of them.

    Strict, and with the error of a verdict, as a report judges a setting.
    """
    verdicts = [
        judge(series, member.apt, experiment.runs[member.name], error=VERDICT_ERROR / len(experiment.members))
        for setting in settings
        if setting.reserve == reserve
        for member in experiment.members
        for series in setting.series
        if series.component == member.name and member.apt
    ]
    if any(isinstance(verdict, Missed) for verdict in verdicts):
        return "missed"
    return "no steady state" if any(isinstance(verdict, Unsteady) for verdict in verdicts) else "within the noise"


def steady(series: Series) -> str:
    """Why the series has no steady state; empty where it has one."""
    found = steady_part(values.response_times(series.samples))
    return "" if isinstance(found, Steady) else found.why


def _shown(component: Component, index: str, threshold: Threshold, series: Series) -> Shown:
    found = _estimated(series, index, run_of(component))
    if isinstance(found, NoEstimate):
        return Shown(component=component.name, index=index, threshold=threshold, estimate=None, why=found.why)
    return Shown(component=component.name, index=index, threshold=threshold, estimate=found)


def _estimated(series: Series, index: str, run: Run) -> Estimate | NoEstimate:
    """Of the steady part: a series that has none says nothing about the next hour."""
    begin = steady_part(values.response_times(series.samples))
    if isinstance(begin, Unsteady):
        return NoEstimate(why=begin.why)
    return estimate(index, part_for(index, series, begin.first), run)
