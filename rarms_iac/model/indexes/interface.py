"""What every performance index says of itself."""

from dataclasses import dataclass
from enum import StrEnum

from rarms_iac.model.quantities import Unit


class SampleValue(StrEnum):
    """What an index needs of each sample, by the key of `run.samples` that says where it stands."""

    RESPONSE_TIME = "response_time"
    SUCCESS = "success"
    COUNT = "count"  # or, where nothing is counted, that there was a sample at all


@dataclass(frozen=True, slots=True, kw_only=True)
class PerformanceIndex:
    """A component-specific measure (PI); its threshold (APT) says which side of a value is good enough."""

    name: str
    unit: Unit
    smaller_is_better: bool
    description: str
    made_of: SampleValue = SampleValue.RESPONSE_TIME

    @property
    def direction(self) -> str:
        """The word of a threshold that makes sense: `at_most` or `at_least`."""
        return "at_most" if self.smaller_is_better else "at_least"
