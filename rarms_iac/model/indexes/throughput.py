"""How much is done in a time."""

from rarms_iac.model.indexes.interface import PerformanceIndex, SampleValue
from rarms_iac.model.quantities import Unit

INDEX = PerformanceIndex(
    name="throughput",
    unit=Unit.RATE,
    smaller_is_better=False,
    description="Successful jobs (or what they count) over the elapsed time.",
    made_of=SampleValue.COUNT,
)
