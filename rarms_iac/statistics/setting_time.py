"""How long a setting takes at least: what settles, the samples that its thresholds need, and the starts of its load."""

from typing import Final

from rarms_iac.model.loads import Interference, is_steady
from rarms_iac.statistics.error_probability import PERIODIC_STARTS

MEMORY_FACTOR: Final = 30
"""Samples count after this many windows of the scheduler, and are then taken for at least as long again."""

STARTS: Final = 8
"""So often at least a load that never pauses begins in a setting; `PERIODIC_STARTS` times beside periodic jobs."""

RESTART_WINDOWS: Final = 5
"""After a further start so many windows of the scheduler are left out, not the `MEMORY_FACTOR` of the first.

What settles then is the load alone (docs/measuring.md). With three a P1 of one processor beside a P2 of
two got 24.8 % where it reserves 23.
"""


def least_starts(*, is_periodic: bool) -> int:
    """Say how often a load that never pauses begins before a setting is judged.

    Args:
        is_periodic: whether a component beside it has a period, and so may lock into a phase of it.

    Returns:
        Starts, the first among them.
    """
    return PERIODIC_STARTS if is_periodic else STARTS


def least_setting_ms(
    samples_ms: float, load: Interference, window_ms: float, *, is_periodic: bool, begins_anew: bool
) -> float:
    """Say how long a setting of a search takes at least beside a load.

    Args:
        samples_ms: the time in which the samples come that its thresholds need.
        load: what runs beside it.
        window_ms: the longest of the host's scheduler.
        is_periodic: as of `least_starts`.
        begins_anew: whether the host lets a load that never pauses begin anew.

    Returns:
        Milliseconds by the host's clock.
    """
    further_starts = least_starts(is_periodic=is_periodic) - 1 if begins_anew and is_steady(load) else 0
    settles_ms = MEMORY_FACTOR * window_ms
    return settles_ms + max(settles_ms, samples_ms) + further_starts * RESTART_WINDOWS * window_ms
