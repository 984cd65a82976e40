"""Who answers what a compound does at a reservation, who is told, and who may say no to a combination."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Protocol

from rarms_iac.model.plan import Claim
from rarms_iac.model.system import Host
from rarms_iac.planner.groups import Group
from rarms_iac.planner.reservations import MeasuredReservations, MeasuredTogether, ReservationSource, names_of
from rarms_iac.statistics.curves import highest_missed

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
class Answer:
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


class Unanswered(Exception):
    """The oracle cannot answer this question, now or at all; the text says why. What was answered stays true."""


class PerformanceOracle(Protocol):
    """An experiment on a host, or the data logs of one."""

    def worse(self, members: Members, reserve: int) -> frozenset[str]:
        """Those of the members that miss any of their APTs when all of them run in one partition.

        That partition reserves `reserve` per cent of each of its processors (CR, 1..100); the rest is reserved by P2
        with the interfering load. On the safe side: whoever is not shown to meet an APT misses it. The same question
        has the same answer.

        Raises:
            Unanswered: there is no verdict, or somebody asked for an end.
        """
        ...


class Consent(Protocol):
    """Answer before a combination is measured for the first time."""

    def allows(self, members: Members, *, settings: int, gain: int) -> bool:
        """Whether it may be tried.

        It takes about so many settings, fewer where it is soon out; at most so much, in per cent of one logical
        processor, is gained.
        """
        ...


class PlannerReporter(Protocol):
    """Told what combining does, as it does it; must not raise."""

    def setting_answered(self, answer: Answer) -> None:
        """The oracle said."""
        ...

    def declined(self, members: Members) -> None:
        """Somebody said no to this combination, or the manifest does; another one is tried."""
        ...

    def combined(self, compound: Coi, before: int) -> None:
        """A compound was found; `before`: what its parts cost, in per cent of one logical processor."""
        ...


class SilentReporter:
    """Tells nobody."""

    def setting_answered(self, answer: Answer) -> None:
        """Nothing."""

    def declined(self, members: Members) -> None:
        """Nothing."""

    def combined(self, compound: Coi, before: int) -> None:
        """Nothing."""


class Always:
    """Consents to everything."""

    def allows(self, members: Members, *, settings: int, gain: int) -> bool:  # noqa: ARG002 - the protocol's
        """Yes."""
        return True


def coi_as_measured(group: Group, claim: Claim, reservations: ReservationSource, host: Host) -> Coi:
    """What a partition holds, with the highest CR at which its data log for this host shows that it misses an APT.

    Where it reserves more than the log asks for, because the manifest fixes that, nothing less is thought of.
    """
    coi = Coi(
        name=group.name,
        members=names_of(group.members),
        criticality=group.criticality,
        processors=claim.processors,
        reserve=claim.reserve,
    )
    if not isinstance(reservations, MeasuredReservations):
        return coi
    log, least = reservations.log(group.members, host), reservations.least(group.members, host)
    if not isinstance(log, MeasuredTogether) or least is None:
        return coi
    if (log.processors, least.reserve) != (claim.processors, claim.reserve):
        return coi
    apts = [
        (log.curves(member.name, index), threshold)
        for member in group.members
        for index, threshold in member.apt.items()
    ]
    return replace(coi, missed=highest_missed(apts))
