"""Components that run on this machine without any reservation, one after the other or together."""

from collections.abc import Mapping
from dataclasses import dataclass

from rarms_iac.model.measurement import Series
from rarms_iac.model.outcomes import Estimate, NoEstimate
from rarms_iac.model.system import AtLeast, AtMost, Component, Run, Threshold
from rarms_iac.running.samples import RunEnding
from rarms_iac.statistics.estimates import estimate


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentRunResult:
    """A component that was run, and what it showed."""

    component: Component
    run: Run
    series: Series
    ending: RunEnding

    @property
    def failed(self) -> int:
        """How many of the samples are failed ones."""
        return sum(bool(sample.failure) for sample in self.series.samples)

    @property
    def estimates(self) -> Mapping[str, Estimate | NoEstimate]:
        """Every index of the APT; without one, how long its jobs took and how many succeeded."""
        indexes = tuple(self.component.apt) or ("mean_response_time", "success_rate")
        return {index: estimate(index, self.series, self.run) for index in indexes}

    @property
    def missed(self) -> tuple[str, ...]:
        """The indexes that are on the wrong side of their threshold beyond what is noise."""
        found = self.estimates
        return tuple(
            index
            for index, threshold in self.component.apt.items()
            if isinstance(one := found[index], Estimate) and not (meets(one.value, threshold) or noise(one, threshold))
        )


def meets(value: float, threshold: Threshold) -> bool:
    """Whether a value is good enough."""
    match threshold:
        case AtMost(value=most):
            return value <= most
        case AtLeast(value=least):
            return value >= least


def noise(found: Estimate, threshold: Threshold) -> bool:
    """Whether the truth may lie on the other side of the threshold than the value."""
    return meets(found.lower, threshold) is not meets(found.upper, threshold)
