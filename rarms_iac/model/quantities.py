"""Quantities with their units: exact inside, and written back as a person would write them.

Time is kept in milliseconds, memory in bytes, rates in events a second, shares in per cent; all are exact
(`Fraction` or `int`), so that what fits on paper fits on the host.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction
from math import ceil, floor, isfinite, log10
from typing import NewType

from rarms_iac.model.wording import in_a_row, quoted

Milliseconds = NewType("Milliseconds", Fraction)
Bytes = NewType("Bytes", int)
Percent = NewType("Percent", Fraction)
LogicalProcessors = NewType("LogicalProcessors", Fraction)
ReservePercent = int
"""A CPU reservation (CR): whole per cent of each of a partition's virtual processors."""


class Unit(StrEnum):
    """The kind of a quantity; the value is its name in messages."""

    TIME = "time"
    MEMORY = "memory"
    SHARE = "share"
    PROCESSORS = "processors"
    RATE = "rate"


UNITS: dict[Unit, dict[str, Fraction]] = {
    Unit.TIME: {
        "us": Fraction(1, 1000),
        "ms": Fraction(1),
        "s": Fraction(1000),
        "min": Fraction(60_000),
        "h": Fraction(3_600_000),
    },
    Unit.MEMORY: {
        "B": Fraction(1),
        "KiB": Fraction(2**10),
        "MiB": Fraction(2**20),
        "GiB": Fraction(2**30),
        "TiB": Fraction(2**40),
    },
    Unit.SHARE: {"%": Fraction(1)},
    Unit.PROCESSORS: {"LP": Fraction(1)},
    Unit.RATE: {"/s": Fraction(1), "/min": Fraction(1, 60), "/h": Fraction(1, 3600)},
}
"""Every unit a manifest may write, with its size in the unit we keep."""

# 15 digits before and after the point: enough for bytes of a petabyte, too few to slow us down.
_WRITTEN = re.compile(r"(?P<number>[0-9]{1,15}(?:\.[0-9]{1,15})?) ?(?P<unit>[A-Za-z%/][A-Za-z%/]{0,7})")


class NotAQuantity(ValueError):
    """The text is not one number and one of the units that fit."""

    def __init__(self, text: str, units: tuple[str, ...]) -> None:
        super().__init__(f"{quoted(text)} is not a number with the unit {in_a_row(units, 'or')}")
        self.text = text
        self.units = units


def units_of(*kinds: Unit) -> tuple[str, ...]:
    """Return the units that fit, in the order in which messages list them."""
    return tuple(unit for kind in kinds for unit in UNITS[kind])


def parse_quantity(text: str, *kinds: Unit) -> tuple[Unit, Fraction]:
    """Return the kind and the exact value of e.g. `88 ms`, `512 MiB`, `70 %`, `1.4 LP`, `24 /s`.

    Where processor time fits, a share is of the host, and may say so: `70 % of host`.

    Raises:
        NotAQuantity: it is not one ASCII number, at most one space, and a unit of `kinds`.
    """
    found = _WRITTEN.fullmatch(text.removesuffix(f" {OF_HOST}") if _says_host(text, kinds) else text)
    if found:
        for kind in kinds:
            size = UNITS[kind].get(found["unit"])
            if size is not None:
                return kind, Fraction(found["number"]) * size
    raise NotAQuantity(text, units_of(*kinds))


def _says_host(text: str, kinds: tuple[Unit, ...]) -> bool:
    return {Unit.SHARE, Unit.PROCESSORS} <= set(kinds) and text.endswith(f"% {OF_HOST}")


@dataclass(frozen=True, slots=True)
class ShareOfHost:
    """A share of all logical processors of a host, in per cent."""

    percent: Percent


@dataclass(frozen=True, slots=True)
class ProcessorTime:
    """An amount of processor time, in logical processors: 1.4 LP."""

    processors: LogicalProcessors


CpuAmount = ShareOfHost | ProcessorTime
"""A reservation or limit as the manifest may write it."""


OF_HOST = "of host"
"""May stand after a share of a host, in the manifest too: `70 % of host`."""


def in_processors(amount: CpuAmount, host_processors: int) -> LogicalProcessors:
    """Return the amount in logical processors, on a host that has so many."""
    match amount:
        case ShareOfHost(percent):
            return LogicalProcessors(percent * host_processors / 100)
        case ProcessorTime(processors):
            return processors


def per_virtual_processor(processors: LogicalProcessors, virtual_processors: int) -> int:
    """Return the whole per cent of each virtual processor that guarantees so many LPs, rounded up (windows.md 1.1)."""
    return ceil(100 * processors / virtual_processors)


def guaranteed(percent: int, virtual_processors: int) -> LogicalProcessors:
    """Return the LPs that a per cent of each virtual processor guarantees: n * r / 100 (windows.md 1.1)."""
    return LogicalProcessors(Fraction(percent * virtual_processors, 100))


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


def show_period(microseconds: int | None) -> str:
    """Return a period in milliseconds, `8.8 ms`; `none` where there is none."""
    return f"{plain(Fraction(microseconds, 1000))} ms" if microseconds else "none"


LEAST_MEMORY = 32 * 2**20
"""Bytes below which Hyper-V takes no machine."""

MEMORY_GRAIN = 2 * 2**20
"""Bytes of which Hyper-V takes only multiples: an even number of MiB."""


def machine_memory(wanted: int) -> Bytes:
    """Return the least memory that Hyper-V takes and that holds these bytes."""
    return Bytes(max(LEAST_MEMORY, -(-wanted // MEMORY_GRAIN) * MEMORY_GRAIN))


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
