"""Where a reservation comes from: what the manifest fixes, or the curves of a data log."""

from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Protocol

from rarms_iac.model.host import Host
from rarms_iac.model.layout import LookedUp, RecordedAnswer
from rarms_iac.model.outcomes import Achievement, ReservationVerdict
from rarms_iac.model.quantities import LogicalProcessors, guaranteed, in_processors
from rarms_iac.model.setting import SettingEvidence
from rarms_iac.model.system import Component, Measured, System
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.verdicts import (
    Decision,
    LogOfLoad,
    MeasuredTogether,
    Names,
    NotMeasured,
    decide,
    why_unknown,
    without_log,
)


class ReservationSource(Protocol):
    """Answers what components need, together in one partition, on a host."""

    def look_up(self, members: tuple[Component, ...], host: Host) -> LookedUp | NotMeasured:
        """Return the reservation with which every APT of the members holds, or why there is none.

        Args:
            members: all components of the partition, in any order.

        Returns:
            Quick; the same question has the same answer.
        """

    def depends_on(self, host: Host) -> Hashable:
        """Return the facts of a host that decide the answers: hosts with equal facts have the same answers."""


@dataclass(frozen=True, slots=True)
class FixedReservations:
    """Only what the manifest fixes: the sum of the members' reserves.

    A component without APT and without reserve needs none. One with an APT and without a reserve is to be measured.
    """

    def look_up(self, members: tuple[Component, ...], host: Host) -> LookedUp | NotMeasured:
        """Add up the members' fixed reserves; `NotMeasured` where one is to be measured."""
        unknown = to_be_measured(members)
        return without_log(unknown, host.platform) if unknown else LookedUp(reservation=fixed(members, host))

    def depends_on(self, host: Host) -> Hashable:
        """Return the logical processors: a share is of these, and nothing else matters."""
        return host.logical_processors


def to_be_measured(members: Iterable[Component]) -> Names:
    """Name the components whose reserve comes from a measurement.

    Args:
        members: in any order. A component counts that says `measured`, or that has an APT and no reserve.

    Returns:
        Their names, sorted.
    """

    def is_open(component: Component) -> bool:
        return component.cpu.reserve is Measured.MEASURED or (component.cpu.reserve is None and bool(component.apt))

    return tuple(sorted(member.name for member in members if is_open(member)))


def depends_on_a_log(group: Group) -> bool:
    """Tell whether the partition's reservation comes from a data log.

    Args:
        group: the partition with its members.

    Returns:
        True where a member's reserve is to be measured and the partition fixes none of its own.
    """
    return group.request.cpu.reserve in (None, Measured.MEASURED) and bool(to_be_measured(group.members))


def fixed(members: Iterable[Component], host: Host) -> LogicalProcessors:
    """Add up what the manifest fixes of the members' reserves.

    Args:
        members: those without a fixed reserve count as 0.
        host: shares of a host are of its logical processors.

    Returns:
        The sum in logical processors, exact.
    """
    total = Fraction(0)
    for member in members:
        if member.cpu.reserve is not None and not isinstance(member.cpu.reserve, Measured):
            total += in_processors(member.cpu.reserve, host.logical_processors)
    return LogicalProcessors(total)


