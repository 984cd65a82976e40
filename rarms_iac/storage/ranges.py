"""The least and the greatest value of every number that rarms reads from files and hosts.

A number counts or measures something, so it is not negative; fields of which more is known are in `RANGES`, by name, or
where classes differ by class and name.
"""

from collections.abc import Mapping
from math import inf

from rarms_iac.model.series import LARGEST_SAMPLE

Range = tuple[float, float]

ANY: Range = (-inf, inf)
COUNT: Range = (0, 2**64 - 1)
AT_LEAST_ONE: Range = (1, 2**64 - 1)
PERCENT: Range = (0, 100)
TIME: Range = (0, LARGEST_SAMPLE)
PROCESSORS: Range = (1, 2048)
"""As many as a manifest can give to a host."""

RANGES: Mapping[str, Range] = {
    "ahead_ms": ANY,
    "began_ms": ANY,
    "beside": PERCENT,
    "bits": (1, 128),
    "Claim.processors": (0, 2**20),
    "cores": PROCESSORS,
    "deadline_percent": PERCENT,
    "real_time_percent": PERCENT,
    "Diagnostic.values": ANY,
    "error": (0, 1),
    "generation": (0, 2),
    "limit": PERCENT,
    "logical": PROCESSORS,
    "logical_processors": PROCESSORS,
    "lower": ANY,
    "NamedValue.data": ANY,
    "processors": PROCESSORS,
    "RegistryValue.data": ANY,
    "Series.cpu_ms": TIME,
    "Series.elapsed_ms": TIME,
    "Setting.processors": (0, 2048),
    "Setting.spent_ms": TIME,
    "reserve": PERCENT,
    "thread_priority": (0, 31),
    "threads": (1, 2048),
    "times": AT_LEAST_ONE,
    "upper": ANY,
    "used": (1, 2048),
    "used_processors": PROCESSORS,
    "value": ANY,
    "weight": (0, 10_000),
}

BY_SETTING = frozenset({"Set.after", "Set.before", "Step.after", "Step.before"})
"""Fields that have readings by name: a number there has the range of the setting of its name."""


def range_of(record: str, field: str) -> Range:
    """Return the range of a number.

    Args:
        field: name of the field; numbers that it holds in a collection have the same range.

    Returns:
        The least and the greatest value.
    """
    return RANGES.get(f"{record}.{field}") or RANGES.get(field, COUNT)
