"""The share of late jobs."""

from rarms_iac.model.indexes.interface import PerformanceIndex
from rarms_iac.model.quantities import Unit

INDEX = PerformanceIndex(
    name="deadline_miss_rate",
    unit=Unit.SHARE,
    smaller_is_better=True,
    description="The share of jobs that answered after their deadline, or not at all.",
)