Logs = Mapping[tuple[Hashable, Names], tuple[LogOfLoad, ...]]
"""By kind of host and names: what is known with each load that their reservation must be enough with, in order."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredReservations:
    """Reservations from data logs, and from the manifest for components that need no log.

    In a partition of several the logs are those of all of them together, and what the manifest fixes of some is the
    least that they get. What is enough with every load is the greatest of what each load asks for.
    """

    kinds: Mapping[str, Hashable]  # host -> what it shares with others for which the same logs hold
    logs: Logs
    missed_together: Callable[[Names, Host], Fraction] = lambda _members, _host: Fraction(0)
    """The most LPs with which components that have a partition each were shown to miss in one; 0: never measured so."""
    _known: dict[Hashable, Decision] = field(default_factory=dict, compare=False, repr=False)

    def look_up(self, members: tuple[Component, ...], host: Host) -> LookedUp | NotMeasured:
        """Return the least reservation with which every APT of the members holds, by the verdict on their logs.

        Returns:
            At least what the manifest fixes; or why the verdict gives none.
        """
        if not (names := to_be_measured(members)):
            return FixedReservations().look_up(members, host)
        decision = self._decision(members, host)
        log = decision.log
        if log is None or log.least is None:
            return why_unknown(names, decision, self._logs(members, host), host.platform)
        logs = self.log_of_each_load(members, host)
        is_provisional = decision.verdict.achievement is Achievement.PROVISIONAL
        used, cpu_ms = (
            min(log.used or log.processors, log.processors),
            {each.name: log.cpu_ms(each.name) for each in members},
        )
        return LookedUp(
            reservation=LogicalProcessors(max(guaranteed(log.least, log.processors), fixed(members, host))),
            processors=log.processors,
            remarks=tuple(remark for each in logs for remark in each.remarks),
            provisional=is_provisional,
            uncertain=log.uncertain_at(log.least) if is_provisional else (),
            job_ms={name: ms / used for name, ms in cpu_ms.items() if ms is not None},
            governors=governors_in(logs),
            memory_peak=memory_peak_in(logs),
        )

    def depends_on(self, host: Host) -> Hashable:
        """Return the processors, for fixed reserves, and what data logs are compared with."""
        return host.logical_processors, self.kinds.get(host.name)

    def verdict(self, members: tuple[Component, ...], host: Host) -> ReservationVerdict:
        """Return the verdict on the thresholds of these components together; each is worked out once.

        Args:
            host: the host that the logs must hold for.
        """
        return self._decision(members, host).verdict

    def log(self, members: tuple[Component, ...], host: Host) -> MeasuredTogether | NotMeasured:
        """Find the data log that decides what these components reserve together on this host.

        Args:
            members: all components of the partition, in any order.
            host: logs are found by what it shares with others of its kind.

        Returns:
            The log of the load that asks for most, of several the one measured next below, with the least CR that is
                enough; or why there is none.
        """
        decision = self._decision(members, host)
        names, logs = to_be_measured(members), self._logs(members, host)
        return decision.log or why_unknown(names, decision, logs, host.platform)

    def _logs(self, members: tuple[Component, ...], host: Host) -> tuple[LogOfLoad, ...]:
        return self.logs.get((self.kinds.get(host.name), names_of(members)), ())

    def log_of_each_load(self, members: tuple[Component, ...], host: Host) -> tuple[MeasuredTogether, ...]:
        """Find the data logs that these components' reservation must be enough with on this host.

        Args:
            members: all components of the partition, in any order.

        Returns:
            One log for each load, in the order of the loads; empty: one is missing.
        """
        logs = self._logs(members, host)
        known = tuple(log for log in logs if isinstance(log, MeasuredTogether))
        return known if len(known) == len(logs) else ()

    def _decision(self, members: tuple[Component, ...], host: Host) -> Decision:
        apts = tuple((member.name, index, threshold) for member in members for index, threshold in member.apt.items())
        key = (self.kinds.get(host.name), names_of(members), apts)
        if key not in self._known:
            self._known[key] = decide(members, self._logs(members, host))
        return self._known[key]


@dataclass(frozen=True, slots=True)
class RecordedReservations:
    """Reservations that `record` looked up, and what the manifest fixes."""

    recorded: tuple[RecordedAnswer, ...]

    def look_up(self, members: tuple[Component, ...], host: Host) -> LookedUp | NotMeasured:
        """Return the recorded answer."""
        if not (unknown := to_be_measured(members)):
            return FixedReservations().look_up(members, host)
        names = names_of(members)
        found = (each.answer for each in self.recorded if each.members == names and host.name in each.hosts)
        return next(found, without_log(unknown, host.platform))

    def depends_on(self, host: Host) -> Hashable:
        """Return the logical processors, and the records of the host."""
        own = (number for number, each in enumerate(self.recorded) if host.name in each.hosts)
        return host.logical_processors, tuple(own)


def record(system: System, reservations: ReservationSource) -> tuple[RecordedAnswer, ...]:
    """Look up the measured reservation of each partition on each host that it may be on.

    Returns:
        By partition, one for the hosts that have the same answers; none without an answer.
    """
    found = []
    for group in filter(depends_on_a_log, groups_of(system)):
        alike: dict[Hashable, list[Host]] = {}
        for host in (host for host in system.hosts.values() if group.may_run_on(host.name)):
            alike.setdefault(reservations.depends_on(host), []).append(host)
        for hosts in alike.values():
            answer = reservations.look_up(group.members, hosts[0])
            if isinstance(answer, LookedUp):
                names = tuple(sorted(host.name for host in hosts))
                found.append(RecordedAnswer(members=names_of(group.members), hosts=names, answer=answer))
    return tuple(found)


def governors_in(logs: Iterable[MeasuredTogether]) -> tuple[str, ...]:
    """Return the frequency governors with which the settings of data logs were measured, sorted."""
    names = {speed.governor for evidence in _evidence(logs) for speed in evidence.speeds}
    return tuple(sorted(filter(None, names)))


def memory_peak_in(logs: Iterable[MeasuredTogether]) -> int:
    """Return the most memory that the components used at once in the settings of data logs; 0: not counted."""
    return max((evidence.memory_peak or 0 for evidence in _evidence(logs)), default=0)


def _evidence(logs: Iterable[MeasuredTogether]) -> Iterator[SettingEvidence]:
    for log in logs:
        for recorded in log.used_records:
            if recorded.setting.evidence is not None:
                yield recorded.setting.evidence


def provisional_on(
    system: System, reservations: ReservationSource, host: Host, partitions: Collection[str]
) -> dict[str, LookedUp]:
    """Return those of the partitions of a host whose reservation is of the first pass alone, by name, sorted."""
    groups = [group for group in groups_of(system) if group.name in partitions and depends_on_a_log(group)]
    answers = {group.name: reservations.look_up(group.members, host) for group in groups}
    return {name: found for name, found in sorted(answers.items()) if isinstance(found, LookedUp) and found.provisional}


def names_of(members: Iterable[Component]) -> Names:
    """List the members' names as data logs are found by.

    Returns:
        The names, sorted.
    """
    return tuple(sorted(member.name for member in members))
