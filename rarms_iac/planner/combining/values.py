"""What combining speaks of: CoIs and compounds with what they cost, questions and their answers."""

from collections.abc import Iterable
from dataclasses import dataclass

Members = tuple[str, ...]
"""Components together in one partition, by name."""

WHOLE = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class Coi:
    """A component of interest, or a compound one: what one partition holds."""

    name: str
    members: Members
    criticality: int  # the highest of its members'
    processors: int  # VPs of its partition
    reserve: int  # whole per cent of each of them
    missed: int | None = None  # the highest CR at which it was shown to miss an APT; None: right below its reserve

    @property
    def at_least(self) -> int:
        """What it truly needs at least, as `cost`: what it reserves is the safe side of what was measured."""
        return self.cost if self.missed is None else min(self.cost, self.processors * (self.missed + 1))

    @property
    def cost(self) -> int:
        """The reservation in per cent of one logical processor."""
        return self.processors * self.reserve


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """A setting that was asked for, with its answer."""

    members: Members
    reserve: int  # CR: per cent of P1's own VPs
    worse: tuple[str, ...]  # members that miss an APT there, by name
    predicted: int | None = None  # the CR that was expected to do when it was asked; None: nothing was

    @property
    def passed(self) -> bool:
        """Whether every APT of every member is met."""
        return not self.worse


def union(coi: Coi, other: Coi) -> Members:
    """Who is in a partition of both."""
    return tuple(sorted((*coi.members, *other.members)))


def leader(cois: Iterable[Coi]) -> Coi:
    """The most critical, ties by name: what their compound is called after."""
    return min(cois, key=lambda coi: (-coi.criticality, coi.name))


def total(cois: Iterable[Coi]) -> int:
    """What they reserve together, in per cent of one logical processor."""
    return sum(coi.cost for coi in cois)
