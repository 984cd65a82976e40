"""How much response times vary."""

from rarms_iac.model.indexes.interface import PerformanceIndex
from rarms_iac.model.quantities import Unit

INDEX = PerformanceIndex(
    name="jitter",
    unit=Unit.TIME,
    smaller_is_better=True,
    description="The standard deviation of the response times of all jobs that answered.",
)
