"""Who answers for a compound at a reservation, who gets reports, and who may decline a combination."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from rarms_iac.model.claims import ANY_THREAD, Claim, CoreSharing
from rarms_iac.model.experiment import together
from rarms_iac.model.host import Host
from rarms_iac.planner.groups import Group
from rarms_iac.planner.reservations import MeasuredReservations, ReservationSource, names_of
from rarms_iac.planner.verdicts import MeasuredTogether, with_curves
from rarms_iac.statistics.curves import highest_missed
from rarms_iac.storage.datalog.decisions import TrailSetting

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
    sharing: CoreSharing = ANY_THREAD  # how these take logical ones
    host_lp: int = 0  # LPs of the host that it is measured on: a compound has its parts' VPs together, at most so many
    reserve: int  # whole per cent of each of them
    missed: int | None = None  # the highest CR at which it was shown to miss an APT; None: right below its reserve

    @property
    def at_least(self) -> int:
        """What its virtual processors need at least, in per cent of one logical processor.

        Its reserve is on the safe side of what was measured, so the true need may be lower.
        """
        return self.processors * (self.reserve if self.missed is None else min(self.reserve, self.missed + 1))

    @property
    def taken_processors(self) -> int:
        """Logical processors that its virtual ones take."""
        return self.sharing.claim(self.processors, self.reserve, 0).processors

    @property
    def cost(self) -> int:
        """The reservation in per cent of one logical processor."""
        return self.taken_processors * self.reserve


def processors_of(parts: Sequence[Coi]) -> int:
    """Return the virtual processors of the compound of these CoIs: those of its parts together, at most the host's."""
    return together([part.processors for part in parts], parts[0].host_lp)


def union(coi: Coi, other: Coi) -> Members:
    """Name the components of both CoIs.

    Args:
        other: another CoI, with other members.

    Returns:
        All names, sorted.
    """
    return tuple(sorted((*coi.members, *other.members)))


def leader(cois: Iterable[Coi]) -> Coi:
    """Return the most critical CoI, after which a compound is called.

    Args:
        cois: at least one, in any order; equally critical ones go by name.

    Returns:
        The CoI whose name a compound of these gets.

    Raises:
        ValueError: there are none.
    """
    return min(cois, key=lambda coi: (-coi.criticality, coi.name))


def total(cois: Iterable[Coi]) -> int:
    """Add up what the CoIs reserve.

    Args:
        cois: each with its processors and its CR.

    Returns:
        The sum in per cent of one logical processor; 100 is one whole processor.
    """
    return sum(coi.cost for coi in cois)


class Unanswered(Exception):
    """The oracle cannot answer this question, now or at all; the text says why. What was answered stays true."""


class PerformanceOracle(Protocol):
    """An experiment on a host, or the data logs of one."""

    def worse(self, members: Members, reserve: int) -> frozenset[str]:
        """Name the members that miss any of their APTs when all of them run in one partition.

        That partition reserves `reserve` per cent of each of its processors; the rest is reserved by P2 with the
        interfering load. On the safe side: a component that is not shown to meet an APT misses it. The same question
        has the same answer.

        Args:
            members: the components, by sorted names.
            reserve: the CR, 1..100 whole per cent.

        Returns:
            Names of members; empty: all APTs are met.

        Raises:
            Unanswered: no verdict, or an end was asked for.
        """

    def unresolved(self, members: Members, reserve: int) -> bool:
        """Tell whether a setting that is not enough was not shown to be too little, either.

        Returns:
            True where none of those that are worse was shown to miss an APT: no proof may use it.
        """


class Consent(Protocol):
    """Answer before a combination is measured for the first time."""

    def allows(self, members: Members, settings: int, gain: int) -> bool:
        """Tell whether the combination may be tried.

        Args:
            members: the components that would share a partition, by sorted names.
            settings: about how many settings it takes; fewer where it is soon out.
            gain: what it can save at most, in per cent of one logical processor.

        Returns:
            False: it is not asked about, and everything else goes on. Asked once for each combination.
        """


class PlannerReporter(Protocol):
    """Receives each step of combining as it happens; must not raise."""

    def setting_answered(self, answer: TrailSetting) -> None:
        """Take note that the oracle answered this question.

        Args:
            answer: the members, the CR, and who missed an APT there.
        """

    def declined(self, members: Members) -> None:
        """Take note that a user or the manifest says no to this combination; another one is tried.

        Args:
            members: the components that would have shared a partition, by sorted names.
        """

    def combined(self, compound: Coi, before: int) -> None:
        """Take note that a compound was found.

        Args:
            compound: with the reservation that was measured.
            before: what its parts reserve, in per cent of one logical processor.
        """


class SilentReporter:
    """Drops all reports."""

    def setting_answered(self, answer: TrailSetting) -> None:
        """Do nothing."""

    def declined(self, members: Members) -> None:
        """Do nothing."""

    def combined(self, compound: Coi, before: int) -> None:
        """Do nothing."""


class Always:
    """Consents to everything."""

    def allows(self, members: Members, settings: int, gain: int) -> bool:  # noqa: ARG002 - the protocol's
        """Say yes, to every combination."""
        return True


def coi_as_measured(
    group: Group, claim: Claim, reservations: ReservationSource, host: Host, sharing: CoreSharing = ANY_THREAD
) -> Coi:
    """Make the CoI of a partition, with the highest CR at which its data log shows it to miss an APT.

    Where the manifest fixes a larger reservation than the log asks for, the fixed value stays and `missed` is None.

    Args:
        reservations: the data logs, or what the manifest fixes.
        host: the host that the logs must hold for.
        sharing: how the partition takes its cores.

    Returns:
        The CoI; its `missed` is in whole per cent of each of its processors.
    """
    coi = Coi(
        name=group.name,
        members=names_of(group.members),
        criticality=group.criticality,
        processors=claim.processors - claim.idle,
        sharing=sharing,
        reserve=claim.reserve,
        host_lp=host.logical_processors,
    )
    if not isinstance(reservations, MeasuredReservations):
        return coi
    log = reservations.log(group.members, host)
    if not isinstance(log, MeasuredTogether) or (log.processors, log.least) != (coi.processors, coi.reserve):
        return coi
    return replace(coi, missed=highest_missed(with_curves(group.members, log.curves)))
