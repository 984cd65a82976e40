"""Claims: the processors and memory that partitions are promised of a host, and their sums."""

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction

from rarms_iac.model.quantities import LogicalProcessors

WHOLE = 100
"""One logical processor, in per cent of itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """The promise of a host to a partition: logical processors with so many per cent of each, and bytes of memory."""

    processors: int = 0  # one for each virtual processor; with `CoreSharing`, all of the cores that these take
    reserve: int = 0  # whole per cent of each
    memory: int = 0  # bytes
    idle: int = 0  # of the logical processors, that stay idle next to a virtual processor of the partition

    @property
    def percent(self) -> int:
        """The processor time of it, in per cent of one logical processor."""
        return self.processors * self.reserve

    @property
    def idle_percent(self) -> int:
        """The part of `percent` that no virtual processor of the partition can use."""
        return self.idle * self.reserve

    def is_less_than(self, after: "Claim") -> bool:
        """Return whether `after` promises more processor time or memory than this.

        Returns:
            False: going from this to `after` needs nothing more of the host.
        """
        return (
            after.percent > self.percent
            or after.memory > self.memory
            or (after.reserve > self.reserve and after.processors > 0)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class DeadlineClaim(Claim):
    """A claim that a Linux kernel is asked to admit as a deadline, as the planner compares it."""

    deadline: int  # per cent of one logical processor, for the first thread


@dataclass(frozen=True, slots=True, kw_only=True)
class CoreSharing:
    """A machine's way of taking cores that never run two machines at once (windows.md 2).

    Both are 1 where each logical processor may run another machine: without SMT, or under another scheduler.
    """

    threads: int = 1  # logical processors of a core
    used: int = 1  # of these, that run virtual processors of the machine

    def claim(self, processors: int, reserve: int, memory: int) -> Claim:
        """Make the claim of a machine.

        Args:
            reserve: whole per cent of each.
            memory: bytes.

        Returns:
            The claim, with the logical processors that stay idle next to it.
        """
        taken = -(-processors // self.used) * self.threads
        return Claim(processors=taken, reserve=reserve, memory=memory, idle=taken - processors)


ANY_THREAD = CoreSharing()
"""Each logical processor may run another machine."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Load:
    """The sum of claims."""

    percent: int = 0  # of one logical processor
    memory: int = 0  # bytes
    idle_percent: int = 0  # of `percent`: idle next to virtual processors

    @property
    def processors(self) -> LogicalProcessors:
        """`percent` in logical processors."""
        return LogicalProcessors(Fraction(self.percent, WHOLE))

    @property
    def idle_processors(self) -> LogicalProcessors:
        """The logical processors that stay idle next to virtual ones."""
        return LogicalProcessors(Fraction(self.idle_percent, WHOLE))


def load_of(claims: Iterable[Claim]) -> Load:
    """Add up claims; memory in bytes, processors in per cent of one logical processor.

    Returns:
        The sums.
    """
    percent = memory = idle = 0
    for claim in claims:
        percent += claim.percent
        memory += claim.memory
        idle += claim.idle_percent
    return Load(percent=percent, memory=memory, idle_percent=idle)
