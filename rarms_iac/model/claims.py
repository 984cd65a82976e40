"""Claims: the processors and memory that partitions are promised of a host, and their sums."""

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction

from rarms_iac.model.quantities import LogicalProcessors

WHOLE = 100
"""One logical processor, in per cent of itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """The promise of a host to a partition: virtual processors with so many per cent of each, and bytes of memory."""

    processors: int = 0
    reserve: int = 0  # whole per cent of each
    memory: int = 0  # bytes

    def is_less_than(self, after: "Claim") -> bool:
        """Whether `after` promises more processor time or memory than this."""
        return (
            after.processors * after.reserve > self.processors * self.reserve
            or after.memory > self.memory
            or (after.reserve > self.reserve and after.processors > 0)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Load:
    """The sum of claims."""

    percent: int = 0  # of one logical processor
    memory: int = 0  # bytes

    @property
    def processors(self) -> LogicalProcessors:
        """The same promise in logical processors."""
        return LogicalProcessors(Fraction(self.percent, WHOLE))


def load_of(claims: Iterable[Claim]) -> Load:
    """Add up claims; memory in bytes, processors in per cent of one logical processor."""
    percent = memory = 0
    for claim in claims:
        percent += claim.processors * claim.reserve
        memory += claim.memory
    return Load(percent=percent, memory=memory)
