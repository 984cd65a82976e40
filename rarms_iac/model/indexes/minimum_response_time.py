"""The shortest response time."""

from rarms_iac.model.indexes.interface import PerformanceIndex
from rarms_iac.model.quantities import Unit

INDEX = PerformanceIndex(
    name="minimum_response_time",
    unit=Unit.TIME,
    smaller_is_better=True,
    description="The shortest response time of all jobs that answered.",
)
