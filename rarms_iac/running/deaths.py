"""How a process ended, in words."""

import signal as signals

from rarms_iac.running.kept import Ended

_LAST_SIGNAL = 1000


def ended_well(ended: Ended) -> bool:
    """Whether it ended by itself, and says that all is well."""
    return ended.code == 0 and ended.signal == 0


def too_early(ended: Ended) -> str:
    """What to say of a process that was to go on."""
    if ended.signal:
        return death(ended)
    return "it ended without a sample" if ended.code == 0 else f"it ended with exit code {ended.code}"


def death(ended: Ended) -> str:
    """Which signal killed it, or how it crashed."""
    if ended.signal > _LAST_SIGNAL:
        return f"it crashed with 0x{ended.signal:08X}"
    try:
        return f"it was killed by {signals.Signals(ended.signal).name}"
    except ValueError:
        return f"it was killed by signal {ended.signal}"
