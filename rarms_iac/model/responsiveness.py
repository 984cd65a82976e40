"""SystemResponsiveness: what per cent of a processor MMCSS leaves to everybody else (FACTS 6.1)."""

SYSTEM_RESPONSIVENESS = "SystemResponsiveness"
"""The registry value's name; rarms' record of it has the same, so no task class of the manifest may have it."""

USUAL = 20
"""What Windows takes for a value that is out of range, missing or of another type; per cent."""
OFF = 100
"""Switches MMCSS off."""


def taken_for(percent: int) -> int:
    """What Windows makes of the number: out of range it is 20, otherwise rounded down to tens (page of May 2025)."""
    return percent // 10 * 10 if 10 <= percent <= OFF else USUAL


def is_taken_as_is(percent: int) -> bool:
    """Whether it is 10, 20, ... 90: every version of Microsoft's page means the same by these."""
    return percent != OFF and taken_for(percent) == percent
