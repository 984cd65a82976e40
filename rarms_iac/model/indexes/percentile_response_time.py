"""The family of percentiles: `p50_response_time`, `p95_response_time`, `p99.9_response_time`."""

import re
from fractions import Fraction

from rarms_iac.model.indexes.interface import PerformanceIndex
from rarms_iac.model.quantities import Unit

PATTERN = r"^p([1-9][0-9]?)(\.[0-9]?[1-9])?_response_time$"
"""One spelling for each: no leading and no trailing zero."""

_NAME = re.compile(PATTERN.removesuffix("$") + r"\Z")


def percentile_of(name: str) -> Fraction | None:
    """The per cent in the name, None if it is not one of this family."""
    return Fraction(name[1 : name.index("_")]) if _NAME.match(name) else None


def percentile_index(name: str) -> PerformanceIndex | None:
    """The index of this name, None if it is not one of this family."""
    if _NAME.match(name) is None:
        return None
    return PerformanceIndex(
        name=name,
        unit=Unit.TIME,
        smaller_is_better=True,
        description=f"The response time that {name[1 : name.index('_')]} % of the jobs that answered do not exceed.",
    )
