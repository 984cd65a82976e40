"""Performance indexes (PI), one small file each: a new one is one more file and one more line here."""

from rarms_iac.model.indexes import (
    deadline_miss_rate,
    jitter,
    maximum_response_time,
    mean_response_time,
    minimum_response_time,
    success_rate,
    throughput,
)
from rarms_iac.model.indexes.interface import PerformanceIndex, SampleValue
from rarms_iac.model.indexes.percentile_response_time import PATTERN as PERCENTILE_PATTERN
from rarms_iac.model.indexes.percentile_response_time import percentile_index, percentile_of

INDEXES: dict[str, PerformanceIndex] = {
    module.INDEX.name: module.INDEX
    for module in (
        mean_response_time,
        minimum_response_time,
        maximum_response_time,
        jitter,
        success_rate,
        throughput,
        deadline_miss_rate,
    )
}
"""Those with a name of their own; percentiles are a family besides."""


def find_index(name: str) -> PerformanceIndex | None:
    """The index of this name, None if there is none."""
    return INDEXES.get(name) or percentile_index(name)


__all__ = [
    "INDEXES",
    "PERCENTILE_PATTERN",
    "PerformanceIndex",
    "SampleValue",
    "find_index",
    "percentile_index",
    "percentile_of",
]
