"""Quantities as a person writes them, with their units."""

from collections.abc import Iterable
from fractions import Fraction
from math import floor, isfinite, log10

from rarms_iac.model.host import Host, ProviderKind
from rarms_iac.model.quantities import OF_HOST, UNITS, CpuAmount, ProcessorTime, ShareOfHost, Unit, guaranteed
from rarms_iac.texts.messages import counted


def plain(value: Fraction | int) -> str:
    """Return a number without needless digits: `12`, `1.4`, `0.333`."""
    exact = Fraction(value)
    return str(exact.numerator) if exact.denominator == 1 else _rounded(float(exact), 3)


def _rounded(value: float, places: int) -> str:
    """Round to so many decimals, or to as many as show that a value is not zero: `0.004`."""
    text = f"{value:.{places}f}"
    if value and not text.strip("-0."):
        text = f"{value:.{-floor(log10(abs(value)))}f}"
    return text.rstrip("0").rstrip(".")


def show_number(value: float, *others: float) -> str:
    """Return a measured number with three digits that count, and tenths at least: `0.0123`, `88.1`, `1234.6`.

    No exponent is ever written, and no infinity: that is `no bound`.

    Args:
        others: of the same sentence; where one that differs would read alike, there are more digits.
    """
    if not isfinite(value):
        return "no bound"
    places = max(1, 2 - floor(log10(abs(value)))) if value else 1
    while places < 9 and any(other != value and f"{other:.{places}f}" == f"{value:.{places}f}" for other in others):
        places += 1
    return f"{value:.{places}f}".rstrip("0").rstrip(".")


def show_percent(value: Fraction | int) -> str:
    """Write as `70 %`."""
    return f"{plain(value)} %"


def show_processors(value: Fraction | int) -> str:
    """Write a rounded amount as `1.4 LP` or `0.004 LP`; `show_amount` writes the exact one."""
    exact = Fraction(value)
    return f"{exact.numerator if exact.denominator == 1 else _rounded(float(exact), 2)} LP"


def count_processors(processors: int, host: Host) -> str:
    """Write the processors of a partition as `2 virtual processors`; a control group has no virtual ones."""
    return counted(processors, "processor" if host.provider is ProviderKind.LINUX else "virtual processor")


def share_of_processors(percent: Fraction | int, processors: int) -> str:
    """Write a share of a partition's own virtual processors, with their number: `26 % of its 1 VP`."""
    return f"{plain(percent)} % of its {processors} VP{'' if processors == 1 else 's'}"


def share_of_host(amount: Fraction | int, whole: Fraction | int, host: str) -> str:
    """Write a share of a host's logical processors, with its name: `13 % of onboard`; empty if it has none."""
    if not whole:
        return ""
    return f"{_rounded(float(100 * Fraction(amount) / whole), 1)} % of {host}"


def show_reserve(percent: int, processors: int) -> str:
    """Write a partition's reservation or limit as `0.26 LP (26 % of its 1 VP)`."""
    amount = show_processors(guaranteed(percent, processors))
    return f"{amount} ({share_of_processors(percent, processors)})"


def show_lp_percent(percent: int) -> str:
    """Write per cent of one logical processor, the unit of totals, as `1.4 LP`."""
    return show_processors(Fraction(percent, 100))


def show_bytes(value: int, *others: int) -> str:
    """Write memory as `512 MiB`, from 1 GiB on with one decimal as `3.5 GiB`; `write_bytes` is exact.

    Args:
        value: bytes.
        others: other amounts of the same sentence; of one that differs and would read alike, both get more decimals.
    """
    for unit in ("GiB", "MiB", "KiB"):
        whole = int(UNITS[Unit.MEMORY][unit])
        if value >= whole:
            places = next(places for places in range(1, 10) if _is_distinct(value, others, whole, places))
            return f"{_decimals(value, whole, places)} {unit}"
    return f"{value} B"


def _is_distinct(value: int, others: Iterable[int], whole: int, places: int) -> bool:
    shown = _decimals(value, whole, places)
    return places == 9 or all(other == value or _decimals(other, whole, places) != shown for other in others)


def _decimals(value: int, whole: int, places: int) -> str:
    return f"{value / whole:.{places}f}".rstrip("0").rstrip(".")


def write_bytes(value: int) -> str:
    """Write memory exactly, as a manifest, a step and a data log have it: `1537 MiB`, `4 GiB`.

    Args:
        value: bytes.

    Returns:
        The number in the largest unit that keeps it whole. Identities of data logs hold this text: it never changes.
    """
    for unit, size in reversed(UNITS[Unit.MEMORY].items()):
        if value and value % size == 0 and value // int(size) < MOST_DIGITS:
            return f"{value // int(size)} {unit}"
    gibibyte = int(UNITS[Unit.MEMORY]["GiB"])
    return f"{plain(Fraction(value, gibibyte))} GiB" if value and value % (gibibyte // 4) == 0 else f"{value} B"


MOST_DIGITS = 10_000
"""A number of bytes is written with fewer than five digits where a unit allows it."""


def show_milliseconds(value: Fraction | int) -> str:
    """Write a time as `88 ms` or `2 s`, in the largest of min, s, ms, us that keeps it short."""
    exact = Fraction(value)
    for unit in ("min", "s"):
        if exact and exact % UNITS[Unit.TIME][unit] == 0:
            return f"{plain(exact / UNITS[Unit.TIME][unit])} {unit}"
    if exact and exact < 1:
        return f"{plain(exact * 1000)} us"
    return f"{plain(exact)} ms"


def show_duration(milliseconds: float) -> str:
    """Write a duration for a person: `0.4 s`, `25 s`, `7 min`, `2 h 40 min`; no fractions above a second."""
    seconds = milliseconds / 1000
    if seconds < 1:
        return f"{seconds:.1g} s"
    if seconds < 100:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    hours, rest = divmod(minutes, 60)
    if not hours:
        return f"{minutes} min"
    return f"{hours} h {rest} min" if rest else f"{hours} h"


def show_amount(amount: CpuAmount) -> str:
    """Return the amount as the manifest would write it."""
    match amount:
        case ShareOfHost(percent):
            return f"{show_percent(percent)} {OF_HOST}"
        case ProcessorTime(processors):
            return f"{plain(processors)} LP"
