"""The share of jobs that succeed."""

from rarms_iac.model.indexes.interface import PerformanceIndex
from rarms_iac.model.quantities import Unit

INDEX = PerformanceIndex(
    name="success_rate",
    unit=Unit.SHARE,
    smaller_is_better=False,
    description="The share of jobs that succeeded.",
)
