"""Quantities with their units, read and kept exactly; `texts/quantities.py` writes them.

Time is kept in milliseconds, memory in bytes, rates in events a second, shares in per cent; all are exact
(`Fraction` or `int`), so that what fits on paper fits on the host.
"""

import re
from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction
from math import ceil
from typing import NewType

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
        super().__init__(text, units)
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


LEAST_MEMORY = 32 * 2**20
"""Bytes below which Hyper-V takes no machine."""

MEMORY_GRAIN = 2 * 2**20
"""Bytes of which Hyper-V takes only multiples: an even number of MiB."""


def machine_memory(wanted: int) -> Bytes:
    """Return the least memory that Hyper-V takes and that holds these bytes."""
    return Bytes(max(LEAST_MEMORY, -(-wanted // MEMORY_GRAIN) * MEMORY_GRAIN))
