"""What layouts are compared on, and what makes one the better one (DESIGN section 3)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from rarms_iac.model.system import Minimise
from rarms_iac.planner.combining.candidates import Mask
from rarms_iac.planner.combining.values import Coi

Fits = Callable[[Sequence[Coi]], bool]
"""Whether hosts can keep these promises at once; less reserve never fits worse."""

Value = tuple[int, int, int]
"""What layouts are compared on, in order; the smaller, the better."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Objective:
    """What makes a layout the better one, beside that it fits (DESIGN section 3)."""

    capacity: int  # of all hosts, in per cent of one logical processor: what exceeds it need not be tried
    fits: Fits
    minimise: Minimise
    criticalities: Mapping[str, int]  # by component


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """A layout by its compounds; every other CoI keeps its partition."""

    blocks: tuple[Mask, ...]
    total: int  # at least what it reserves, in per cent of one logical processor
    partitions: int
    key: int  # the criticalities of those who share: the smaller, the better


def weights_of(cois: Sequence[Coi], criticalities: Mapping[str, int]) -> list[int]:
    """What it costs that a CoI shares: sums compare as sorted lists of criticalities do, most critical first."""
    levels = sorted(set(criticalities.values()))
    base = len(criticalities) + 1
    return [sum(base ** levels.index(criticalities[name]) for name in coi.members) for coi in cois]
