"""Which linear program is asked: HiGHS where it is installed (`pip install 'rarms-iac[solver]'`), otherwise our own."""

import importlib.util
from collections.abc import Sequence
from typing import Protocol

from rarms_iac.planner.packing.linear.factored import Factored
from rarms_iac.planner.packing.linear.simplex import Entries


class Restricted(Protocol):
    """A linear program that grows by columns: minimise cost, every row met with equality. Never believed."""

    @property
    def pivots(self) -> int:
        """Steps that it took so far: what it costs, in counts."""

    def add(self, cost: float, entries: Entries) -> int:
        """One column more; its number."""

    def solve(self, limit: int = ...) -> float:
        """The value of the optimum, or of what so many pivots made of it."""

    def duals(self) -> list[float]:
        """By row: what one unit more of its right-hand side would cost."""

    def solution(self) -> dict[int, float]:
        """The columns that are used, with how much."""


def installed() -> bool:
    """Whether HiGHS is."""
    return importlib.util.find_spec("highspy") is not None


def restricted(right: Sequence[float], penalties: Sequence[float], *, own: bool) -> Restricted:
    """A program with these right-hand sides, and by row the cost of leaving one unit of it unmet.

    Args:
        right: right-hand sides, none negative.
        penalties: by row.
        own: our own, whatever is installed.
    """
    if own or not installed():
        return Factored(right=list(right), penalties=list(penalties))
    from rarms_iac.planner.packing.linear.highs import Highs

    return Highs(right, penalties)
