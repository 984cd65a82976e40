"""The speed of a machine's processors as its own system reports it: what sets it, and what reduced it."""

from collections.abc import Sequence
from dataclasses import dataclass

FREQUENCY_CHANGE = 0.1
"""The part of the frequency by which a setting may end faster or slower than it began. Turbo steps move less."""

MEMORY_FACTOR = 1.2
"""A partition's memory over the peak that was measured: a plan warns where it is less."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineSpeed:
    """The speed of all processors at one moment, as far as the system reports it."""

    governor: str = ""  # of Linux's cpufreq, several joined by a comma; empty: not known, as on Windows
    mhz: int = 0  # on the average of the processors; 0: not known
    limit_mhz: int = 0  # the highest frequency allowed now, on the average; 0: not known
    throttled: int = 0  # rises each time that heat slows the processors


def speed_change(speeds: Sequence[MachineSpeed], *, are_busy: bool) -> str:
    """Say what changed between the first and the last moment.

    Args:
        are_busy: Whether all processors had work at both moments: the frequency of idle ones moves by itself.

    Returns:
        Words with numbers; empty: nothing changed, or it is not known.
    """
    if len(speeds) < 2:
        return ""
    first, last = speeds[0], speeds[-1]
    if first.governor != last.governor:
        return f"the frequency governor changed from {first.governor or 'none'} to {last.governor or 'none'}"
    if last.throttled > first.throttled:
        return "heat slowed the processors"
    if first.limit_mhz != last.limit_mhz:
        return f"the highest frequency allowed changed from {first.limit_mhz} to {last.limit_mhz} MHz"
    if are_busy and first.mhz and abs(last.mhz - first.mhz) > FREQUENCY_CHANGE * first.mhz:
        return f"the processors' frequency changed from {first.mhz} to {last.mhz} MHz"
    return ""
