"""Performance indexes (PI): what can be measured of a component; a new one is one more entry here.

How an index follows from samples is in `statistics/estimates.py`; its threshold is the component's APT.
"""

import re
from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction

from rarms_iac.model.output import OutputText
from rarms_iac.model.quantities import Unit, parse_quantity
from rarms_iac.model.system import AtLeast, AtMost, Threshold

PERCENTILE_PATTERN = r"^p([1-9][0-9]?)(\.[0-9]?[1-9])?_response_time$"
"""The family `p50_response_time`, `p99.9_response_time`; one spelling for each: no leading and no trailing zero."""

_SYMBOLS = {Unit.TIME: "ms", Unit.SHARE: "%", Unit.RATE: "/s"}

_PERCENTILE = re.compile(PERCENTILE_PATTERN.removesuffix("$") + r"\Z")


class SampleValue(StrEnum):
    """The part of a sample that an index needs, by the key of `run.samples` that says where it stands."""

    RESPONSE_TIME = "response_time"
    SUCCESS = "success"
    COUNT = "count"  # or, where nothing is counted, that there was a sample at all


@dataclass(frozen=True, slots=True, kw_only=True)
class PerformanceIndex(OutputText):
    """A component-specific measure (PI); its threshold (APT) says which side of a value is good enough."""

    name: str
    unit: Unit
    smaller_is_better: bool
    description: str
    made_of: SampleValue = SampleValue.RESPONSE_TIME

    def __str__(self) -> str:
        return self.name

    @property
    def direction(self) -> str:
        """The word of a threshold that makes sense: `at_most` or `at_least`."""
        return "at_most" if self.smaller_is_better else "at_least"

    @property
    def symbol(self) -> str:
        """The unit that its values are measured and computed in: `ms`, `%` or `/s`."""
        return _SYMBOLS[self.unit]

    @property
    def is_extreme(self) -> bool:
        """Whether it is a maximum or minimum, which one more job may change: it is met only so far."""
        return self.name in _EXTREMES


_EXTREMES = ("minimum_response_time", "maximum_response_time")

_NAMED = (
    PerformanceIndex(
        name="mean_response_time",
        unit=Unit.TIME,
        smaller_is_better=True,
        description="The mean response time of all jobs that answered.",
    ),
    PerformanceIndex(
        name="minimum_response_time",
        unit=Unit.TIME,
        smaller_is_better=True,
        description="The shortest response time of all jobs that answered.",
    ),
    PerformanceIndex(
        name="maximum_response_time",
        unit=Unit.TIME,
        smaller_is_better=True,
        description="The longest response time of all jobs that answered.",
    ),
    PerformanceIndex(
        name="jitter",
        unit=Unit.TIME,
        smaller_is_better=True,
        description="The standard deviation of the response times of all jobs that answered.",
    ),
    PerformanceIndex(
        name="success_rate",
        unit=Unit.SHARE,
        smaller_is_better=False,
        description="The share of jobs that succeeded.",
        made_of=SampleValue.SUCCESS,
    ),
    PerformanceIndex(
        name="throughput",
        unit=Unit.RATE,
        smaller_is_better=False,
        description="Successful jobs, or their amount of work, over the elapsed time.",
        made_of=SampleValue.COUNT,
    ),
    PerformanceIndex(
        name="deadline_miss_rate",
        unit=Unit.SHARE,
        smaller_is_better=True,
        description="The share of jobs with an answer after their deadline, or without an answer.",
    ),
)

INDEXES: dict[str, PerformanceIndex] = {index.name: index for index in _NAMED}
"""Those with a name of their own; percentiles are a family besides."""


def find_index(name: str) -> PerformanceIndex | None:
    """Return the index of this name, None if there is none."""
    return INDEXES.get(name) or percentile_index(name)


def index_named(name: str) -> PerformanceIndex:
    """Return the index of this name, which a manifest or a log has that was checked."""
    index = find_index(name)
    assert index is not None, f"{name} was checked to be an index"
    return index


def percentile_of(name: str) -> Fraction | None:
    """Return the per cent in the name, None if it is not a percentile's name."""
    return Fraction(name[1 : name.index("_")]) if _PERCENTILE.match(name) else None


def percentile_index(name: str) -> PerformanceIndex | None:
    """Return the percentile of this name, None if it is not a percentile's name."""
    if _PERCENTILE.match(name) is None:
        return None
    return PerformanceIndex(
        name=name,
        unit=Unit.TIME,
        smaller_is_better=True,
        description=f"The response time that {name[1 : name.index('_')]} % of the jobs that answered do not exceed.",
    )


def threshold_of(index: PerformanceIndex, text: str) -> Threshold:
    """Read `100 ms` as a maximum or a minimum, as the index has it.

    Raises:
        NotAQuantity: it is not a number with a unit of the index.
    """
    _, value = parse_quantity(text, index.unit)
    kind, unit = AtMost if index.smaller_is_better else AtLeast, text.lstrip("0123456789. ")
    return kind(value=value, unit="" if unit == index.symbol else unit)
