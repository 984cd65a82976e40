"""The share of jobs that succeed."""

from rarms_iac.model.indexes.interface import PerformanceIndex, SampleValue
from rarms_iac.model.quantities import Unit

INDEX = PerformanceIndex(
    name="success_rate",
    unit=Unit.SHARE,
    smaller_is_better=False,
    description="The share of jobs that succeeded.",
    made_of=SampleValue.SUCCESS,
)
